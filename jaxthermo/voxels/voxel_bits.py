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
    def of(cls, chosen: Bool[np.ndarray, "x y z"]) -> "VoxelBits":
        """Voxels for which an array is true."""
        bits = cls.none(chosen.shape)
        packed = np.packbits(chosen, axis=2, bitorder="little")
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
        """Numbers of the voxels of some cells, given as their x, y and z."""
        x, y, z = cell
        to_x, to_y, _ = self.jumps
        found = np.multiply(x, to_x, dtype=np.int64)
        found += np.multiply(y, to_y, dtype=np.int64)
        found += z
        found += to_x + to_y
        return found

    def cells(self, number: Int[np.ndarray, " k"]) -> tuple[np.ndarray, ...]:
        """Cells of numbers, x, y and z."""
        to_x, to_y, _ = self.jumps
        x = number // to_x
        rest = number - x * to_x
        y = rest // to_y
        rest -= y * to_y
        return x - 1, y - 1, rest

    def voxels(self, number: Int[np.ndarray, " k"]) -> Int[np.ndarray, "k 3"]:
        """The same as rows."""
        found = np.empty((len(number), 3), np.int32)
        for own in _chunks(len(number)):
            for axis, cell in enumerate(self.cells(number[own])):
                found[own, axis] = cell
        return found

    def has(
        self, number: Int[np.ndarray, " k"], apart: int = 0
    ) -> Bool[np.ndarray, " k"]:
        """True where the voxel that far from each number is chosen."""
        found, word = np.empty(len(number), bool), self.word.reshape(-1)
        for own in _chunks(len(number)):
            wanted = number[own] + apart
            chosen = word.take(wanted >> 6) & _bit(wanted)
            np.not_equal(chosen, 0, out=found[own])
        return found

    def numbers(self) -> Int[np.ndarray, " k"]:
        """Numbers of all voxels that are chosen, ascending."""
        word = self.word.reshape(-1)
        at = np.flatnonzero(word != 0)
        found = [np.zeros(0, np.int64)]
        for start in range(0, len(at), _CHUNK_WORDS):
            own = at[start : start + _CHUNK_WORDS]
            octets = word[own].astype("<u8", copy=False).view(np.uint8)
            bit = np.flatnonzero(np.unpackbits(octets, bitorder="little").view(bool))
            found.append((own[bit >> 6] << 6) + (bit & 63))
        return np.concatenate(found)

    def shifted(self, axis: int, ahead: bool) -> UInt64[np.ndarray, "x y w"]:
        """Words in which each voxel is one cell ahead, or behind, along an axis.

        What leaves the rim is lost.
        """
        found = np.zeros_like(self.word)
        to, of = (slice(1, None), slice(None, -1))[:: 1 if ahead else -1]
        if axis < 2:
            planes = (slice(None),) * axis
            found[*planes, to] = self.word[*planes, of]
            return found
        one, most = np.uint64(1), np.uint64(63)
        # Rows end with an empty bit: none of them enters the next row.
        flat, moved = self.word.reshape(-1), found.reshape(-1)
        if ahead:
            np.left_shift(flat, one, out=moved)
            moved[1:] |= flat[:-1] >> most
        else:
            np.right_shift(flat, one, out=moved)
            moved[:-1] |= flat[1:] << most
        return found


def _chunks(count: int) -> Iterator[slice]:
    return (slice(start, start + _CHUNK) for start in range(0, count, _CHUNK))


def _bit(number: Int[np.ndarray, " k"]) -> UInt64[np.ndarray, " k"]:
    """The bit of each number in its word."""
    return _ONE << (number & 63).astype(np.uint64)


class VoxelIndex:
    """Positions of voxels in the list of those that are chosen.

    As by `np.searchsorted` in `VoxelBits.numbers`, in a fifth of the time.
    """

    def __init__(self, bits: VoxelBits):
        self._word = bits.word.reshape(-1)
        # Chosen voxels before each word.
        count = np.bitwise_count(self._word)
        self._before = np.cumsum(count, dtype=np.int32) - count

    def at(
        self, number: Int[np.ndarray, " k"]
    ) -> tuple[Int[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
        """Number of chosen voxels before each, and true for those that are chosen."""
        before, there = np.empty(len(number), np.int64), np.empty(len(number), bool)
        for own in _chunks(len(number)):
            at, bit = number[own] >> 6, _bit(number[own])
            word = self._word.take(at)
            np.not_equal(word & bit, 0, out=there[own])
            count = np.bitwise_count(word & (bit - _ONE))
            np.add(self._before.take(at), count, out=before[own])
        return before, there
