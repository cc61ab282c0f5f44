"""View factors to the surroundings, against closed forms and against exchange."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.parallel import threads
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.physics.radiation.view_factors import view_factors
from jaxthermo.physics.radiation.visibility import (
    lines_to_surroundings,
    sky_view,
    unobstructed_view,
)
from jaxthermo.physics.surface import Omitted
from jaxthermo.reference.view_factor import element_to_disc, parallel_rectangles
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import heat_into, in_patches, moved, shell, surface_of, whole


def element_to_sphere(radius, distance, cosine):
    """View factor to a sphere above the horizon: (R / d)^2 cos(angle to its centre)."""
    return (radius / distance) ** 2 * cosine


def out_of_groove(x, angle):
    """View factor from a wall of an endless V, x from its bottom, to outside.

    F = [1 - (cos a - x) / sqrt(1 + x^2 - 2 x cos a)] / 2, walls of 1 m
    """
    along = np.cos(angle) - x
    across = np.sin(angle)
    return (1 - along / np.hypot(along, across)) / 2


def groove_mouth(angle):
    """The same of a whole wall."""
    return np.sin(angle / 2)


def test_closed_forms_of_groove_and_sphere():
    t, w = np.polynomial.legendre.leggauss(200)
    along = out_of_groove(0.5 + 0.5 * t, 0.9)
    assert w @ along / 2 == pytest.approx(groove_mouth(0.9), abs=1e-4)
    # A sphere far away is a disc of its radius.
    far = element_to_sphere(1.0, 1e3, 1.0)
    assert far == pytest.approx(element_to_disc(1.0, 1e3), rel=2e-6)


def quads(corners):
    """Two triangles for each four corners."""
    a, b, c, d = np.moveaxis(np.array(corners, float), 1, 0)
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def groove(angle, length=60.0):
    """An endless V in a flat ground, its walls 1 m long, along y."""
    s = np.sin(angle / 2)
    c = np.cos(angle / 2)
    y = np.array([0.0, length / 2, 0.0])
    sides = []
    for sign in (1.0, -1.0):
        rim = np.array([sign * s, 0.0, c])
        out = np.array([sign * 5.0, 0.0, 0.0])
        sides += [[-y, rim - y, rim + y, y]]
        sides += [[rim - y, rim + out - y, rim + out + y, rim + y]]
    # What is below the ground must not be seen through it.
    sides += [[[-6, -30, -0.5], [6, -30, -0.5], [6, 30, -0.5], [-6, 30, -0.5]]]
    return quads(sides)


@pytest.mark.parametrize(
    "degrees",
    [
        60.0,
        pytest.param(90.0, marks=pytest.mark.slow),
        pytest.param(120.0, marks=pytest.mark.slow),
    ],
)
def test_endless_groove(degrees):
    angle = np.deg2rad(degrees)
    pitch = 0.05
    s = np.sin(angle / 2)
    c = np.cos(angle / 2)
    x, y = np.meshgrid(
        (np.arange(20) + 0.5) * pitch, 0.37 * np.arange(9) * pitch, indexing="ij"
    )
    position = np.stack([x * s, y, x * c], axis=-1).reshape(-1, 3)
    normal = np.tile([-c, 0.0, s], (len(position), 1))
    view = sky_view(
        groove(angle), position=position, normal=normal, pitch=pitch, directions=256
    )
    factor = (view.sky + view.ground).reshape(x.shape).mean(1)
    exact = out_of_groove(x[:, 0], angle)
    rms = float(np.sqrt(np.mean((factor - exact) ** 2)))
    assert rms < 0.015
    assert factor.mean() == pytest.approx(groove_mouth(angle), abs=0.008)
    # The ground is below the horizon, and here all of it is hidden by the walls.
    assert view.ground.max() < 0.02


def test_ball_on_a_plane():
    ball = sphere(1.0, 3).triangles + np.array([0.0, 0.0, 1.0])
    position = np.random.default_rng(0).uniform(-3, 3, (800, 3)) * np.array([1, 1, 0.0])
    position = position[np.hypot(*position[:, :2].T) > 0.2]
    normal = np.tile([0.0, 0.0, 1.0], (len(position), 1))
    floor = box((20.0, 20.0, 1.0)).triangles - np.array([0.0, 0.0, 0.5])
    view = sky_view(
        np.concatenate([ball, floor]), position=position, normal=normal, pitch=0.05
    )
    away = np.hypot(*position[:, :2].T)
    far = np.hypot(away, 1.0)
    exact = 1 - element_to_sphere(1.0, far, 1 / far)
    assert_array_equal(view.ground, 0.0)
    assert np.sqrt(np.mean((view.sky - exact) ** 2)) < 0.02


@pytest.mark.parametrize("directions", [8, 33])
def test_convex_bodies_see_everything_exactly(directions):
    ball = voxelize(sphere(0.2, 3), 0.02)
    position = ball.fragment_position
    normal = ball.fragment_normal
    view = sky_view(
        ball.mesh.triangles,
        position=position,
        normal=normal,
        pitch=0.02,
        directions=directions,
    )
    free = unobstructed_view(normal)
    # On facets next to the terminator a ray may graze the next one.
    off = np.abs(view.sky + view.ground - 1) > 1e-12
    assert off.mean() < 0.02
    assert_allclose(view.sky[~off], free.sky[~off], atol=1e-12)
    block = voxelize(box((0.2, 0.1, 0.1)), 0.02)
    view = sky_view(
        block.mesh.triangles,
        position=block.fragment_position,
        normal=block.fragment_normal,
        pitch=0.02,
    )
    assert_allclose(view.sky, unobstructed_view(block.fragment_normal).sky, atol=0)
    assert_allclose(view.sky + view.ground, 1.0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.slice
def test_two_cubes_against_closed_form_and_exchange():
    cube = voxelize(box((1.0, 1.0, 1.0)), 0.05)
    apart = 1.5
    neighbour = cube.mesh.triangles + np.array([apart, 0.0, 0.0])
    triangles = np.concatenate([cube.mesh.triangles, neighbour])
    position = cube.fragment_position
    normal = cube.fragment_normal
    area = cube.fragment_area
    view = sky_view(triangles, position=position, normal=normal, pitch=0.05)
    seen = view.sky + view.ground
    facing = normal[:, 0] > 0.9
    exact = 1 - parallel_rectangles(1.0, 1.0, apart - 1.0)
    assert seen[facing] @ area[facing] == pytest.approx(exact, abs=0.01)
    assert seen[~facing].min() == 1.0
    first = in_patches(cube, 60)
    second = in_patches(cube, 60, moved(apart, 0.0, 0.0))
    exchange = view_factors((first, second), directions=32, lines=48)
    patches = first.patches
    by_patch = np.bincount(patches.patch, area * seen) / patches.area
    assert_allclose(by_patch, exchange.to_surroundings[: patches.count], atol=0.03)
    total = exchange.outside[: patches.count].sum()
    assert total == pytest.approx(6.0 - (1.0 - exact), rel=4e-3)


@pytest.fixture(scope="module")
def block():
    return voxelize(box((0.2, 0.1, 0.1)), 0.02)


def fluxes(term, surface):
    """Net heat flux into every fragment at 320 K [W/m^2]."""
    bindings = term.bind(whole(surface, reference=320.0))
    return sum(heat_into(binding) for binding in bindings) / surface.area


def test_sky_and_ground_each_with_its_temperature(block):
    surface = surface_of(block, emissivity=0.7)
    flux = fluxes(Surroundings(250.0, ground=300.0), surface)
    up = (1 + block.fragment_normal[:, 2]) / 2
    exact = up * 250.0**4 + (1 - up) * 300.0**4 - 320.0**4
    assert_allclose(flux, 0.7 * STEFAN_BOLTZMANN * exact, rtol=1e-12)
    same = fluxes(Surroundings(300.0, ground=300.0), surface)
    plain = fluxes(Surroundings(300.0), surface)
    assert_allclose(same, plain, rtol=1e-12)


def test_what_is_hidden_neither_gives_nor_takes(block):
    roof = box((1.0, 1.0, 0.1)).triangles + np.array([0.0, 0.0, 0.2])
    surface = surface_of(block, obstacles=[roof])
    shaded = fluxes(Surroundings(280.0, occlusion=64), surface)
    free = fluxes(Surroundings(280.0), surface)
    top = block.fragment_normal[:, 2] > 0.9
    share = shaded / free
    assert share[top].max() < 0.45 and share.max() <= 1.0
    bottom = block.fragment_normal[:, 2] < -0.9
    assert_allclose(share[bottom], 1.0, rtol=1e-12)
    split = fluxes(Surroundings(280.0, ground=280.0, occlusion=64), surface)
    assert_allclose(split, shaded, rtol=1e-12)


def test_a_sealed_body_has_no_surroundings():
    inner = voxelize(sphere(0.05, 2), 0.01)
    surface = surface_of(inner, obstacles=[shell(0.1, 0.12, 2).triangles])
    (result,) = Surroundings(300.0, occlusion=32).bind(whole(surface))
    assert isinstance(result, Omitted) and "sees" in result.reason


@pytest.mark.parametrize("directions", [0, 7, -3])
def test_too_few_directions_are_refused(directions):
    with pytest.raises(jt.InputError, match=f"occlusion={directions}: give 8"):
        Surroundings(300.0, occlusion=directions)


def test_temperatures_are_checked():
    with pytest.raises(jt.InputError, match="ground"):
        Surroundings(300.0, ground=-1.0)


def test_directions_at_once_see_what_each_of_them_sees(monkeypatch):
    grid = voxelize(box((0.3, 0.2, 0.1)), pitch=0.05)
    position = grid.fragment_position + np.array([0.0, 0.0, 0.3])
    obstacle = box((0.4, 0.1, 0.2)).triangles

    def free_lines():
        return lines_to_surroundings.__wrapped__(
            obstacle, position, grid.fragment_normal, 0.05, 32
        )

    at_once = free_lines()
    monkeypatch.setattr(threads.os, "cpu_count", lambda: 1)
    assert_array_equal(at_once, free_lines())
    assert 0 < np.unpackbits(at_once, axis=0)[:16].mean() < 1
