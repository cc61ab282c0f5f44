"""Sums of consecutive segments of an array, each with about one rounding.

The operations are the same for any number of segments: sums of blocks that belong to
one segment each, then sums of blocks of these sums, up to one number a segment.
"""

from collections.abc import Sequence

import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int

from ..arrays import consecutive, device_array


_BLOCK = 64
"""Values that are added in sequence."""


class SegmentSums(Module):
    """Sums of the segments of an array; a sum is as exact as that of `precise_sum`.

    The largest values of the segments follow in the same way.
    """

    levels: tuple[Int[Array, "r k"], ...]
    """Indices of the values of each block; one past the last value for none."""

    def __call__(self, values: Float[Array, " n"]) -> Float[Array, " b"]:
        """Return the sum of each segment."""
        for blocks in self.levels:
            values = _gathered(values, blocks, 0.0).sum(axis=1)
        return values

    def largest(self, values: Float[Array, " n"]) -> Float[Array, " b"]:
        """Return the largest value of each segment; -inf for one without any."""
        for blocks in self.levels:
            values = _gathered(values, blocks, -np.inf).max(axis=1)
        return values


def _gathered(
    values: Float[Array, " n"], blocks: Int[Array, "r k"], fill: float
) -> Float[Array, "r k"]:
    return values.at[blocks].get(
        mode="fill", fill_value=fill, wrap_negative_indices=False
    )


def segment_sums(segments: Sequence[slice], count: int) -> SegmentSums:
    """Return the sums of segments of an array of `count` values."""
    starts = np.array([segment.start for segment in segments])
    stops = np.array([segment.stop for segment in segments])
    levels = []
    while not levels or (stops - starts).max() > 1:
        blocks = np.maximum(-(-(stops - starts) // _BLOCK), 1)
        owner = np.repeat(np.arange(len(segments)), blocks)
        first = np.repeat(np.cumsum(blocks) - blocks, blocks)
        start = starts[owner] + _BLOCK * (np.arange(len(owner)) - first)
        length = min(_BLOCK, int((stops - starts).max(initial=1)))
        index = start[:, None] + np.arange(length)
        index = np.where(index < stops[owner, None], index, count)
        levels.append(device_array(index.astype(np.int32)))
        starts = np.cumsum(blocks) - blocks
        stops = starts + blocks
        count = int(blocks.sum())
    return SegmentSums(tuple(levels))


def sums_of_lists(lists: Sequence[Int[np.ndarray, " _"]], count: int) -> SegmentSums:
    """Return the sums of the values with these indices, of an array of `count`."""
    sums = sums_of_sizes([len(indices) for indices in lists])
    # Index of each value, and one past the last value for none.
    index = np.append(np.concatenate(lists), count).astype(np.int32)
    if np.array_equal(index, np.arange(count + 1)):
        return sums
    first, *others = sums.levels
    return SegmentSums((device_array(index[np.asarray(first)]), *others))


def sums_of_sizes(sizes: Sequence[int]) -> SegmentSums:
    """Return the sums of segments of these sizes, one after the other."""
    return segment_sums(consecutive(sizes), sum(sizes))
