"""Slivers are held to a time constant; nothing else is touched."""

from functools import partial

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks


PITCH = 0.01


def _time_constants(structure):
    """V / sum A / L of every node that has links [m^2]."""
    links, volume = structure.links(), structure.nodes().volume
    conductance = links.area / (links.distance_src + links.distance_dst)
    total = np.bincount(links.src, conductance, len(volume))
    total += np.bincount(links.dst, conductance, len(volume))
    return volume[total > 0] / total[total > 0]


@pytest.fixture(scope="module")
def grid():
    """A ball: blocks at its surface are cut at random."""
    cell = np.indices((23, 23, 23)) - 11
    return blocks((cell**2).sum(axis=0) < 118, PITCH)


@pytest.mark.parametrize("least", [0.4, 0.45, 1.0])
def test_no_node_is_below_the_least(grid, least):
    kind = partial(jt.Aggregate, grid, factor=4, alignment=0.0)
    free, held = kind(min_time_constant=0.0), kind(min_time_constant=least)
    whole = (4 * PITCH) ** 2 / 6
    assert _time_constants(free).min() < 0.39 * whole
    assert _time_constants(held).min() >= least * whole * (1 - 1e-12)
    np.testing.assert_array_equal(free.nodes().volume, held.nodes().volume)
    np.testing.assert_array_equal(free.links().area, held.links().area)
    assert (held.links().distance_src >= free.links().distance_src).all()


def test_nodes_that_are_slow_enough_keep_their_links(grid):
    free = jt.Aggregate(grid, factor=4, min_time_constant=0.0)
    held = jt.Aggregate(grid, factor=4, min_time_constant=0.5)
    links, volume = free.links(), free.nodes().volume
    conductance = links.area / (links.distance_src + links.distance_dst)
    total = np.bincount(links.src, conductance, len(volume))
    total += np.bincount(links.dst, conductance, len(volume))
    slow = volume > total * 0.5 * (4 * PITCH) ** 2 / 6
    both = slow[links.src] & slow[links.dst]
    assert 0 < both.sum() < len(both)
    np.testing.assert_array_equal(
        links.distance_src[both], held.links().distance_src[both]
    )


def test_whole_blocks_are_never_touched():
    grid = blocks(np.ones((8, 8, 8), bool), PITCH)
    free = jt.Aggregate(grid, factor=2, min_time_constant=0.0)
    held = jt.Aggregate(grid, factor=2, min_time_constant=1.0)
    np.testing.assert_array_equal(free.links().distance_src, held.links().distance_src)


@pytest.mark.parametrize("least", [-0.1, 1.5, float("nan")])
def test_what_is_no_share_is_told(grid, least):
    with pytest.raises(jt.InputError, match="from 0 to 1"):
        jt.Aggregate(grid, min_time_constant=least)


def test_a_factor_beyond_any_body_is_one_block():
    grid = blocks(np.ones((3, 2, 2), bool), PITCH)
    assert jt.Aggregate(grid, factor=10**23).node_count == 1
