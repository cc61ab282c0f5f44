"""A point source: cosine over distance squared, its shadows, and all it sends out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.source import PointSource, Sun
from jaxthermo.physics.surface import Binding, Omitted
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import (
    check_terminator,
    exposure,
    heat_into,
    moved,
    shell,
    surface_of,
    whole,
)


PITCH = 0.01


@pytest.fixture(scope="module")
def plate():
    return voxelize(box((0.2, 0.2, 0.02)), PITCH)


@pytest.fixture(scope="module")
def ball():
    return voxelize(sphere(0.2, subdivisions=4), PITCH)


@pytest.mark.parametrize(
    "position",
    [(0.0, 0.0, 0.5), (0.3, -0.2, 0.05), (0.04, 0.03, 0.011), (9.0, 4.0, 0.5)],
)
def test_every_fragment_of_a_box_takes_its_cosine_and_distance(plate, position):
    away = np.array(position) - plate.fragment_position
    square = (away**2).sum(1)
    cosine = (away * plate.fragment_normal).sum(1) / np.sqrt(square)
    expected = np.maximum(0.0, cosine) / np.maximum(square, 1e-4)
    actual = exposure(plate, PointSource(position, 1.0))
    assert_allclose(actual, expected, rtol=1e-12, atol=1e-15)


def test_no_distance_is_too_small(plate):
    on_top = plate.fragment_position[plate.fragment_normal[:, 2] > 0.9][7]
    for lift in (0.0, 1e-9, 1e-3):
        position = tuple(float(x) for x in on_top + np.array([0.0, 0.0, lift]))
        close = exposure(plate, PointSource(position, 1.0, min_distance=0.02))
        assert np.isfinite(close).all() and close.max() <= 1 / 0.02**2


@pytest.mark.parametrize("distance", [0.21, 0.25, 0.5, 4.0])
def test_sphere_catches_its_solid_angle(ball, distance):
    position = distance * np.array([0.3, -0.5, 1.0]) / np.linalg.norm([0.3, -0.5, 1.0])
    intensity = exposure(ball, PointSource(tuple(position.tolist()), 1.0))
    caught = (intensity * ball.fragment_area).sum()
    exact = 2 * np.pi * (1 - np.sqrt(1 - (0.2 / distance) ** 2))
    assert caught == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("distance", [0.25, 0.5, 4.0])
def test_terminator_of_a_sphere_is_where_the_source_sets(ball, distance):
    position = distance * np.array([0.3, -0.5, 1.0]) / np.linalg.norm([0.3, -0.5, 1.0])
    away = position - ball.fragment_position
    square = (away**2).sum(1)
    cosine = (away * ball.fragment_normal).sum(1) / np.sqrt(square)
    actual = exposure(ball, PointSource(tuple(position.tolist()), 1.0)) * square
    check_terminator(actual, cosine, rounding=1e-9)


def test_a_lamp_in_a_hollow_ball_loses_nothing():
    """Flux through the six faces of a cube around it: 4 pi, at any position."""
    hollow = voxelize(shell(0.2, 0.24), 0.02)
    for position in ((0.0, 0.0, 0.0), (0.1, -0.05, 0.08)):
        inside = exposure(hollow, PointSource(position, 1.0))
        cavity = np.linalg.norm(hollow.fragment_position, axis=1) < 0.22
        assert inside[~cavity].max() == 0.0
        caught = (inside * hollow.fragment_area).sum()
        assert caught == pytest.approx(4 * np.pi, rel=0.01)


@pytest.mark.parametrize("height", [0.1, 0.2, 1.0])
def test_shadow_of_a_plate_over_a_plate_is_its_projection(plate, height):
    """A square 4 cm wide, 5 to 6 cm above the plate; its lower face is the wider."""
    cover = box((0.04, 0.04, 0.01)).moved((0.01, 0.0, 0.01 + 0.055))
    position = (0.01, 0.0, 0.01 + height)
    top = plate.fragment_normal[:, 2] > 0.9
    free = exposure(plate, PointSource(position, 1.0))[top]
    dark = 1 - exposure(plate, PointSource(position, 1.0), cover)[top] / free
    upper = height / (height - 0.06)
    lower = height / (height - 0.05)
    half = 0.02 * max(upper, lower)

    def seen(c):
        return np.minimum(c + half, 0.1) - np.maximum(c - half, -0.1)

    expected = float(seen(0.01) * seen(0.0))
    x, y = (plate.fragment_position[top, :2] - np.array([0.01, 0.0])).T
    assert abs((dark * PITCH**2).sum() - expected) < 0.5 * PITCH * 8 * min(half, 0.1)
    away = np.maximum(np.abs(x), np.abs(y))
    assert dark[away < half - PITCH].min(initial=1.0) == pytest.approx(1.0)
    assert dark[away > half + PITCH].max(initial=0.0) == pytest.approx(0.0, abs=1e-12)
    assert (away < half - PITCH).any()


def test_no_light_under_a_body_that_stands_on_another(plate):
    cover = box((0.06, 0.08, 0.02)).moved((0.0, 0.0, 0.02))
    covered = exposure(plate, PointSource((0.08, 0.0, 0.06), 1.0), cover)
    top = plate.fragment_normal[:, 2] > 0.9
    x = plate.fragment_position[:, 0]
    y = plate.fragment_position[:, 1]
    under = top & (abs(x) < 0.03) & (abs(y) < 0.04)
    assert covered[under].max() == 0.0
    assert covered[top & (x > 0.04)].min() > 0.0


def test_from_afar_it_is_the_sun(ball):
    away = np.array([600.0, -800.0, 0.0])
    actual = 1e6 * exposure(ball, PointSource((600.0, -800.0, 0.0), 1.0))
    expected = exposure(ball, Sun((-0.6, 0.8, 0.0), 1.0))
    # A pixel on the rim of a shadow may fall to either side.
    assert np.mean(np.abs(actual - expected) > 1e-3) < 0.01
    caught = (actual * ball.fragment_area).sum()
    assert caught == pytest.approx((expected * ball.fragment_area).sum(), rel=1e-3)
    assert np.linalg.norm(away) == 1000.0


def test_what_is_absorbed(plate):
    """A square twice as wide as it is near fills a third of the half space."""
    (binding,) = PointSource((0.0, 0.0, 0.11), 25.0).bind(whole(surface_of(plate)))
    assert isinstance(binding, Binding)
    heat = heat_into(binding).sum()
    assert heat == pytest.approx(25.0 * 4 * np.pi / 6, rel=0.01)


def test_inside_a_body_is_refused(plate):
    surface = surface_of(plate, moved(1.0, 0.0, 0.0))
    lamp = PointSource((1.02, 0.03, 0.005), 1.0)
    with pytest.raises(jt.InputError, match=r"position=\(1.02.*is inside body 0"):
        lamp.bind(whole(surface))
    (binding,) = PointSource((1.0, 0.0, 0.1), 1.0).bind(whole(surface))
    assert isinstance(binding, Binding)


def test_what_it_does_not_light_is_left_out(plate):
    surface = surface_of(plate, obstacles=[box(0.05).moved((0.0, 0.0, -0.3)).triangles])
    hidden = PointSource((0.0, 0.0, -0.9), 1.0)
    (binding,) = hidden.bind(whole(surface))
    assert isinstance(binding, Binding)
    wide = surface_of(
        plate, obstacles=[box((2.0, 2.0, 0.1)).triangles - [0.0, 0.0, 0.3]]
    )
    (result,) = hidden.bind(whole(wide))
    assert isinstance(result, Omitted) and "sees" in result.reason
    (result,) = PointSource((0.0, 0.0, 1.0), 0.0).bind(whole(surface))
    assert isinstance(result, Omitted)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (((0.0, 0.0), 1.0), "three finite numbers"),
        (("up", 1.0), "three finite numbers"),
        (((0.0, 0.0, np.nan), 1.0), "three finite numbers"),
        (((0.0, 0.0, 1.0), -1.0), "radiant_intensity"),
        (((0.0, 0.0, 1.0), 1.0, 0.0), "min_distance"),
    ],
)
def test_bad_input_is_told_in_a_line(arguments, says):
    with pytest.raises(jt.InputError, match=says) as told:
        PointSource(*arguments)
    assert "\n" not in str(told.value)
