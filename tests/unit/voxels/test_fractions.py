"""Volumes and areas within a selection are those of the body in it, to 1 %."""

import importlib.util

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from typing_extensions import override

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.voxels.fractions import area_fractions, volume_fractions
from jaxthermo.voxels.fragment_mask import FragmentMask
from jaxthermo.voxels.selection import (
    AbstractSpace,
    Everything,
    Region,
    Side,
)
from jaxthermo.voxels.voxelize import voxelize


SURFACES = ("crossings", "dominant_axis")
BODIES = {
    "box": shapes.box((1.0, 0.8, 0.6)),
    "ball": shapes.sphere(0.5),
    "cylinder": shapes.cylinder(0.4, 0.9),
}


class Ball(AbstractSpace):
    """A ball about the origin, as a user may write one."""

    @property
    @override
    def bodies(self):
        return (0,)

    @override
    def on_body(self, body):
        return self if body == 0 else None

    @override
    def contains(self, points):
        return np.linalg.norm(points, axis=1) < 0.37


def volume_within(space, grid):
    volume = grid.volume_at(np.argwhere(grid.solid))
    return float(volume_fractions(space, grid) @ volume)


def area_within(selection, grid):
    return float(area_fractions(selection, grid) @ grid.fragment_area)


def turned(mesh, rng):
    turn = Rotation.from_quat(rng.normal(size=4))
    return Mesh(turn.apply(mesh.vertices), mesh.faces, mesh.name)


@pytest.mark.skipif(
    importlib.util.find_spec("manifold3d") is None, reason="the extra is not installed"
)
@pytest.mark.parametrize("name", BODIES)
def test_a_box_within_a_turned_body(name):
    """The truth is the intersection by manifold3d."""
    rng = np.random.default_rng(len(name))
    for _ in range(4):
        mesh = turned(BODIES[name], rng)
        lower = rng.uniform(-0.4, -0.1, 3)
        upper = lower + rng.uniform(0.3, 0.6, 3)
        region = Region(tuple(lower), tuple(upper))
        rest = shapes.difference(
            mesh, shapes.box(tuple(upper - lower)).moved((lower + upper) / 2)
        )
        pitch = rng.uniform(0.03, 0.05)
        exact = mesh.volume - rest.volume
        for surface_cells in SURFACES:
            grid = voxelize(mesh, pitch, surface_cells)
            assert volume_within(region, grid) == pytest.approx(exact, rel=0.01)
        # What the box cuts off has the surface in it, and what is left the cut faces.
        centres = rest.triangles.mean(axis=1)
        on_cut = (np.abs(centres - lower) < 1e-6).any(1)
        on_cut |= (np.abs(centres - upper) < 1e-6).any(1)
        left = np.linalg.norm(rest.area_vectors, axis=1)[~on_cut].sum()
        exact = mesh.area - left
        for surface_cells in SURFACES:
            grid = voxelize(mesh, pitch, surface_cells)
            area = area_within(region, grid)
            assert area == pytest.approx(exact, rel=0.01, abs=1e-6)


@pytest.mark.parametrize("pitch", [0.1, 0.087])
def test_a_box_along_the_lattice_is_exact(pitch):
    grid = voxelize(BODIES["box"], pitch)
    region = Region((-0.123, -0.3, -0.7), (0.456, 0.25, 0.21))
    assert volume_within(region, grid) == pytest.approx(0.579 * 0.55 * 0.51, rel=1e-6)
    # Its bottom alone is surface of the body.
    assert area_within(region, grid) == pytest.approx(0.579 * 0.55, rel=5e-3)


@pytest.mark.parametrize("pitch", [0.1, 0.087])
def test_a_box_in_whole_voxels_is_exact(pitch):
    """Also where it ends between two planes of voxels, so that it divides none."""
    grid = voxelize(BODIES["box"], pitch, "dominant_axis")
    for upper, exact in ((0.456, 0.579 * 0.55 * 0.51), (2.0, 0.623 * 0.55 * 0.51)):
        region = Region((-0.123, -0.3, -0.7), (upper, 0.25, 0.21))
        assert volume_within(region, grid) == pytest.approx(exact, rel=1e-6)
    plane = float(grid.origin[0]) + 3 * pitch
    front = Region((plane, -1.0, -1.0), (1.0, 1.0, 1.0))
    exact = (0.5 - plane) * 0.8 * 0.6
    assert volume_within(front, grid) == pytest.approx(exact, rel=1e-6)


def test_the_whole_of_a_body_has_its_volume_in_whole_voxels():
    mesh = turned(BODIES["cylinder"], np.random.default_rng(3))
    grid = voxelize(mesh, 0.07, "dominant_axis")
    around = Region((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
    for space in (Everything(), around):
        assert_allclose(volume_fractions(space, grid), 1, rtol=1e-12)
    half = Region((-2.0, -2.0, -2.0), (0.1, 2.0, 2.0))
    both = volume_within(half, grid) + volume_within(~half, grid)
    assert both == pytest.approx(mesh.volume, rel=1e-9)


def test_a_region_smaller_than_a_voxel_has_its_volume():
    grid = voxelize(BODIES["box"], 0.1)
    region = Region((0.01, 0.01, 0.01), (0.04, 0.03, 0.02))
    assert volume_within(region, grid) == pytest.approx(6e-6, rel=1e-9)
    spot = Region((0.01, 0.01, 0.29), (0.04, 0.03, 0.31))
    assert area_within(spot, grid) == pytest.approx(6e-4, rel=0.05)


def test_a_space_of_a_user_is_sampled():
    grid = voxelize(BODIES["box"], 0.04)
    # A ball of 0.37 m without two caps of 0.07 m.
    caps = 2 * np.pi * 0.07**2 * (0.37 - 0.07 / 3)
    exact = 4 / 3 * np.pi * 0.37**3 - caps
    assert volume_within(Ball(), grid) == pytest.approx(exact, rel=0.01)
    discs = 2 * np.pi * (0.37**2 - 0.3**2)
    assert area_within(Ball(), grid) == pytest.approx(discs, rel=0.01)


def test_parts_of_a_body_add_up_to_it():
    grid = voxelize(turned(BODIES["cylinder"], np.random.default_rng(1)), 0.06)
    one = Region((-0.2, -1.0, -1.0), (0.13, 1.0, 1.0))
    other = Region((0.13, -1.0, -1.0), (1.0, 0.07, 1.0))
    for selection in (one, one | other, one & ~other, ~other):
        assert_allclose(
            volume_fractions(selection, grid) + volume_fractions(~selection, grid),
            np.ones(grid.solid_count),
            atol=1e-12,
        )
        assert_allclose(
            area_fractions(selection, grid) + area_fractions(~selection, grid),
            np.ones(len(grid.fragment_area)),
            atol=1e-12,
        )
    sum_of_both = volume_within(one, grid) + volume_within(other, grid)
    assert volume_within(one | other, grid) == pytest.approx(sum_of_both, rel=2e-3)


def test_what_depends_on_the_normal_or_the_fragment_selects_whole_fragments():
    grid = voxelize(BODIES["box"], 0.07)
    top = Side((0.0, 0.0, 1.0))
    assert set(area_fractions(top, grid)) == {0.0, 1.0}
    half = Region((0.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    assert area_within(top & half, grid) == pytest.approx(0.5 * 0.8, rel=2e-3)
    mask = FragmentMask(grid.fragment_normal[:, 2] > 0.5)
    assert area_within(mask & half, grid) == pytest.approx(0.5 * 0.8, rel=0.02)
    assert area_within(Everything(), grid) == pytest.approx(grid.fragment_area.sum())
    assert volume_within(Everything(), grid) == pytest.approx(grid.body_volume)


@pytest.mark.parametrize("offset", [-1e-9, 0.0, 1e-9])
def test_a_region_that_ends_at_a_face_has_that_face(offset):
    grid = voxelize(BODIES["box"], 0.07)
    inside = Region((-1.0, -1.0, 0.25), (1.0, 1.0, 0.3 + offset))
    outside = Region((-1.0, -1.0, 0.3 + offset), (1.0, 1.0, 0.4))
    top = grid.fragment_normal[:, 2] > 0.5
    assert (area_fractions(inside, grid)[top] == 1).all()
    assert (area_fractions(outside, grid)[top] == 1).all()
    assert not area_fractions(outside, grid)[~top].any()
