"""Blocks of 16 and 32 voxels: thin parts at their ends neither shut nor slow a bar."""

import numpy as np
import pytest
from voxel_volumes import conductance_sums

import jaxthermo as jt
from tests.bodies import blocks


PITCH = 1e-3


def _conductance(structure):
    """From end to end along z, with the half cells at both ends, over k A / L."""
    links = structure.links()
    count = structure.node_count
    through = links.area / (links.distance_src + links.distance_dst)
    matrix = np.zeros((count, count))
    for row, column in ((links.src, links.dst), (links.dst, links.src)):
        np.add.at(matrix, (row, row), through)
        np.add.at(matrix, (row, column), -through)
    grid = structure.grid
    node = structure.fragment_node()
    half = grid.fragment_area / structure.fragment_distance
    ends = [np.where(grid.fragment_normal[:, 2] == sign, half, 0) for sign in (-1, 1)]
    low, high = (np.bincount(node, end, count) for end in ends)
    # One end at 1, the other at 0.
    theta = np.linalg.solve(matrix + np.diag(low + high), low)
    x, y, z = np.array(grid.solid.shape) * PITCH
    return high @ theta / (x * y / z)


@pytest.mark.parametrize(
    ("shape", "factor", "off"),
    [
        ((32, 16, 64), 16, 1e-12),
        ((32, 32, 128), 32, 1e-12),
        # 0.66 of the heat if the links of the last voxel were lengthened.
        ((34, 33, 129), 32, 0.004),
        ((33, 16, 65), 16, 0.004),
        # A slice that is just not thin, as one voxel in blocks of eight.
        ((16, 16, 66), 16, 0.07),
    ],
)
def test_a_bar_conducts_its_closed_form(shape, factor, off):
    structure = jt.Aggregate(blocks(np.ones(shape, bool), PITCH), factor)
    assert _conductance(structure) == pytest.approx(1, rel=off)


@pytest.fixture(scope="module")
def ball():
    cell = np.indices((41, 41, 41)) - 20
    return blocks((cell**2).sum(axis=0) < 400, PITCH)


@pytest.mark.parametrize("factor", [16, 32])
def test_capacity_and_faces_are_kept_and_no_node_is_fast(ball, factor):
    structure = jt.Aggregate(ball, factor)
    links = structure.links()
    volume = structure.nodes().volume
    count = len(volume)
    plain = jt.Aggregate(ball, factor, min_time_constant=0.0)
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-14)
    assert np.bincount(structure.voxel_node(), minlength=count).min() > 0
    np.testing.assert_array_equal(links.area, plain.links().area)
    total = conductance_sums(structure)
    block_constant = (factor * PITCH) ** 2 / 6
    assert (volume / total).min() >= 0.45 * block_constant * (1 - 1e-12)
    # Some are filled up from their neighbours, and these only.
    moved = volume != plain.nodes().volume
    assert 0 < np.count_nonzero(moved) < count


def test_thin_parts_up_to_a_factor_of_eight_are_as_they_were():
    solid = np.ones((17, 17, 33), bool)
    structure = jt.Aggregate(blocks(solid, PITCH), 8)
    voxels = np.bincount(structure.voxel_node()) * PITCH**3
    np.testing.assert_allclose(structure.nodes().volume, voxels, rtol=1e-14)


def test_arms_that_meet_outside_a_large_block_stay_apart():
    """A comb with teeth of 3 voxels: each is a node of its own in every block."""
    solid = np.zeros((64, 31, 8), bool)
    solid[:, ::10] = True
    solid[56:] = True
    structure = jt.Aggregate(blocks(solid, PITCH), 32)
    assert structure.node_count == 4 + 1
    assert (structure.links().dst == 4).all()
