"""Bijections: 0 is the start, bounds are kept, and the way back is the inverse."""

import math

import jax
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibrate.problem.bijections import bijection


CASES = {
    "unbounded": (3.0, -math.inf, math.inf, False),
    "unbounded, from 0": (0.0, -math.inf, math.inf, False),
    "above": (2.0, 0.5, math.inf, False),
    "above, soft": (2.0, 0.5, math.inf, True),
    "below": (2.0, -math.inf, 5.0, False),
    "between, by ratio": (1.0, 0.01, 100.0, False),
    "between, from 0": (0.9, 0.0, 1.0, False),
    "between, of both signs": (0.0, -3.0, 3.0, False),
}


@pytest.mark.parametrize("name", CASES)
@given(z=st.floats(-6.0, 6.0))
@settings(deadline=None, max_examples=30)
def test_values_keep_their_bounds_and_lead_back(name, z):
    start, lower, upper, soft = CASES[name]
    mapping = bijection(np.asarray(start), lower=lower, upper=upper, softplus=soft)
    value = float(mapping.value(np.asarray(z)))
    assert lower <= value <= upper
    # Close to a bound digits of the value are lost, and with them those of z.
    room = min(value - lower, upper - value, 1.0)
    assert float(mapping.coordinate(np.asarray(value))) == pytest.approx(
        z, abs=1e-9 + 1e-13 / max(room, 1e-300)
    )


@pytest.mark.parametrize("name", CASES)
def test_0_is_the_start_and_1_about_its_size(name):
    start, lower, upper, soft = CASES[name]
    mapping = bijection(np.asarray(start), lower=lower, upper=upper, softplus=soft)
    assert float(mapping.value(np.asarray(0.0))) == pytest.approx(start, abs=1e-12)
    slope = float(jax.grad(mapping.value)(0.0))
    size = abs(start) or 1.0
    assert 0.05 * size < slope < 3 * size
