"""View factors between voxelized bodies: closed forms, reciprocity, closure."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box, cylinder, sphere
from jaxthermo.physics.radiation.view_factors import (
    _balance,
    view_factors,
)
from jaxthermo.reference.view_factor import coaxial_discs, parallel_rectangles
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import in_patches, moved, shell


@pytest.fixture(scope="module")
def cube():
    return voxelize(box((1.0, 1.0, 1.0)), 0.1)


def check(views):
    """Reciprocity and closure of any view factors."""
    between = views.between.toarray()
    assert_array_equal(between, between.T)
    factor = views.factor.toarray()
    closed = factor.sum(1) + views.to_surroundings
    assert_allclose(closed, 1.0, rtol=0, atol=1e-12)
    assert views.to_surroundings.min() >= 0
    off = factor - np.diag(np.diag(factor))
    assert off.min() >= 0 and np.diag(factor).min() > -1e-9


@pytest.mark.parametrize(
    "gap",
    [
        0.1,
        pytest.param(0.5, marks=pytest.mark.slow),
        pytest.param(2.0, marks=pytest.mark.slow),
        pytest.param(10.0, marks=pytest.mark.slow),
    ],
)
def test_aligned_cubes_are_parallel_squares(cube, gap):
    """Only the squares that face each other see each other at all."""
    first = in_patches(cube, 60)
    second = in_patches(cube, 60, moved(1 + gap, 0, 0))
    views = view_factors((first, second), directions=48, lines=32)
    check(views)
    n = first.patches.count
    exact = parallel_rectangles(1.0, 1.0, gap)
    between = views.between[:n, n:].sum()
    assert between == pytest.approx(exact, rel=0.01)
    assert views.factor.diagonal().sum() == pytest.approx(0.0, abs=1e-10)


def test_turning_the_scene_changes_nothing_but_the_sampling(cube):
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    x, y, z = turn[:, 0]
    first = in_patches(cube, 60, moved(0, y=0, z=0, rotation=turn))
    second = in_patches(cube, 60, moved(1.5 * x, y=1.5 * y, z=1.5 * z, rotation=turn))
    views = view_factors((first, second), directions=48, lines=32)
    check(views)
    n = first.patches.count
    exact = parallel_rectangles(1.0, 1.0, 0.5)
    assert views.between[:n, n:].sum() == pytest.approx(exact, rel=0.01)


def test_what_stands_between_is_in_the_way(cube):
    wall = voxelize(box((0.1, 4.0, 4.0)), 0.1)
    first = in_patches(cube, 60)
    second = in_patches(cube, 60, moved(2.0, 0, 0))
    third = in_patches(wall, 60, moved(1.0, 0, 0))
    views = view_factors((first, second, third), directions=16, lines=32)
    check(views)
    n = first.patches.count
    assert views.between[:n, n : 2 * n].sum() == 0.0
    assert views.between[:n, 2 * n :].sum() > 0.9


def test_ball_in_a_hollow_ball():
    inner = in_patches(voxelize(sphere(0.05, 3), 0.005), 60)
    outer = in_patches(voxelize(shell(0.1, 0.12), 0.006), 120)
    views = view_factors((inner, outer), directions=32, lines=64)
    check(views)
    n = inner.patches.count
    cavity = np.zeros(len(views.area), bool)
    cavity[n:] = np.linalg.norm(outer.patches.centre, axis=1) < 0.11
    # Sealed: not a ray finds its way out, and the scaling must not make one.
    assert views.outside[:n].sum() == 0.0 and views.outside[cavity].sum() == 0.0
    assert_allclose(views.factor[:n, n:].sum(1), 1.0, atol=1e-12)
    wall = views.area[cavity]
    self_factor = views.between[np.ix_(cavity, cavity)].sum() / wall.sum()
    assert self_factor == pytest.approx(1 - 0.05**2 / 0.1**2, abs=0.01)
    outside = views.outside[n:][~cavity[n:]]
    assert_allclose(outside, views.area[n:][~cavity[n:]], rtol=1e-10)


def test_one_body_alone_sees_the_surroundings(cube):
    views = view_factors((in_patches(cube, 60),), directions=16, lines=48)
    check(views)
    assert_allclose(views.to_surroundings, 1.0, atol=1e-12)


def test_balancing_restores_what_was_scaled():
    random = np.random.default_rng(2)
    exact = random.uniform(size=(9, 9)) * (random.uniform(size=(9, 9)) < 0.5)
    exact = exact + exact.T
    outside = random.uniform(size=9)
    area = exact.sum(1) + outside
    same = _balance(csr_array(exact), outside, area)
    assert_allclose(same.between.toarray(), exact, atol=1e-12)
    noise = random.uniform(0.95, 1.05, (9, 9))
    scaled = csr_array(exact * (noise + noise.T) / 2)
    noisy = _balance(scaled, outside * 1.03, area)
    check(noisy)
    between = noisy.between.toarray()
    assert_allclose(between, exact, atol=0.06)
    apart = ~np.eye(9, dtype=bool)
    assert_array_equal((between == 0)[apart], (exact == 0)[apart])


def test_a_patch_that_no_line_meets_sees_the_surroundings():
    lonely = _balance(csr_array((2, 2)), np.array([1.0, 0.0]), np.ones(2))
    assert_allclose(lonely.to_surroundings, 1.0)


@pytest.mark.parametrize("how", [{"directions": 4}, {"lines": 2}])
def test_too_coarse_is_refused(cube, how):
    with pytest.raises(InputError, match="give 8 or more"):
        view_factors((in_patches(cube, 60),), **how)


class Pair(NamedTuple):
    """Two bodies, the place of the second, and A_1 F_12 in closed form."""

    first: VoxelGrid
    second: VoxelGrid
    offset: tuple[float, float, float]
    exact: float


def squares(pitch, surface_cells):
    cube = voxelize(box((1.0, 1.0, 1.0)), pitch, surface_cells)
    exact = parallel_rectangles(1.0, 1.0, 0.5)
    return Pair(cube, cube, offset=(1.5, 0, 0), exact=exact)


def discs(pitch, surface_cells):
    disc = voxelize(cylinder(1.0, 0.5, sections=128), pitch, surface_cells)
    exact = np.pi * coaxial_discs(1.0, 1.0, 1.0)
    return Pair(disc, disc, offset=(0, 0, 1.5), exact=exact)


def ball_over_a_disc(pitch, surface_cells):
    """F = (1 - 1 / sqrt(1 + (R / H)^2)) / 2."""
    ball = voxelize(sphere(1.0, 5), pitch, surface_cells)
    disc = voxelize(cylinder(2.0, 0.5, sections=128), 1.9 * pitch, surface_cells)
    factor = (1 - 1 / np.hypot(1, 2.0 / 1.8)) / 2
    return Pair(ball, disc, offset=(0, 0, -2.05), exact=4 * np.pi * factor)


@pytest.mark.slow
@pytest.mark.parametrize("surface_cells", ["crossings", "dominant_axis"])
@pytest.mark.parametrize("cells", [8.3, 14.6])
@pytest.mark.parametrize("bodies", [squares, discs, ball_over_a_disc])
def test_closed_forms_do_not_depend_on_the_surface_cells(bodies, cells, surface_cells):
    """Lines meet the mesh, whatever its cells: A_1 F_12 within 0.2 % at odd pitches."""
    pair = bodies(1 / cells, surface_cells)
    first = in_patches(pair.first, 100)
    second = in_patches(pair.second, 100, moved(*pair.offset))
    views = view_factors((first, second), directions=48, lines=48)
    check(views)
    n = first.patches.count
    assert views.between[:n, n:].sum() == pytest.approx(pair.exact, rel=2e-3)
