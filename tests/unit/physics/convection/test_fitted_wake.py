"""The wake by Reynolds number: range, smoothness, one and two cylinders in wind."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from wind_bodies import (
    DIAMETER,
    behind,
    flux_at,
    law_of,
    upright_cylinder,
)

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.physics.convection.air import kinematic_viscosity
from jaxthermo.physics.convection.wake import FittedWake, _wake_ranges
from jaxthermo.physics.convection.wake_geometry import wake_geometry
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.surface import Binding
from tests.radiating import surface_of, whole
from tests.slopes import check_gradient


AIR = 300.0
HOT = 340.0
ALONG_X = (1.0, 0.0, 0.0)
VISCOSITY = float(kinematic_viscosity(jnp.asarray(AIR)))

ratio = jax.jit(FittedWake())


def ratio_at(point):
    """Speed ratio at a distance, a distance aside and a Reynolds number."""
    x, y, reynolds = point
    return FittedWake()(x, y, reynolds)


def speed_of(reynolds):
    return reynolds * VISCOSITY / DIAMETER


def geometry_of(seen):
    return wake_geometry(
        seen.scene_triangles,
        position=seen.position,
        direction=np.array(ALONG_X),
        pitch=seen.pitch,
    )


def heat(seen, wake, reynolds=100.0):
    """Heat into the whole surface [W]."""
    wind = Wind(ALONG_X, AIR, speed=speed_of(reynolds), wake=wake)
    return float((flux_at(law_of(wind, seen), HOT) * seen.area).sum())


def factor(*position, reynolds=100.0):
    """Heat transfer in the wake over that without."""
    seen = behind(*position)
    return heat(seen, FittedWake(), reynolds) / heat(seen, None, reynolds)


def test_the_ratio_is_above_zero_and_at_most_one_everywhere():
    x, y, reynolds = np.meshgrid(
        [-5.0, -1.0, -0.5, 0.0, 0.3, 1.0, 3.0, 10.0, 1e3, 1e6],
        [0.0, 0.3, 1.0, 5.0, 1e3],
        [0.0, 1.0, 10.0, 40.0, 47.0, 60.0, 150.0, 200.0, 1e4, 1e7],
    )
    ratios = np.asarray(ratio(*(jnp.asarray(v.ravel()) for v in (x, y, reynolds))))
    assert (ratios > 0).all() and (ratios <= 1 + 1e-12).all()
    ahead = ratios.reshape(x.shape)[x <= -1.0]
    assert_allclose(ahead, 1.0, rtol=1e-12)
    # Slow in the bubble, undisturbed far away.
    near = ratio(jnp.asarray(0.5), jnp.asarray(0.0), jnp.asarray(40.0))
    far = ratio(jnp.asarray(1e6), jnp.asarray(0.0), jnp.asarray(20.0))
    assert float(near) < 0.1 and float(far) > 0.99


def test_a_turbulent_wake_is_that_of_the_published_law_far_away():
    x = jnp.asarray([100.0, 400.0])
    deficit = 1 - np.asarray(ratio(x, 0 * x, jnp.asarray(1e4)))
    assert_allclose(deficit, 0.98 * np.sqrt(1.2 / np.asarray(x)), rtol=0.02)
    half = 0.25 * jnp.sqrt(1.2 * x)
    aside = 1 - np.asarray(ratio(x, half, jnp.asarray(1e4)))
    assert_allclose(aside / deficit, 0.5, atol=0.03)


def test_the_wake_is_smooth_in_distance_and_reynolds_number():
    """The slope never jumps: by steps of a thousandth it changes little."""
    point = jnp.asarray([0.7, 0.3, 50.0])
    slope = jax.jit(jax.vmap(jax.grad(ratio_at)))
    for axis, values in enumerate(
        (
            np.linspace(-1.5, 12.0, 4000),
            np.linspace(0.0, 4.0, 4000),
            np.geomspace(2.0, 1e3, 4000),
        )
    ):
        points = jnp.tile(point[None], (4000, 1)).at[:, axis].set(values)
        slopes = np.asarray(slope(points))[:, axis]
        if axis == 2:
            slopes = slopes * values
        assert np.isfinite(slopes).all()
        assert np.abs(np.diff(slopes)).max() < 0.03 * np.ptp(slopes)


def test_gradients_are_right():
    steps = [1e-6, 1e-6, 1e-4]
    check_gradient(ratio_at, [2.0, 0.4, 80.0], step=steps, rtol=1e-5)


def test_one_body_is_cooled_as_without_a_wake():
    seen = surface_of(upright_cylinder())
    assert heat(seen, FittedWake()) == heat(seen, None)
    geometry = geometry_of(seen)
    assert geometry.behind.shape == (0, len(seen.area))


def test_places_are_behind_the_rear_and_beside_the_middle():
    seen = behind(4.0, 1.5)
    geometry = geometry_of(seen)
    # Of both cylinders, the second is the points' own.
    upstream = int(np.argmax(geometry.behind.max(1)))
    position = seen.position / DIAMETER
    assert_allclose(geometry.behind[upstream], position[:, 0] + 4.0 - 0.5, atol=0.02)
    # As high as wide: it is no rod, and its wake is round.
    aside = np.hypot(position[:, 1] + 1.5, position[:, 2])
    assert_allclose(geometry.aside[upstream], aside, atol=0.03)
    assert_allclose(geometry.diameter, DIAMETER, rtol=0.01)


def test_one_behind_another_is_cooled_less_the_nearer_it_is():
    factors = [factor(1.0 + gap) for gap in (0.5, 2.0, 5.0)]
    assert 0.1 < factors[0] < factors[1] < factors[2] < 1.0
    # As by a wind of the mean speed that arrives at its front.
    seen = behind(6.0)
    x = jnp.asarray(seen.position[:, 0] / DIAMETER + 5.5)
    y = jnp.asarray(np.hypot(*seen.position[:, 1:].T) / DIAMETER)
    front = np.maximum(-seen.normal[:, 0], 0) * seen.grid.fragment_area
    arriving = np.average(np.asarray(ratio(x, y, jnp.asarray(100.0))), weights=front)
    alone = heat(seen, None, 100.0 * float(arriving))
    assert heat(seen, FittedWake()) == pytest.approx(alone, rel=5e-3)


def test_a_rod_has_a_wake_along_its_length():
    long = shapes.cylinder(0.05, 0.6, sections=48).triangles
    plate = shapes.box((0.1, 0.4, 1.0)).triangles
    plate = plate + np.array([0.5, 0.0, 0.0]) - plate.min((0, 1)) * [1.0, 0.0, 0.0]
    inclined = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    # Behind the middle, behind the upper half, and beyond the upper end.
    points = np.array([[0.5, 0.1, 0.0], [0.5, 0.0, 0.2], [0.5, 0.0, 0.45]])
    for shear in (np.eye(3), inclined):
        triangles = np.concatenate([long @ shear.T, plate])
        geometry = wake_geometry(
            triangles, position=points, direction=np.array(ALONG_X), pitch=0.01
        )
        rod = int(np.argmin(geometry.diameter))
        rear = 0.05 + shear[0, 2] * np.minimum(points[:, 2], 0.25)
        assert_allclose(geometry.behind[rod], (0.5 - rear) / 0.1, atol=0.06)
        assert_allclose(geometry.aside[rod], [1.0, 0.0, 2.0], atol=0.06)


def test_heat_transfer_is_continuous_as_it_moves_out_of_the_wake():
    offsets = np.concatenate([np.linspace(0, 3, 31), [5.0, 8.0]])
    # Without a wake another cylinder changes nothing, wherever it stands.
    alone = heat(behind(3.0), None)
    assert heat(behind(3.0, 1.0), None) == alone

    def factor_at(y):
        return heat(behind(3.0, y), FittedWake()) / alone

    factors = np.array([factor_at(y) for y in offsets])
    assert factors[0] < 0.7 and factors[-1] == pytest.approx(1.0, abs=1e-6)
    assert np.diff(factors).min() > -1e-3 and np.abs(np.diff(factors)[:30]).max() < 0.05
    # By a smaller step it changes by less.
    near = np.array([factor_at(y) for y in np.linspace(0.5, 0.51, 6)])
    assert np.abs(np.diff(near)).max() < 3e-3


# By default the wake is smooth in the Reynolds number, which a gust runs through.
@pytest.mark.slow
@pytest.mark.slice
def test_a_gusty_wind_has_the_wake_of_each_moment():
    seen = behind(4.0)
    top = speed_of(200.0)
    gusts = jt.Table([0.0, 1.0], [0.0, top])
    law = law_of(Wind(ALONG_X, AIR, speed=gusts, wake=FittedWake()), seen)
    for reynolds in (15.0, 55.0, 120.0):
        gusty = flux_at(law, HOT, time=reynolds / 200.0)
        total = float((gusty * seen.area).sum())
        assert total == pytest.approx(heat(seen, FittedWake(), reynolds), rel=5e-3)


def test_the_receipt_names_what_no_wake_was_computed_for():
    seen = behind(4.0)

    def notes(reynolds, body=seen):
        wind = Wind(ALONG_X, AIR, speed=speed_of(reynolds), wake=FittedWake())
        (binding,) = wind.bind(whole(body))
        assert isinstance(binding, Binding)
        lines = [line for note in binding.notes for line in note.lines()]
        return [line for line in lines if "the wake is" in line]

    assert notes(20.0) == notes(100.0) == []
    assert "below 10, where none was computed" in notes(2.0)[0]
    assert "computed up to 150, from 300 on" in notes(5e3)[0]
    assert notes(5e3, surface_of(upright_cylinder())) == []
    assert [wake_range.regime for wake_range in _wake_ranges()] == [
        "steady",
        "shedding",
        "turbulent",
    ]
