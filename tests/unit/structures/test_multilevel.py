"""Layers of voxels: depth, links, and what becomes of the hollow."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_volumes import ball, solids

from jaxthermo.errors import InputError
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import MultiLevel
from jaxthermo.structures.partition.blocks import voxel_layers
from tests.bodies import blocks


def steps_to_the_outside(solid):
    """Fewest face steps from each solid voxel to an empty one, less one; else -1."""
    empty = np.argwhere(~np.pad(solid, 1)) - 1
    depth = np.full(solid.shape, -1)
    for cell in np.argwhere(solid):
        depth[tuple(cell)] = np.abs(empty - cell).sum(1).min() - 1
    return depth


@settings(deadline=None, max_examples=30)
@given(solids(7), st.integers(1, 5))
def test_layers_count_the_steps_to_the_outside(solid, levels):
    depth = steps_to_the_outside(solid)
    expected = np.where(depth < levels, depth, -1)
    np.testing.assert_array_equal(voxel_layers(blocks(solid), levels), expected)


def test_a_voxel_with_a_fragment_is_at_the_surface():
    grid = blocks(np.ones((7, 7, 7), bool))
    deep = grid.fragment_voxel.copy()
    deep[0] = 3
    layer = voxel_layers(replace(grid, fragment_voxel=deep), 1)
    assert layer[3, 3, 3] == 0
    structure = MultiLevel(replace(grid, fragment_voxel=deep), 1)
    assert structure.nodes().level[structure.fragment_node()].max() == 0
    assert structure.node_count == 7**3 - 5**3 + 1


@settings(deadline=None, max_examples=15)
@given(solids(6), st.sampled_from(["empty", "innermost"]))
def test_all_levels_are_the_full_volume(solid, hollow):
    grid = blocks(solid, 0.5)
    full = FullVolume(grid)
    structure = MultiLevel(grid, levels=50, hollow=hollow)
    for actual, expected in zip(structure.links(), full.links(), strict=True):
        assert actual.dtype == expected.dtype
        np.testing.assert_array_equal(actual, expected)
    np.testing.assert_allclose(structure.nodes().centre, full.nodes().centre)
    np.testing.assert_allclose(structure.nodes().volume, full.nodes().volume)
    np.testing.assert_array_equal(structure.fragment_node(), full.fragment_node())


@settings(deadline=None, max_examples=20)
@given(solids(7), st.integers(1, 4))
def test_innermost_level_carries_the_hollow(solid, levels):
    grid = blocks(solid, 0.5)
    structure = MultiLevel(grid, levels, "innermost")
    nodes = structure.nodes()
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-13)
    inner = nodes.level == nodes.level.max()
    np.testing.assert_allclose(nodes.volume[~inner], 0.5**3)
    assert np.ptp(nodes.volume[inner]) == 0


def test_an_empty_hollow_is_left_out():
    """A cube of 9^3 voxels with two layers: 9^3 - 5^3 are kept."""
    structure = MultiLevel(blocks(np.ones((9, 9, 9), bool)), levels=2)
    node_count = 9**3 - 5**3
    assert structure.node_count == node_count
    assert structure.capacity_ratio == pytest.approx(node_count / 9**3)
    counts = np.bincount(structure.nodes().level)
    np.testing.assert_array_equal(counts, [9**3 - 7**3, 7**3 - 5**3])


def test_links_join_a_level_to_itself_and_the_next():
    structure = MultiLevel(blocks(ball(8.4), 0.5), levels=4)
    nodes = structure.nodes()
    links = structure.links()
    step = np.abs(nodes.level[links.src] - nodes.level[links.dst])
    assert set(step) == {0, 1}
    apart = np.linalg.norm(nodes.centre[links.src] - nodes.centre[links.dst], axis=1)
    np.testing.assert_allclose(apart, 0.5)
    np.testing.assert_allclose(links.distance_src + links.distance_dst, 0.5)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 9), (2, 2, 9)])
def test_bodies_without_an_inside_have_one_level(shape):
    structure = MultiLevel(blocks(np.ones(shape, bool)), hollow="innermost")
    assert structure.node_count == np.prod(shape)
    assert structure.nodes().level.max() == 0
    assert structure.capacity_ratio == 1


def test_an_unknown_hollow_is_refused():
    with pytest.raises(InputError, match='hollow=\'full\'.*"empty" or "innermost"'):
        MultiLevel(blocks(np.ones((2, 2, 2), bool)), hollow="full")  # type: ignore
