"""Slivers are held to a time constant; nothing else is touched."""

from functools import partial

import numpy as np
import pytest
from voxel_volumes import conductance_sums

import jaxthermo as jt
from tests.bodies import blocks


PITCH = 0.01


def _time_constants(structure):
    """V / sum A / L of every node that has links [m^2]."""
    volume = structure.nodes().volume
    total = conductance_sums(structure)
    return volume[total > 0] / total[total > 0]


@pytest.fixture(scope="module")
def grid():
    """A ball: blocks at its surface are cut at random."""
    cell = np.indices((23, 23, 23)) - 11
    return blocks((cell**2).sum(axis=0) < 118, PITCH)


@pytest.mark.parametrize("minimum", [0.4, 0.45, 1.0])
def test_no_node_is_below_the_least(grid, minimum):
    aggregate = partial(jt.Aggregate, grid, factor=4, alignment=0.0)
    free = aggregate(min_time_constant=0.0)
    held = aggregate(min_time_constant=minimum)
    block_constant = (4 * PITCH) ** 2 / 6
    assert _time_constants(free).min() < 0.39 * block_constant
    assert _time_constants(held).min() >= minimum * block_constant * (1 - 1e-12)
    np.testing.assert_array_equal(free.nodes().volume, held.nodes().volume)
    np.testing.assert_array_equal(free.links().area, held.links().area)
    assert (held.links().distance_src >= free.links().distance_src).all()


def test_nodes_that_are_slow_enough_keep_their_links(grid):
    free = jt.Aggregate(grid, factor=4, min_time_constant=0.0)
    held = jt.Aggregate(grid, factor=4, min_time_constant=0.5)
    links = free.links()
    volume = free.nodes().volume
    total = conductance_sums(free)
    slow = volume > total * 0.5 * (4 * PITCH) ** 2 / 6
    slow_ends = slow[links.src] & slow[links.dst]
    assert 0 < slow_ends.sum() < len(slow_ends)
    np.testing.assert_array_equal(
        links.distance_src[slow_ends], held.links().distance_src[slow_ends]
    )


def test_whole_blocks_are_never_touched():
    grid = blocks(np.ones((8, 8, 8), bool), PITCH)
    free = jt.Aggregate(grid, factor=2, min_time_constant=0.0)
    held = jt.Aggregate(grid, factor=2, min_time_constant=1.0)
    np.testing.assert_array_equal(free.links().distance_src, held.links().distance_src)


@pytest.mark.parametrize("minimum", [-0.1, 1.5, float("nan")])
def test_what_is_no_share_is_told(grid, minimum):
    with pytest.raises(jt.InputError, match="from 0 to 1"):
        jt.Aggregate(grid, min_time_constant=minimum)


def test_a_factor_beyond_any_body_is_one_block():
    grid = blocks(np.ones((3, 2, 2), bool), PITCH)
    assert jt.Aggregate(grid, factor=10**23).node_count == 1
