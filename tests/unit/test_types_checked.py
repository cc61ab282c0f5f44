"""Types of arguments are checked in tests, by the first call and by later ones."""

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

from jaxthermo.network.network import precise_sum


def test_another_type_than_that_of_the_annotation_is_refused():
    for _ in range(2):
        with pytest.raises(TypeCheckError, match="precise_sum"):
            precise_sum(jnp.zeros(2, int))
    assert float(precise_sum(jnp.zeros(2))) == 0
