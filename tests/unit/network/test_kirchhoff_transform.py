"""Integrals of piecewise linear properties, their inverses and derivatives."""

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo.material.material import Property
from jaxthermo.network.nonlinear import kirchhoff_transform


KNOTS = 4
"""Number of knots of every random property: nothing is compiled twice."""
POINTS = np.linspace(-500.0, 900.0, 57)


def _random(seed):
    random = np.random.default_rng(seed)
    kelvin = np.cumsum(random.uniform(1.0, 150.0, KNOTS)) + 100.0
    return Property(kelvin, random.uniform(0.5, 50.0, KNOTS)), random


def _exact(prop, reference, theta):
    """By trapezoids between the knots, over the value at the reference."""
    inside = prop.temperatures - reference
    low = min(0.0, theta)
    high = max(0.0, theta)
    points = np.unique([low, high, *inside[(inside > low) & (inside < high)]])
    area = np.trapezoid(prop(points + reference), points)
    return np.sign(theta) * area / prop(reference)


@jax.jit
def _all_of(integral, theta):
    is_between = integral(theta)
    return is_between, integral.inverse(is_between), integral.slope(theta)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), at_knot=st.booleans())
def test_the_integral_its_inverse_and_its_slope(seed, at_knot):
    prop, random = _random(seed)
    reference = float(random.uniform(50.0, 900.0))
    if at_knot:
        reference = float(prop.temperatures[1])
    theta = np.r_[0.0, prop.temperatures - reference, POINTS]
    actual, back, slope = _all_of(
        kirchhoff_transform(prop, reference, jnp.float64), jnp.asarray(theta)
    )
    exact = [_exact(prop, reference, x) for x in theta]
    np.testing.assert_allclose(actual, exact, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(back, theta, rtol=1e-10, atol=1e-9)
    expected = prop(theta + reference) / prop(reference)
    np.testing.assert_allclose(slope, expected, rtol=1e-11)
    assert actual[0] == 0.0 and back[0] == 0.0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_mean_between_two_temperatures_is_the_integral_over_their_difference(seed):
    prop, random = _random(seed)
    transform = kirchhoff_transform(prop, 300.0, jnp.float64)
    first = jnp.asarray(POINTS)
    second = jnp.asarray(random.permutation(POINTS))
    exact = [
        (_exact(prop, 300.0, b) - _exact(prop, 300.0, a)) / (b - a or np.inf)
        for a, b in zip(POINTS, np.asarray(second), strict=True)
    ]
    mean, same = _MEANS(transform, first, second), _MEANS(transform, first, first)
    np.testing.assert_allclose(
        mean,
        np.where(second == first, prop(POINTS + 300.0) / prop(300.0), exact),
        1e-10,
    )
    np.testing.assert_allclose(same, prop(POINTS + 300.0) / prop(300.0), rtol=1e-11)


_MEANS = jax.jit(lambda transform, first, second: transform.mean(first, second))


@pytest.mark.parametrize("gap", [0.0, 1e-5, 1e-3, 0.1, 30.0])
def test_means_of_close_temperatures_keep_their_digits_in_float32(gap):
    prop = Property([310.0, 320.0, 330.0, 400.0], [1.0, 20.0, 1.0, 2.0])
    theta = np.array([-10.0, 9.5, 10.0, 19.99, 20.0, 30.0, 70.0], np.float32)
    second = theta + np.float32(gap)
    actual = kirchhoff_transform(prop, 300.0, jnp.float32).mean(
        jnp.asarray(theta), jnp.asarray(second)
    )
    exact = kirchhoff_transform(prop, 300.0, jnp.float64).mean(
        jnp.asarray(theta, float), jnp.asarray(second, float)
    )
    np.testing.assert_allclose(actual, exact, rtol=3e-6)


def test_the_heat_between_two_temperatures_has_the_conductivities_as_derivatives():
    prop = Property([310.0, 320.0, 330.0], [1.0, 20.0, 1.0])
    transform = kirchhoff_transform(prop, 300.0, jnp.float64)

    def rise(first, second):
        return (transform.mean(first, second) * (second - first)).sum()

    first = jnp.array([12.0, 5.0, 40.0, 17.0])
    second = first + jnp.array([0.0, 40.0, -30.0, 1e-7])
    by_first, by_second = jax.grad(rise, argnums=(0, 1))(first, second)
    np.testing.assert_allclose(by_first, -transform.slope(first), rtol=1e-9)
    np.testing.assert_allclose(by_second, transform.slope(second), rtol=1e-9)


def test_bounds_are_those_of_the_table():
    integral = kirchhoff_transform(Property([300, 400], [2.0, 8.0]), 350.0, jnp.float64)
    assert float(integral.min()) == pytest.approx(0.4)
    assert float(integral.max()) == pytest.approx(1.6)


def test_a_constant_is_the_identity():
    integral = kirchhoff_transform(Property([300.0], [7.0]), 350.0, jnp.float64)
    theta = jnp.asarray(POINTS)
    integrals, back, slope = _all_of(integral, theta)
    np.testing.assert_allclose(integrals, POINTS, rtol=1e-15)
    np.testing.assert_allclose(back, POINTS, rtol=1e-15)
    np.testing.assert_array_equal(slope, 1.0)


def test_no_digits_are_lost_near_the_reference():
    """In float32, on a peak of a thousand times the heat, far from the outer knots."""
    peak = Property([200.0, 349.0, 350.0, 351.0, 800.0], [1, 1, 1000, 1, 2])
    integral = kirchhoff_transform(peak, 290.0, jnp.float32)
    near = np.geomspace(1e-6, 1.0, 40)
    far = np.linspace(-80.0, 500.0, 4001)
    theta = np.r_[near, far].astype(np.float32)
    integrals, back, _ = (np.asarray(x) for x in _all_of(integral, jnp.asarray(theta)))
    np.testing.assert_allclose(integrals[:40], theta[:40], rtol=3e-7)
    np.testing.assert_allclose(back[:40], theta[:40], rtol=5e-7)
    # The heat of the peak, 1000 K, is resolved to 1e-4 K.
    assert np.abs(back - theta).max() < 3e-4
    assert (np.diff(integrals[40:]) > 0).all()


def test_derivatives_are_finite_at_and_between_knots():
    prop = Property([300.0, 340.0, 341.0, 342.0], [1.0, 1.0, 200.0, 1.0])
    integral = kirchhoff_transform(prop, 310.0, jnp.float64)
    theta = jnp.r_[integral.knot, 0.0, -400.0, 31.5, 400.0]
    slope = jax.jit(jax.vmap(jax.grad(integral)))(theta)
    integrals, _, expected = _all_of(integral, theta)
    np.testing.assert_allclose(slope, expected, rtol=1e-12)
    back = jax.jit(jax.vmap(jax.grad(integral.inverse)))(integrals)
    np.testing.assert_allclose(back, 1 / slope, rtol=1e-9)


def test_derivatives_reach_the_table_and_the_reference():
    theta = jnp.array([-20.0, 10.0, 30.0, 200.0])
    weight = jnp.array([1.0, -2.0, 0.7, 0.1])

    def total(numbers):
        """By three temperatures, three values and the reference."""
        prop = Property(numbers[:3], numbers[3:6])
        integral = kirchhoff_transform(prop, numbers[6], jnp.float64)
        return (weight * (integral(theta) + integral.inverse(theta))).sum()

    at = np.array([300.0, 350.0, 420.0, 2.0, 5.0, 3.0, 330.0])
    slopes = jax.jit(jax.grad(total))(jnp.asarray(at))
    step = 1e-5 * np.eye(7)
    ends = jax.jit(jax.vmap(total))(jnp.asarray(np.r_[at + step, at - step]))
    differences = (ends[:7] - ends[7:]) / 2e-5
    np.testing.assert_allclose(slopes, differences, rtol=1e-6, atol=1e-8)
    assert (np.abs(slopes) > 1e-3).all()
