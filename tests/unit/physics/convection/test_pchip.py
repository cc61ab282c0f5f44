"""Monotone cubic interpolation against scipy's."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator

from jaxthermo.physics.convection.nusselt import pchip


values = st.lists(st.floats(-10, 10), min_size=8, max_size=8)
gaps = st.lists(st.floats(0.1, 3.0), min_size=7, max_size=7)


@eqx.filter_jit
def rows_at(curve, x):
    # The curve's own numbers are arguments: one program for all examples.
    return curve(x)


@settings(deadline=None, max_examples=60)
@given(y=values, gap=gaps)
def test_it_is_scipys_curve(y, gap):
    x = np.concatenate([[0.0], np.cumsum(gap)])
    y = np.round(np.array(y), 3)
    at = np.linspace(x[0], x[-1], 101)
    interpolated = np.asarray(rows_at(pchip(x, y[:, None]), jnp.asarray(at)))[:, 0]
    assert_allclose(interpolated, PchipInterpolator(x, y)(at), atol=1e-10)


def test_beyond_the_ends_it_is_constant_and_its_slope_continuous_inside():
    x = np.array([0.0, 1.0, 2.5, 3.0])
    curve = pchip(x, np.array([[0.0], [1.0], [1.5], [4.0]]))
    value_and_slope = jax.jit(jax.vmap(jax.value_and_grad(lambda s: curve(s)[0])))
    at = jnp.asarray([-5.0, *(x[1:3] - 1e-9), *(x[1:3] + 1e-9), 9.0])
    value, slope = value_and_slope(at)
    assert_allclose(value[jnp.array([0, 5])], [0.0, 4.0])
    assert_allclose(slope[1:3], slope[3:5], rtol=1e-6)
    assert float(slope[0]) == float(slope[5]) == 0.0
