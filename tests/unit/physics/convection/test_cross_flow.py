"""Local Nusselt number: its average, minima, slopes and validity notes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose

from jaxthermo.physics.convection.cross_flow import (
    _harmonics,
    _shape_coefficients,
    _shape_factor,
    local_nusselt,
    surface_harmonics,
    validity_notes,
)
from jaxthermo.physics.convection.nusselt import (
    AVERAGES,
    MAX_REYNOLDS,
    cylinder_table,
)


ANGLES = jnp.linspace(0, jnp.pi, 721)
AROUND = jnp.asarray(np.arange(64) * (2 * np.pi / 64))


@jax.jit
def shape(reynolds):
    """At all angles."""
    coefficients = jnp.broadcast_to(_shape_coefficients(reynolds), (*ANGLES.shape, 16))
    return _shape_factor(coefficients, _harmonics(jnp.cos(ANGLES)))


@jax.jit
def around(reynolds):
    """By each average all the way around, and the average itself; Pr 0.7."""
    prandtl = jnp.full(64, 0.7)
    local = [
        local_nusselt(
            jnp.cos(AROUND),
            reynolds=jnp.full(64, reynolds),
            prandtl_number=prandtl,
            average=average.nusselt,
        )
        for average in AVERAGES
    ]
    limited = jnp.full(64, jnp.minimum(reynolds, MAX_REYNOLDS))
    means = [average.nusselt(limited, prandtl)[0] for average in AVERAGES]
    return jnp.stack(local), jnp.stack(means)


def minima(reynolds):
    """Angles of the interior minima [degrees]."""
    factor = np.asarray(shape(reynolds))
    inner = (factor[1:-1] < factor[:-2]) & (factor[1:-1] <= factor[2:])
    return np.degrees(np.asarray(ANGLES[1:-1])[inner])


@settings(deadline=None, max_examples=40)
@given(exponent=st.floats(-2, 6))
def test_the_average_around_is_the_chosen_average(exponent):
    """64 even angles integrate cosines up to the 63rd exactly."""
    local, mean = around(10.0**exponent)
    assert_allclose(local.mean(1) / mean, 1.0, rtol=1e-12)


def test_at_re_6071_the_average_lies_where_correlations_do():
    """Those of six authors lie between 40.4 and 50.0 there (Pr 0.7)."""
    local, _ = around(6071.0)
    for mean in local.mean(1)[:2]:
        assert 40.0 < float(mean) < 50.0


@pytest.mark.parametrize("reynolds", [1.0, 5.0, 10.0, 20.0])
def test_slow_flow_has_no_minimum_but_the_rear(reynolds):
    assert len(minima(reynolds)) == 0


@pytest.mark.parametrize(
    ("reynolds", "angle"),
    [(40.0, 158), (100.0, 96), (1000.0, 96), (4000.0, 96), (1e4, 94)]
    + [(3e4, 86), (7.08e4, 86), (1.013e5, 86)],
)
def test_one_minimum_where_the_flow_separates(reynolds, angle):
    (minimum,) = minima(reynolds)
    assert minimum == pytest.approx(angle, abs=1.0)


@pytest.mark.parametrize("reynolds", [1.4e5, 1.7e5, 1.86e5, 2.19e5])
def test_two_minima_after_the_transition(reynolds):
    first, second = minima(reynolds)
    assert 80 < first < 90 and 130 < second < 150


def test_the_shape_stays_positive_everywhere():
    lowest = [float(shape(re).min()) for re in np.geomspace(0.1, 1e6, 200)]
    assert 0.355 < min(lowest) < 0.360


def test_the_shape_is_held_outside_its_knots():
    ends = jax.jit(_shape_coefficients)(jnp.array([0.0, 1e7]))
    assert_allclose(ends, cylinder_table().shape[[0, -1]], atol=1e-15)


@jax.jit
def by_normal(normals):
    """The factor and its slope by the normal, around an upright cylinder."""

    def factor(normal):
        square = (normal[:2] @ normal[:2])[None]
        coefficients = _shape_coefficients(jnp.array([2e4]))
        return _shape_factor(coefficients, _harmonics(-normal[:1], square))[0]

    return jax.vmap(jax.value_and_grad(factor))(normals)


def test_slopes_by_the_normal_are_finite_and_right():
    """At 0, 30, 90, 180 degrees and on an end, in the plane across and out of it."""
    angle = np.radians([0.0, 30.0, 90.0, 180.0])
    side = np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    normals = np.concatenate([side, [[0.0, 0.0, 1.0]]])
    steps = 1e-6 * np.eye(3)
    forward = (normals[:, None] + steps).reshape(15, 3)
    backward = (normals[:, None] - steps).reshape(15, 3)
    stacked = np.concatenate([forward, backward, normals])
    value, slope = (np.asarray(v) for v in by_normal(jnp.asarray(stacked)))
    rise = (value[:15] - value[15:30]) / 2e-6
    assert_allclose(slope[30:], rise.reshape(5, 3), atol=1e-7)


def test_harmonics_are_cosines_on_the_side_and_vanish_on_the_ends():
    axis = np.array([0.0, 0.0, 1.0])
    wind = np.array([1.0, 0.0, 0.0])
    angle = np.linspace(0, 2 * np.pi, 50)
    side = np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    order = np.arange(1, 17)[:, None]
    assert_allclose(
        surface_harmonics(side, axis, wind), np.cos(order * angle), atol=1e-13
    )
    # Tilted by 60 degrees: r = 1/2, and r^k cos(k theta).
    tilted = 0.5 * side + np.sqrt(0.75) * axis
    assert_allclose(
        surface_harmonics(tilted, axis, wind),
        0.5**order * np.cos(order * angle),
        atol=1e-13,
    )
    assert not surface_harmonics(axis[None], axis, wind).any()


def test_a_wind_along_the_axis_has_no_front_side():
    axis = np.array([0.0, 0.0, 1.0])
    side = np.array([[1.0, 0.0, 0.0]])
    assert not surface_harmonics(side, axis, axis).any()
    # From 30 degrees off it the whole pattern is there.
    for degrees, share in ((30.0, 1.0), (60.0, 1.0), (15.0, 2 * np.sin(np.pi / 12))):
        wind = np.array(
            [-np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))]
        )
        first = surface_harmonics(side, axis, wind)[0, 0]
        assert first == pytest.approx(share, rel=1e-12)


def test_the_front_is_what_laminar_theory_gives_within_what_is_stated():
    """Froessling's 0.945 sqrt(Re) (Pr 0.7) against the levels of two averages."""
    reynolds = np.array([1e4, 3e4, 7.08e4])
    fronts = np.stack([around(re)[0][:, 0] for re in reynolds], axis=1)
    share = fronts / (0.945 * np.sqrt(reynolds))
    assert_allclose(share[0], [0.91, 0.82, 0.87], atol=0.01)
    assert_allclose(share[2], [1.00, 1.00, 1.09], atol=0.01)


def test_doubts_are_told_where_there_are_some():
    churchill, sanitjai, _ = AVERAGES
    assert validity_notes(5000.0, churchill) == ()
    assert "recalled" in validity_notes(7.08e4, churchill)[0]
    assert "is constant" in validity_notes(3e5, churchill)[0]
    assert "outside sanitjai_goldstein's range" in validity_notes(100.0, sanitjai)[0]


def test_above_the_limit_the_number_is_held():
    held, top, below = (float(around(re)[0][0, 0]) for re in (1e7, 2.5e5, 2.4e5))
    assert held == top > below
