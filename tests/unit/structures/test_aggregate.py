"""Blocks of voxels: every part of a block is a node, as large as it is solid."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_volumes import assert_links, ball, parts_of, solids

from jaxthermo.errors import InputError
from jaxthermo.structures.kinds.aggregate import Aggregate
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.partition.blocks import block_parts, count_blocks
from jaxthermo.structures.partition.slabs import count_parts
from tests.bodies import blocks


def parts_by_definition(solid, factor):
    """First voxel of the part of its block that each voxel belongs to, by loops."""
    result = np.full(solid.shape, -1)
    cells = np.argwhere(solid)
    for block in np.unique(cells // factor, axis=0):
        inside = cells[(cells // factor == block).all(1)]
        for component in parts_of({tuple(cell) for cell in inside}, solid.shape):
            index = tuple(np.transpose(list(component)))
            result[index] = np.ravel_multi_index(index, solid.shape).min()
    return result


@settings(deadline=None, max_examples=40)
@given(solids(7), st.integers(1, 9))
def test_parts_are_those_of_a_flood_fill(solid, factor):
    expected = parts_by_definition(solid, factor)
    np.testing.assert_array_equal(block_parts(solid, factor), expected)


@settings(deadline=None, max_examples=25)
@given(solids(6), st.integers(1, 8))
def test_volume_is_kept_and_links_are_sound(solid, factor):
    grid = blocks(solid, 0.5)
    structure = Aggregate(grid, factor)
    nodes = structure.nodes()
    links = structure.links()
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-14)
    moment = nodes.volume @ nodes.centre / nodes.volume.sum()
    expected = grid.lattice.centres(np.argwhere(solid)).mean(0)
    np.testing.assert_allclose(moment, expected)
    assert (links.src < links.dst).all()
    assert min(links.distance_src.min(initial=1), links.distance_dst.min(initial=1)) > 0
    assert (nodes.level == 0).all()
    # Each fragment's voxel belongs to its node: no further than a block's diagonal.
    apart = np.abs(structure.fragment_offset()).max(initial=0)
    assert apart <= (factor - 1) * grid.pitch + 1e-12


@settings(deadline=None, max_examples=25)
@given(solids(6), st.integers(1, 4))
def test_open_faces_between_blocks_all_count(solid, factor):
    """Between whole blocks' lattice planes the areas add up to the open voxel faces."""
    structure = Aggregate(blocks(solid), factor)
    faces = 0
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        plane = np.arange(1, len(body)) % factor == 0
        faces += np.count_nonzero((body[:-1] & body[1:])[plane])
    assert structure.links().area.sum() == pytest.approx(faces)


def test_arms_that_meet_outside_their_block_are_two_nodes():
    """A U whose arms share a block: heat goes round, not across the gap."""
    solid = np.zeros((8, 3, 4), bool)
    solid[:, 0] = True
    solid[:, 2] = True
    solid[7] = True
    structure = Aggregate(blocks(solid), 4)
    nodes = structure.nodes()
    links = structure.links()
    np.testing.assert_array_equal(nodes.volume, [16, 16, 16 + 16 + 4])
    np.testing.assert_array_equal(links.src, [0, 1])
    np.testing.assert_array_equal(links.dst, [2, 2])


def test_whole_blocks_conduct_as_one_coarse_voxel():
    """Blocks of f^3 voxels: area (f h)^2 over the distance f h, in lattice order."""
    structure = Aggregate(blocks(np.ones((12, 8, 16), bool), 0.5), 4)
    coarse = FullVolume(blocks(np.ones((3, 2, 4), bool), 2.0))
    assert_links(structure, coarse, rtol=1e-13)
    np.testing.assert_allclose(structure.nodes().centre, coarse.nodes().centre)


def test_nodes_lie_in_the_order_of_their_blocks():
    structure = Aggregate(blocks(ball(9.2)), 3)
    block = np.floor(structure.nodes().centre / 3).astype(int)
    number = np.ravel_multi_index(tuple(block.T), block.max(0) + 1)
    assert (np.diff(number) >= 0).all()


def test_blocks_at_the_upper_ends_are_cut():
    structure = Aggregate(blocks(np.ones((5, 4, 4), bool)), 4, alignment=0.0)
    np.testing.assert_array_equal(structure.nodes().volume, [64, 16])
    np.testing.assert_array_equal(structure.links().distance_dst, [0.5])


def test_factor_one_is_the_full_volume():
    grid = blocks(ball(4.6), 0.5)
    structure = Aggregate(grid, 1)
    full = FullVolume(grid)
    np.testing.assert_allclose(structure.nodes().centre, full.nodes().centre)
    assert_links(structure, full, rtol=1e-14)


def test_a_block_larger_than_the_body_is_the_lumped_body():
    structure = Aggregate(blocks(ball(4.6)), 10**9)
    assert structure.node_count == 1 and structure.link_count == 0


@settings(deadline=None, max_examples=7)
@given(solids(7), st.integers(1, 60))
def test_the_factor_for_a_number_of_nodes_is_the_smallest(solid, nodes):
    grid = blocks(solid)
    counts = {f: Aggregate(grid, f).node_count for f in range(1, 8)}
    fitting = [f for f, count in counts.items() if count <= nodes]
    if fitting:
        assert Aggregate.factor_for(grid, nodes=nodes) == fitting[0]
    else:
        with pytest.raises(InputError, match=f"has {counts[7]} parts"):
            Aggregate.factor_for(grid, nodes=nodes)


@pytest.mark.parametrize(("size", "factor"), [(0.5, 1), (1.2, 2), (1.3, 3), (1e3, 2e3)])
def test_the_factor_for_a_size_is_the_nearest(size, factor):
    assert Aggregate.factor_for(blocks(ball(4.6), 0.5), size=size) == factor


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give nodes= or size="),
        ({"nodes": 3, "size": 1.0}, "give nodes= or size="),
        ({"nodes": 0}, r"nodes=0\): give a whole number of at least 1"),
        ({"size": 0.4}, "size=0.4.*a voxel, 0.5 m"),
        ({"size": np.inf}, r"factor_for\(size="),
    ],
)
def test_what_gives_no_factor_is_refused(arguments, message):
    with pytest.raises(InputError, match=message) as caught:
        Aggregate.factor_for(blocks(ball(2.6), 0.5), **arguments)
    assert "\n" not in str(caught.value)


@settings(deadline=None, max_examples=7)
@given(solids(7), st.integers(1, 9))
def test_blocks_and_parts_are_counted(solid, factor):
    cells = np.argwhere(solid)
    assert count_blocks(solid, factor) == len(np.unique(cells // factor, axis=0))
    assert count_parts(solid, factor) == Aggregate(blocks(solid), factor).node_count
