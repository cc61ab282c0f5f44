"""Voxels as bits: 64 of a row in one word, with a rim of empty voxels around them.

An eighth of the memory of truth values, and most operations take a word at a time. A
number addresses a voxel. Numbers ascend in lattice order, and those of neighbours are
one jump apart for each axis, also across the rim.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, UInt64


# Numbers that are looked up at once, and words that are listed: temporaries stay in the
# cache, and take little memory.
_CHUNK = 2**14
_CHUNK_WORDS = 2**13

_ONE = np.uint64(1)


@dataclass(frozen=True, eq=False)
class VoxelBits:
    """Truth values of the voxels of a lattice."""

    shape: tuple[int, int, int]
    word: UInt64[np.ndarray, "x y w"]
    """Words with the rim; the first voxel of a row is its lowest bit."""

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> "VoxelBits":
        """No voxel of a lattice."""
        x, y, z = shape
        # A rim of one bit above each row is below the next one, too.
        return cls((x, y, z), np.zeros((x + 2, y + 2, z // 64 + 1), np.uint64))

    @classmethod
    def of(cls, mask: Bool[np.ndarray, "x y z"]) -> "VoxelBits":
        """Voxels for which an array is true."""
        bits = cls.none(mask.shape)
        packed = np.packbits(mask, axis=2, bitorder="little")
        bits.word.view(np.uint8)[1:-1, 1:-1, : packed.shape[2]] = packed
        return bits._native()

    @classmethod
    def listed(
        cls, shape: tuple[int, ...], number: Int[np.ndarray, " k"]
    ) -> "VoxelBits":
        """Voxels of numbers that occur once, or any odd number of times."""
        bits = cls.none(shape)
        np.bitwise_xor.at(bits.word.reshape(-1), number >> 6, _bit(number))
        return bits

    def _native(self) -> "VoxelBits":
        # From bytes, the lowest first, and back.
        little = self.word.view(self.word.dtype.newbyteorder("<"))
        return VoxelBits(self.shape, little.astype(np.uint64, copy=False))

    def array(self) -> Bool[np.ndarray, "x y z"]:
        """One truth value for each voxel."""
        inner = self.word[1:-1, 1:-1].astype("<u8", copy=False).view(np.uint8)
        count = self.shape[2]
        return np.unpackbits(inner, axis=2, count=count, bitorder="little").view(bool)

    @property
    def jumps(self) -> tuple[int, int, int]:
        """From a voxel to the next along x, y, z."""
        _, y, w = self.word.shape
        return y * w * 64, w * 64, 1

    def number(self, cell: Sequence[np.ndarray]) -> Int[np.ndarray, " k"]:
        """Numbers of the cells with coordinates x, y and z."""
        x, y, z = cell
        to_x, to_y, _ = self.jumps
        number = np.multiply(x, to_x, dtype=np.int64)
        number += np.multiply(y, to_y, dtype=np.int64)
        number += z
        number += to_x + to_y
        return number

    def cells(self, number: Int[np.ndarray, " k"]) -> tuple[np.ndarray, ...]:
        """x, y and z of the cells of numbers."""
        to_x, to_y, _ = self.jumps
        x = number // to_x
        remainder = number - x * to_x
        y = remainder // to_y
        remainder -= y * to_y
        return x - 1, y - 1, remainder

    def voxels(self, number: Int[np.ndarray, " k"]) -> Int[np.ndarray, "k 3"]:
        """Voxel coordinates of numbers, as rows."""
        voxel = np.empty((len(number), 3), np.int32)
        for chunk in _chunks(len(number)):
            for axis, cell in enumerate(self.cells(number[chunk])):
                voxel[chunk, axis] = cell
        return voxel

    def has(
        self, number: Int[np.ndarray, " k"], apart: int = 0
    ) -> Bool[np.ndarray, " k"]:
        """True where the voxel with the number `number + apart` is set."""
        is_set = np.empty(len(number), bool)
        word = self.word.reshape(-1)
        for chunk in _chunks(len(number)):
            target = number[chunk] + apart
            bit = word.take(target >> 6) & _bit(target)
            np.not_equal(bit, 0, out=is_set[chunk])
        return is_set

    def numbers(self) -> Int[np.ndarray, " k"]:
        """Numbers of all voxels that are set, ascending."""
        word = self.word.reshape(-1)
        at = np.flatnonzero(word != 0)
        batches = [np.zeros(0, np.int64)]
        for start in range(0, len(at), _CHUNK_WORDS):
            word_index = at[start : start + _CHUNK_WORDS]
            octets = word[word_index].astype("<u8", copy=False).view(np.uint8)
            bit = np.flatnonzero(np.unpackbits(octets, bitorder="little").view(bool))
            batches.append((word_index[bit >> 6] << 6) + (bit & 63))
        return np.concatenate(batches)

    def shifted(self, axis: int, ahead: bool) -> UInt64[np.ndarray, "x y w"]:
        """Words in which each voxel is one cell ahead, or behind, along an axis.

        What leaves the rim is lost.
        """
        shifted = np.zeros_like(self.word)
        if axis < 2:
            source = np.moveaxis(self.word, axis, 0)
            target = np.moveaxis(shifted, axis, 0)
            if ahead:
                target[1:] = source[:-1]
            else:
                target[:-1] = source[1:]
            return shifted
        carry = np.uint64(63)
        # Rows end with an empty bit: no voxel enters the next row.
        flat = self.word.reshape(-1)
        moved = shifted.reshape(-1)
        if ahead:
            np.left_shift(flat, _ONE, out=moved)
            moved[1:] |= flat[:-1] >> carry
        else:
            np.right_shift(flat, _ONE, out=moved)
            moved[:-1] |= flat[1:] << carry
        return shifted


def _chunks(count: int) -> Iterator[slice]:
    return (slice(start, start + _CHUNK) for start in range(0, count, _CHUNK))


def _bit(number: Int[np.ndarray, " k"]) -> UInt64[np.ndarray, " k"]:
    """The bit of each number in its word."""
    return _ONE << (number & 63).astype(np.uint64)


class VoxelIndex:
    """Positions of voxels in the list of all that are set.

    As by `np.searchsorted` in `VoxelBits.numbers`, but without a search.
    """

    def __init__(self, bits: VoxelBits):
        self._word = bits.word.reshape(-1)
        # Chosen voxels before each word.
        count = np.bitwise_count(self._word)
        self._before = np.cumsum(count, dtype=np.int32) - count

    def at(
        self, number: Int[np.ndarray, " k"]
    ) -> tuple[Int[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
        """Count of set voxels before each one, and a flag for each that is set."""
        rank = np.empty(len(number), np.int64)
        is_set = np.empty(len(number), bool)
        for chunk in _chunks(len(number)):
            word_index = number[chunk] >> 6
            bit = _bit(number[chunk])
            word = self._word.take(word_index)
            np.not_equal(word & bit, 0, out=is_set[chunk])
            count = np.bitwise_count(word & (bit - _ONE))
            np.add(self._before.take(word_index), count, out=rank[chunk])
        return rank, is_set
