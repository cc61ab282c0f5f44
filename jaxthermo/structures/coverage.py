"""How well cells of several sizes cover a body: where they overlap or leave cracks."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..voxels.grid import VoxelGrid
from .structure import Nodes


class Coverage(NamedTuple):
    """Shares of the body's volume; the cells' is 1 + overlap - crack + outside."""

    overlap: float
    """Covered more than once, each further time counted."""
    crack: float
    """Covered by no cell."""
    outside: float
    """Of cells that stick out of the body."""


def cover_count(grid: VoxelGrid, nodes: Nodes) -> Int[np.ndarray, "x y z"]:
    """How many nodes cover each voxel, a node of level l being a cube of 2^l voxels.

    Each cube adds at its eight corners, with alternating sign; the running sums along
    x, y and z then fill the cubes.

    Args:
        grid: the body.
        nodes: all inside the lattice.
    """
    change = np.zeros(np.array(grid.solid.shape) + 1, np.int16)
    size = 1 << nodes.level
    low = grid.lattice.to_cells(nodes.centre) - size[:, None] / 2
    corner = np.rint(low).astype(int)
    for far in np.ndindex(2, 2, 2):
        at = corner + np.array(far) * size[:, None]
        np.add.at(change, tuple(at.T), np.int16((-1) ** sum(far)))
    for axis in range(3):
        np.cumsum(change, axis=axis, out=change)
    return change[:-1, :-1, :-1]


def coverage(grid: VoxelGrid, count: Int[np.ndarray, "x y z"]) -> Coverage:
    """Shares of the whole body.

    Args:
        grid: the body.
        count: from `cover_count`.
    """
    inside = count[grid.solid]
    total, solid = int(count.sum(dtype=np.int64)), max(len(inside), 1)
    covered = int(np.count_nonzero(inside))
    within = int(inside.sum(dtype=np.int64))
    return Coverage(
        overlap=(within - covered) / solid,
        crack=(len(inside) - covered) / solid,
        outside=(total - within) / solid,
    )


def capacity_by_region(
    grid: VoxelGrid, count: Int[np.ndarray, "x y z"], width: int
) -> tuple[Float[np.ndarray, "a b c"], Float[np.ndarray, "a b c"]]:
    """Volume of the cells, and of the body, in boxes of the lattice [m^3].

    The two differ where cells overlap, stick out or leave cracks.

    Args:
        grid: the body.
        count: from `cover_count`.
        width: of a box, in voxels.
    """
    starts = [np.arange(0, n, width) for n in count.shape]

    def per_box(values: Int[np.ndarray, "x y z"]) -> Float[np.ndarray, "a b c"]:
        for axis, start in enumerate(starts):
            values = np.add.reduceat(values, start, axis=axis, dtype=np.int64)
        return values * grid.voxel_volume

    return per_box(count), per_box(grid.solid.astype(np.int8))
