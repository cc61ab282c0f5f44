"""Octree cells: cover the body once, lie well inside it, and differ by one level."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from simple_octree import build_octree, octree_cells
from voxel_volumes import assert_links, ball, solids

from jaxthermo.geometry import shapes
from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import Octree
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import blocks


def levels_of(solid, levels=None):
    """Level of every voxel's cell, -1 where empty, as its number of voxels tells."""
    first = octree_cells(solid, levels)
    _, cell, count = np.unique(first, return_inverse=True, return_counts=True)
    level = np.rint(np.log2(count) / 3).astype(int)[cell].reshape(solid.shape)
    return np.where(solid, level, -1)


def level_by_definition(solid, cell):
    """The largest cell that is solid with the 26 around it and holds a voxel."""
    level = 0
    while True:
        size = 2 << level
        low = (np.array(cell) // size - 1) * size
        high = low + 3 * size
        if (low < 0).any() or (high > solid.shape).any():
            return level
        if not solid[tuple(slice(i, j) for i, j in zip(low, high, strict=True))].all():
            return level
        level += 1


BODIES = {
    "ball": ball(14.6),
    "hollow ball": ball(12.7, 3.2),
    "box": np.ones((24, 13, 30), bool),
    "box with holes": np.random.default_rng(1).random((25, 26, 27)) < 0.9995,
}


@pytest.mark.parametrize("name", BODIES)
def test_cells_are_the_largest_that_lie_well_inside(name):
    solid = BODIES[name]
    level = levels_of(solid)
    assert level.max() >= 1
    some = np.argwhere(solid)[:: max(solid.sum() // 600, 1)]
    for cell in some:
        assert level[tuple(cell)] == level_by_definition(solid, cell)


@pytest.mark.parametrize("name", BODIES)
def test_cells_are_whole_cubes_on_their_own_lattice(name):
    solid = BODIES[name]
    first = octree_cells(solid, None)
    level = levels_of(solid)
    np.testing.assert_array_equal(first < 0, ~solid)
    cells = np.argwhere(solid)
    corner = (cells >> level[solid][:, None]) << level[solid][:, None]
    np.testing.assert_array_equal(
        first[solid], np.ravel_multi_index(tuple(corner.T), solid.shape)
    )


@pytest.mark.parametrize("name", BODIES)
def test_neighbours_differ_by_one_level_even_over_corners(name):
    solid = BODIES[name]
    level = np.pad(levels_of(solid), 1, constant_values=-1)
    for step in product((-1, 0, 1), repeat=3):
        neighbour = np.roll(level, step, (0, 1, 2))
        are_solid = (level >= 0) & (neighbour >= 0)
        assert np.abs(level - neighbour)[are_solid].max() <= 1
        # And a coarse cell never lies at the surface.
        assert level[(level >= 0) & (neighbour < 0)].max(initial=0) == 0


def gap_in_ball():
    """Cut voxels, and cells of no face inside: a gap thinner than a voxel."""
    gap = shapes.box((1.2, 1.2, 0.02))
    ball = shapes.sphere(1.0)
    faces = np.concatenate([ball.faces, gap.faces[:, ::-1] + len(ball.vertices)])
    mesh = Mesh(np.concatenate([ball.vertices, gap.vertices]), faces, "gap in ball")
    return voxelize(mesh, 1 / 12.3)


@pytest.mark.parametrize("levels", [1, 2, None])
@pytest.mark.parametrize("name", [*BODIES, "gap in a ball"])
def test_cubes_are_the_groups_of_their_voxels(name, levels):
    """Level by level, as by the faces of all voxels: integers equal, numbers nearly."""
    grid = blocks(BODIES[name], 0.5) if name in BODIES else gap_in_ball()
    built = Octree(grid, levels=levels).built
    expected_built, level = build_octree(grid, levels)
    np.testing.assert_array_equal(built.nodes.level, level)
    for field in ("centre", "volume", "location"):
        actual = getattr(built.nodes, field)
        expected = getattr(expected_built.nodes, field)
        np.testing.assert_allclose(actual, expected, rtol=1e-13)
    for field in ("src", "dst"):
        actual = getattr(built.links, field)
        expected = getattr(expected_built.links, field)
        np.testing.assert_array_equal(actual, expected)
    for actual, expected in zip(built.links[2:], expected_built.links[2:], strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-12)
    np.testing.assert_array_equal(built.fragment_node, expected_built.fragment_node)
    np.testing.assert_array_equal(built.voxel_node, expected_built.voxel_node)


@settings(deadline=None, max_examples=20)
@given(solids(6))
def test_small_bodies_keep_their_volume(solid):
    structure = Octree(blocks(solid, 0.5))
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-14)
    assert (structure.links().area > 0).all()


def test_volume_level_and_place_of_nodes():
    grid = blocks(BODIES["ball"], 0.5)
    structure = Octree(grid)
    nodes = structure.nodes()
    np.testing.assert_allclose(nodes.volume, (0.5 * 2.0**nodes.level) ** 3)
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-14)
    moment = nodes.volume @ nodes.centre / nodes.volume.sum()
    expected = grid.lattice.centres(np.argwhere(grid.solid)).mean(0)
    np.testing.assert_allclose(moment, expected)
    assert structure.node_count < 0.7 * grid.solid_count


def test_a_coarse_cell_shares_its_whole_surface():
    """Flat faces: the areas of a cell's links add up to 6 (2^l h)^2."""
    structure = Octree(blocks(BODIES["hollow ball"]))
    nodes = structure.nodes()
    links = structure.links()
    shared = np.bincount(links.src, links.area, len(nodes.level))
    shared += np.bincount(links.dst, links.area, len(nodes.level))
    coarse = nodes.level > 0
    np.testing.assert_allclose(shared[coarse], 6 * 4.0 ** nodes.level[coarse])
    assert (shared[~coarse] <= 6).all()


def test_every_fragment_lies_on_a_single_voxel():
    grid = blocks(BODIES["hollow ball"])
    structure = Octree(grid)
    assert (structure.nodes().level[structure.fragment_node()] == 0).all()
    np.testing.assert_allclose(structure.fragment_offset(), 0, atol=1e-12)


def test_one_level_is_the_full_volume():
    grid = blocks(BODIES["ball"], 0.5)
    structure = Octree(grid, levels=1)
    full = FullVolume(grid)
    assert_links(structure, full, rtol=1e-14)


def test_levels_limit_the_cells():
    grid = blocks(BODIES["ball"])
    for levels in (1, 2, 3):
        assert Octree(grid, levels=levels).nodes().level.max() == levels - 1
    assert Octree(grid, levels=99).node_count == Octree(grid).node_count


@pytest.mark.slow
def test_a_statue_needs_two_fifths_of_its_voxels(real_mesh):
    mesh = load_mesh(real_mesh("happy-buddha.obj"), height=0.5, up="y")
    grid = voxelize(mesh, 0.5 / 250)
    assert Octree(grid).node_count < 0.45 * grid.solid_count
