"""Irregular levels as halved copies of the surface's textures: a reading of 6.1.

Each level is a copy of the one above at half its size, as in a mipmap, one layer deeper
inside. Nothing stops the copies where the body ends: a texture of 100 texels gives 7.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

import jaxthermo as jt
from jaxthermo.voxels.lattice import pixel_axes


class Copies(NamedTuple):
    """Cubes of all levels, of 2^level voxels an edge."""

    centre: Float[np.ndarray, "n 3"]
    """[voxels from the lowest corner]"""
    level: Int[np.ndarray, " n"]


def copy_count(grid: jt.VoxelGrid) -> int:
    """Levels until the wide side of the lattice is a single texel."""
    return int(np.log2(min(grid.lattice.shape))) + 1


def halved_copies(grid: jt.VoxelGrid, levels: int) -> Copies:
    """Cubes of the halved textures of each axis, moved inward by the levels above.

    Of a grid with `surface_cells="dominant_axis"`: its packed layers are the textures.
    """
    position = grid.lattice.to_cells(grid.fragment_position)
    centres, numbers = [], []
    for axis in range(3):
        own = np.flatnonzero(grid.is_packed(axis))
        inward = -np.sign(grid.fragment_normal[own, axis])
        for level in range(levels):
            middle = _level_centres(position[own], grid, own, inward, axis, level)
            centres.append(middle)
            numbers.append(np.full(len(middle), level))
    return Copies(np.concatenate(centres), np.concatenate(numbers))


def _level_centres(
    position: np.ndarray,
    grid: jt.VoxelGrid,
    own: np.ndarray,
    inward: np.ndarray,
    axis: int,
    level: int,
) -> np.ndarray:
    size = 1 << level
    row_axis, column_axis = pixel_axes(axis)
    texel = np.floor(position[:, [row_axis, column_axis]]).astype(int) // size
    # Front and back of the body never share a texel, nor do two layers.
    key = np.column_stack([texel, grid.fragment_layer[own, 1], inward])
    cells, which = np.unique(key, axis=0, return_inverse=True)
    which = which.reshape(-1)
    depth = np.bincount(which, position[:, axis]) / np.bincount(which)
    middle = np.empty((len(cells), 3))
    middle[:, row_axis] = (cells[:, 0] + 0.5) * size
    middle[:, column_axis] = (cells[:, 1] + 0.5) * size
    # Below all levels above, which are 1 + 2 + ... = 2^level - 1 voxels thick.
    middle[:, axis] = depth + cells[:, 3] * (size - 1 + size / 2)
    return middle


def inside_only(copies: Copies, grid: jt.VoxelGrid) -> Copies:
    """The cubes whose centre lies in a solid voxel, and all of the surface."""
    points = grid.origin + copies.centre * grid.pitch
    kept = grid.contains(points) | (copies.level == 0)
    return Copies(copies.centre[kept], copies.level[kept])


def cover_count(copies: Copies, grid: jt.VoxelGrid) -> Int[np.ndarray, "x y z"]:
    """Number of cubes that cover each voxel of the lattice."""
    # As in `IrregularMultiLevel.cover_count`, but cubes may stick out of the lattice.
    shape = np.array(grid.lattice.shape)
    change = np.zeros(shape + 1, np.int32)
    size = 1 << copies.level
    low = np.rint(copies.centre - size[:, None] / 2).astype(int)
    for far in np.ndindex(2, 2, 2):
        end = np.clip(low + np.array(far) * size[:, None], 0, shape)
        np.add.at(change, tuple(end.T), (-1) ** sum(far))
    for axis in range(3):
        np.cumsum(change, axis=axis, out=change)
    return change[:-1, :-1, :-1]
