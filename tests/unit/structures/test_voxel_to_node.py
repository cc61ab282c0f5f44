"""Whose each voxel is, and which way links cross: in every structure."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.structures.partition.assignment import volume_within, voxel_owner
from jaxthermo.structures.partition.links import link_axes
from tests.bodies import blocks


PITCH = 0.01


@pytest.fixture(scope="module")
def grid():
    """A block of 12 x 10 x 11 voxels with a notch."""
    solid = np.ones((12, 10, 11), bool)
    solid[8:, 6:, :3] = False
    return blocks(solid, PITCH)


def _structures(grid):
    quarter = np.arange(grid.solid.size).reshape(grid.solid.shape) // 330
    return {
        "full": jt.FullVolume(grid),
        "links": jt.FullVolume(grid, stencil=False),
        "shell": jt.SingleShell(grid),
        "multi": jt.MultiLevel(grid, levels=2),
        "irregular": jt.IrregularMultiLevel(grid),
        "octree": jt.Octree(grid),
        "aggregate": jt.Aggregate(grid, factor=3),
        "core": jt.ShellOverCore(grid),
        "partition": jt.Partition(grid, quarter),
    }


KINDS = list(_structures(blocks(np.ones((6, 6, 6), bool), PITCH)))


@pytest.mark.parametrize("name", KINDS)
def test_every_voxel_goes_to_a_node(grid, name):
    structure = _structures(grid)[name]
    node = structure.voxel_node()
    owner = voxel_owner(structure)
    assert node.dtype == owner.dtype == np.int32
    assert len(node) == grid.solid_count
    assert set(owner) == set(range(structure.node_count))
    np.testing.assert_array_equal(owner[node >= 0], node[node >= 0])
    assert (node < 0).any() == (name in ("shell", "multi"))
    volume = volume_within(structure, np.ones(grid.solid_count))
    body = grid.solid_count * grid.voxel_volume
    assert volume.sum() == pytest.approx(body, rel=1e-13)
    if name not in ("shell", "multi", "irregular"):
        np.testing.assert_allclose(volume, structure.nodes().volume, rtol=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_fragments_lie_on_their_voxels_node(grid, name):
    structure = _structures(grid)[name]
    node = np.full(grid.solid.shape, -1)
    node[grid.solid] = structure.voxel_node()
    np.testing.assert_array_equal(
        node[tuple(grid.fragment_voxel.T)], structure.fragment_node()
    )


@pytest.mark.parametrize("name", ["shell", "multi"])
def test_the_inside_goes_to_the_nearest_nodes(grid, name):
    structure = _structures(grid)[name]
    centre = grid.lattice.centres(np.argwhere(grid.solid))
    inside = structure.voxel_node() < 0
    nodes = structure.nodes().centre
    way = np.abs(nodes[voxel_owner(structure)[inside]] - centre[inside]).sum(axis=1)
    straight = np.abs(nodes[None] - centre[inside][:, None]).sum(axis=2).min(axis=1)
    # Steps through the body are at least the straight way along the axes.
    assert (way >= straight - 1e-12).all()
    assert way.max() < 6 * PITCH


@pytest.mark.parametrize("name", KINDS)
def test_link_axes_are_squared_directions(grid, name):
    structure = _structures(grid)[name]
    axes = link_axes(structure)
    assert axes.shape == (structure.link_count, 3)
    assert (axes >= 0).all()
    np.testing.assert_allclose(axes.sum(axis=1), 1.0, rtol=1e-14)


@pytest.mark.parametrize("name", ["links", "multi", "octree"])
def test_faces_of_cubes_lie_across_one_axis(grid, name):
    """Even where coarse meets fine, and the centres are apart sideways."""
    structure = _structures(grid)[name]
    links = structure.links()
    centre = structure.nodes().centre
    axes = link_axes(structure)
    assert set(np.unique(axes)) == {0.0, 1.0}
    apart = np.abs(centre[links.dst] - centre[links.src])
    np.testing.assert_array_equal(axes.argmax(axis=1), apart.argmax(axis=1))
    if name == "octree":
        assert (np.sort(apart, axis=1)[:, 1] > 0.1 * PITCH).any()


def test_a_shell_has_diagonal_links(grid):
    axes = link_axes(_structures(grid)["shell"])
    directions = {tuple(np.round(np.sort(row), 6)) for row in axes}
    third = round(1 / 3, 6)
    assert directions == {(0, 0, 1), (0, 0.5, 0.5), (third, third, third)}


def test_a_staircase_has_the_direction_of_its_normal():
    """Two halves of a plate, parted along a diagonal staircase: half x, half y."""
    grid = blocks(np.ones((8, 8, 2), bool), PITCH)
    x, y, _ = np.indices(grid.solid.shape)
    structure = jt.Partition(grid, (x + y > 7).astype(int))
    np.testing.assert_allclose(link_axes(structure), [[0.5, 0.5, 0.0]], rtol=1e-14)


def test_an_island_of_no_node_keeps_none():
    solid = np.ones((7, 2, 2), bool)
    solid[3] = False
    grid = blocks(solid, PITCH)
    structure = jt.FullVolume(grid)
    node = structure.voxel_node().copy()
    node[node >= 12] = -1

    class Partly(jt.FullVolume):
        def voxel_node(self):
            return node

    owner = voxel_owner(Partly(grid))
    np.testing.assert_array_equal(owner, np.r_[np.arange(12), np.full(12, -1)])


def test_one_voxel_has_no_links():
    structure = jt.FullVolume(blocks(np.ones((1, 1, 1), bool), PITCH))
    assert link_axes(structure).shape == (0, 3)
    assert voxel_owner(structure).tolist() == [0]
