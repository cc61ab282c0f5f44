"""Cubic blocks of voxels, divided into the parts that hang together inside them."""

import numpy as np
from jaxtyping import Bool, Int
from skimage import measure

from .blocks import index_type


def block_parts(
    solid: Bool[np.ndarray, "x y z"], factor: int
) -> Int[np.ndarray, "x y z"]:
    """For each voxel the first voxel, in lattice order, of its part of its block.

    A block has factor^3 voxels, fewer at the upper ends of the lattice. A part is what
    hangs together over voxel faces without leaving the block. Empty voxels have -1.
    """
    edge = np.minimum(factor, solid.shape)
    blocks = -(-np.array(solid.shape) // edge)
    padded = np.pad(solid, [(0, n) for n in blocks * edge - solid.shape])
    split = np.stack([blocks, edge], 1).reshape(-1)
    # [blocks along x, y, z, voxels of a block along x, y, z]
    inside = padded.reshape(split).transpose(0, 2, 4, 1, 3, 5)
    first = np.zeros(padded.shape, index_type(padded.shape))
    first_inside = first.reshape(split).transpose(0, 2, 4, 1, 3, 5)

    strides = np.array([solid.shape[1] * solid.shape[2], solid.shape[2], 1])
    corner = _lattice_sum(blocks, edge * strides).astype(first.dtype)
    within = _lattice_sum(edge, strides).astype(first.dtype)
    full = inside.all((3, 4, 5))
    first_inside[...] = np.where(full, corner, -1)[..., None, None, None]
    mixed = inside.any((3, 4, 5)) & ~full
    voxel = corner[mixed][:, None, None, None] + within
    first_inside[mixed] = _first_of_parts(inside[mixed], voxel)
    x, y, z = solid.shape
    return np.ascontiguousarray(first[:x, :y, :z])


def _lattice_sum(
    counts: Int[np.ndarray, "3"], strides: Int[np.ndarray, "3"]
) -> Int[np.ndarray, "i j k"]:
    """Of all (i, j, k) below the counts: i s_x + j s_y + k s_z."""
    x, y, z = (np.arange(n) * stride for n, stride in zip(counts, strides, strict=True))
    return x[:, None, None] + y[:, None] + z


def _first_of_parts(
    solid: Bool[np.ndarray, "m i j k"], voxel: Int[np.ndarray, "m i j k"]
) -> Int[np.ndarray, "m i j k"]:
    """The lowest of `voxel` in each part of each block; -1 where empty."""
    # All blocks in one pile, an empty plane under each.
    pile = np.pad(solid, [(0, 0), (1, 0), (0, 0), (0, 0)])
    part = measure.label(pile.reshape(-1, *solid.shape[2:]), connectivity=1)
    part = np.asarray(part).reshape(pile.shape)[:, 1:][solid]
    own = voxel[solid]
    lowest = np.zeros(part.max(initial=0) + 1, own.dtype)
    # Voxels come in rising order inside a block: the last one written is the lowest.
    lowest[part[::-1]] = own[::-1]
    result = np.full(solid.shape, -1, own.dtype)
    result[solid] = lowest[part]
    return result
