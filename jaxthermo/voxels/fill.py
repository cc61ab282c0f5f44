"""Solid voxels from depth layers, by a vote of the three axes.

Along a ray the winding number rises by one where the ray enters the surface and falls
where it leaves. A voxel is inside for an axis if the number at its centre is not zero:
overlapping closed parts unite and cavities stay hollow. A ray on which entries and
exits do not balance has passed through a hole and does not vote. Solid is what a
majority votes for, also for open meshes.

Between zero and other winding numbers a ray changes sides, once or several times
between two centres: a voxel is inside after an odd number of changes, which is a sum of
bits, for 64 voxels of a row at once.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, Int8, UInt64

from ..raster.fragments import DepthLayers
from .lattice import Views, pixel_axes
from .voxel_bits import VoxelBits


def first_cell_behind(depth: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of the first cell centre at or behind a depth, in units of cells."""
    return np.ceil(depth - 0.5).astype(np.int64)


def crossing_sign(layers: DepthLayers) -> Int8[np.ndarray, " k"]:
    """+1 where the ray enters the body, -1 where it leaves."""
    return np.where(layers.entering, 1, -1).astype(np.int8)


def balanced_rays(layers: DepthLayers) -> Bool[np.ndarray, " p"]:
    """Flag the pixels whose ray leaves the body as often as it enters."""
    pixels = layers.width * layers.height
    return np.bincount(layers.pixel, crossing_sign(layers), minlength=pixels) == 0


def fill_by_vote(
    views: Views, shape: tuple[int, int, int]
) -> Bool[np.ndarray, "x y z"]:
    """Solid voxels by majority of the votes of the three views."""
    empty = VoxelBits.none(shape).word
    # Voxels with one or two votes for inside, and with a vote for outside.
    at_least_one = empty
    at_least_two = np.zeros_like(empty)
    outside = np.zeros_like(empty)
    for axis, layers in enumerate(views):
        rays = balanced_rays(layers)
        inside = _inside(layers, votes=rays, axis=axis, shape=shape)
        against = ~inside
        if not rays.all():
            against &= _votes_cast(rays.reshape(layers.height, layers.width), axis)
        outside |= against
        at_least_two |= at_least_one & inside
        at_least_one |= inside
    # A single vote for inside counts if there is none for outside.
    at_least_one &= ~outside
    at_least_one |= at_least_two
    return VoxelBits(shape, at_least_one).array()


def _inside(
    layers: DepthLayers,
    votes: Bool[np.ndarray, " p"],
    axis: int,
    shape: tuple[int, int, int],
) -> UInt64[np.ndarray, "x y w"]:
    """Bits of the voxels that are inside along rays that vote."""
    on_voting_ray = slice(None) if votes.all() else np.flatnonzero(votes[layers.pixel])
    pixel = layers.pixel[on_voting_ray]
    sign = crossing_sign(layers)[on_voting_ray]
    # Behind the lattice there is a rim, where every ray is outside again.
    behind = np.clip(first_cell_behind(layers.depth[on_voting_ray]), 0, shape[axis])
    if ((behind[1:] < behind[:-1]) & (pixel[1:] == pixel[:-1])).any():
        # Layers are sorted by rounded depths.
        order = np.lexsort([behind, pixel])
        pixel = pixel[order]
        sign = sign[order]
        behind = behind[order]
    # One running sum serves all rays, because each ray's sum ends at zero.
    winding = np.cumsum(sign, dtype=np.int32)
    changes = np.flatnonzero((winding != 0) != (winding != sign))
    row_axis, column_axis = pixel_axes(axis)
    cell: list[np.ndarray] = [behind[changes]] * 3
    cell[row_axis], cell[column_axis] = np.divmod(pixel[changes], layers.width)
    bits = VoxelBits.listed(shape, VoxelBits.none(shape).number(cell))
    _sum_along(bits.word, axis)
    return bits.word


def _sum_along(word: UInt64[np.ndarray, "x y w"], axis: int) -> None:
    """Running sum of bits along an axis, modulo 2, in place."""
    if axis < 2:
        np.bitwise_xor.accumulate(word, axis=axis, out=word)
        return
    # Within words, over twice as many bits each time, then from word to word.
    for bits in (1, 2, 4, 8, 16, 32):
        word ^= word << np.uint64(bits)
    last = word[..., :-1] >> np.uint64(63)
    odd = np.bitwise_xor.accumulate(last, axis=2)
    # All bits of a word, or none.
    word[..., 1:] ^= np.uint64(0) - odd


def _votes_cast(
    rays: Bool[np.ndarray, "rows columns"], axis: int
) -> UInt64[np.ndarray, "x y w"]:
    """Bits of the voxels on rays that vote, with a length of 1 along the axis."""
    # Rows before columns, as the lattice has them.
    ordered = rays if pixel_axes(axis)[0] < pixel_axes(axis)[1] else rays.T
    if axis < 2:
        word = VoxelBits.of(np.expand_dims(ordered, axis)).word
        return word.take([1], axis)
    row_word = np.where(np.pad(ordered, 1), ~np.uint64(0), np.uint64(0))
    return row_word[..., None]
