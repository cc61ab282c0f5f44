"""Voxels as bits: the same as arrays of truth values, and as sorted lists."""

import numpy as np
import pytest

from jaxthermo.voxels.voxel_bits import VoxelBits, VoxelIndex


@pytest.fixture(params=[1, 63, 64, 65, 130])
def mask(request):
    """Voxels of a lattice with rows that end within a word, or with one."""
    solid = np.random.default_rng(request.param).random((4, 3, request.param)) > 0.6
    solid[-1, -1, -1] = solid[0, 0, 0] = True
    return solid


def test_arrays_become_bits_and_bits_arrays(mask):
    bits = VoxelBits.of(mask)
    np.testing.assert_array_equal(bits.array(), mask)
    listed = VoxelBits.listed(mask.shape, bits.numbers())
    np.testing.assert_array_equal(listed.word, bits.word)


def test_numbers_ascend_in_lattice_order_and_lead_back(mask):
    bits = VoxelBits.of(mask)
    number = bits.numbers()
    cell = np.argwhere(mask)
    assert (np.diff(number) > 0).all()
    np.testing.assert_array_equal(bits.voxels(number), cell)
    np.testing.assert_array_equal(bits.number(tuple(cell.T)), number)


def test_neighbours_are_a_jump_apart_also_outside(mask):
    bits = VoxelBits.of(mask)
    padded = np.pad(mask, 1)
    cell = np.indices(mask.shape).reshape(3, -1)
    number = bits.number(tuple(cell))
    for step in np.ndindex(3, 3, 3):
        jump = int(np.dot(np.array(step) - 1, bits.jumps))
        if 0 in np.array(step) - 1:
            expected = padded[tuple(cell + np.array(step)[:, None])]
            np.testing.assert_array_equal(bits.has(number, jump), expected)


def test_shifted_bits_are_those_before_and_behind(mask):
    padded = np.pad(mask, 1)
    for axis in range(3):
        for ahead in (True, False):
            moved = VoxelBits(mask.shape, VoxelBits.of(mask).shifted(axis, ahead))
            expected = np.roll(padded, 1 if ahead else -1, axis)[1:-1, 1:-1, 1:-1]
            np.testing.assert_array_equal(moved.array(), expected)


def test_positions_are_those_of_a_search(mask):
    bits = VoxelBits.of(mask)
    numbers = np.arange(64 * bits.word.size)
    index, is_set = VoxelIndex(bits).at(numbers)
    np.testing.assert_array_equal(index, np.searchsorted(bits.numbers(), numbers))
    np.testing.assert_array_equal(is_set, np.isin(numbers, bits.numbers()))
