"""Types are checked: of arguments before a call, and of its value with their sizes."""

import jax.numpy as jnp
import pytest
from jaxtyping import Array, Float, TypeCheckError, jaxtyped
from lazy_beartype import checked_when_called


@jaxtyped(typechecker=checked_when_called)
def first_rows(
    values: Float[Array, "n m"], last: Float[Array, " m"], rows: int
) -> Float[Array, "rows m"]:
    return values[:rows] if rows < 3 else last


def test_what_is_annotated_passes():
    assert first_rows(jnp.ones((3, 2)), jnp.ones(2), 2).shape == (2, 2)


@pytest.mark.parametrize(
    ("last", "rows", "words"),
    [
        (jnp.ones(4), 1, "parameters"),
        (jnp.ones(2), 1.5, "parameters"),
        (jnp.ones(2), 3, "return value"),
    ],
)
def test_other_types_and_sizes_are_refused(last, rows, words):
    with pytest.raises(TypeCheckError, match=words):
        first_rows(jnp.ones((3, 2)), last, rows)


def test_a_value_has_the_sizes_of_the_arguments():
    @jaxtyped(typechecker=checked_when_called)
    def halved(values: Float[Array, " n"]) -> Float[Array, " n"]:
        return values[: len(values) // 2]

    with pytest.raises(TypeCheckError, match="return value"):
        halved(jnp.ones(4))
