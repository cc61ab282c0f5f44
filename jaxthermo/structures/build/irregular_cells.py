"""The cells of an irregular structure: shells inside a body, each twice as coarse.

All are found on a lattice of voxels that has one empty voxel before the body, so that
in a cube each level begins where the one above ends. There voxel v of the grid is
voxel v + 1.
"""

import numpy as np
from jaxtyping import Bool, Int

from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_voxels
from .layers import voxel_layers


LevelCells = list[Int[np.ndarray, "_ 3"]]
"""Cells of each level l, 2^l voxels wide: [i, j, k] begins at voxel 2^l [i, j, k]."""


def voxel_depth(grid: VoxelGrid) -> Int[np.ndarray, "x y z"]:
    """Steps over faces from outside to each voxel: 1 in the shell, 0 outside.

    With a rim of one empty voxel, and more at the far sides, so that the largest cells
    that could fit divide the lattice.
    """
    shape = np.array(grid.solid.shape)
    layer = voxel_layers(grid, int(shape.max()))
    largest = 1 << (max(int(layer.max()) + 1, 1).bit_length() - 1)
    beyond = -(shape + 1) % largest
    # The largest cells may end with the body; where they do, the rim comes on top.
    beyond = np.where(beyond == 0, largest, beyond)
    depth = np.zeros(tuple(shape + 1 + beyond), np.int16)
    x, y, z = shape + 1
    depth[1:x, 1:y, 1:z] = layer + 1
    return depth


def nested_cells(depth: Int[np.ndarray, "x y z"]) -> LevelCells:
    """For each level l the cells of 2^l voxels that form its shell, in lattice order.

    Level 0 is the shell of the body. A cell of a coarser level is inside what the
    levels above leave, 2^l - 1 voxels less than the body all round, if at least half
    of the eight voxels around its centre are; of the cells inside, those with a face
    to one that is not are the level. A level in between may have none.

    Args:
        depth: from `voxel_depth`.
    """
    levels = [np.argwhere(depth == 1)]
    for level in range(1, int(depth.max()).bit_length()):
        levels.append(surface_voxels(_inside(depth, 1 << level)))
    while len(levels) > 1 and not len(levels[-1]):
        levels.pop()
    return levels


def _inside(depth: Int[np.ndarray, "x y z"], size: int) -> Bool[np.ndarray, "a b c"]:
    """Cells with at least four of their eight central voxels at the depth `size`."""
    middle = (slice(size // 2 - 1, None, size), slice(size // 2, None, size))
    found = [
        (depth[x, y, z] >= size).astype(np.uint8)
        for x in middle
        for y in middle
        for z in middle
    ]
    return sum(found[1:], found[0]) >= 4
