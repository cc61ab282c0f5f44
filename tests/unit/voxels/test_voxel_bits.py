"""Voxels as bits: the same as arrays of truth values, and as sorted lists."""

import numpy as np
import pytest

from jaxthermo.voxels.voxel_bits import VoxelBits, VoxelIndex


@pytest.fixture(params=[1, 63, 64, 65, 130])
def chosen(request):
    """Voxels of a lattice with rows that end within a word, or with one."""
    found = np.random.default_rng(request.param).random((4, 3, request.param)) > 0.6
    found[-1, -1, -1] = found[0, 0, 0] = True
    return found


def test_arrays_become_bits_and_bits_arrays(chosen):
    bits = VoxelBits.of(chosen)
    np.testing.assert_array_equal(bits.array(), chosen)
    listed = VoxelBits.listed(chosen.shape, bits.numbers())
    np.testing.assert_array_equal(listed.word, bits.word)


def test_numbers_ascend_in_lattice_order_and_lead_back(chosen):
    bits = VoxelBits.of(chosen)
    number, cell = bits.numbers(), np.argwhere(chosen)
    assert (np.diff(number) > 0).all()
    np.testing.assert_array_equal(bits.voxels(number), cell)
    np.testing.assert_array_equal(bits.number(tuple(cell.T)), number)


def test_neighbours_are_a_jump_apart_also_outside(chosen):
    bits, padded = VoxelBits.of(chosen), np.pad(chosen, 1)
    cell = np.indices(chosen.shape).reshape(3, -1)
    number = bits.number(tuple(cell))
    for step in np.ndindex(3, 3, 3):
        jump = int(np.dot(np.array(step) - 1, bits.jumps))
        if 0 in np.array(step) - 1:
            expected = padded[tuple(cell + np.array(step)[:, None])]
            np.testing.assert_array_equal(bits.has(number, jump), expected)


def test_shifted_bits_are_those_before_and_behind(chosen):
    padded = np.pad(chosen, 1)
    for axis in range(3):
        for ahead in (True, False):
            moved = VoxelBits(chosen.shape, VoxelBits.of(chosen).shifted(axis, ahead))
            expected = np.roll(padded, 1 if ahead else -1, axis)[1:-1, 1:-1, 1:-1]
            np.testing.assert_array_equal(moved.array(), expected)


def test_positions_are_those_of_a_search(chosen):
    bits = VoxelBits.of(chosen)
    wanted = np.arange(64 * bits.word.size)
    index, there = VoxelIndex(bits).at(wanted)
    np.testing.assert_array_equal(index, np.searchsorted(bits.numbers(), wanted))
    np.testing.assert_array_equal(there, np.isin(wanted, bits.numbers()))
