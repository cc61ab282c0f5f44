"""Which cell each voxel belongs to, where cells of several sizes overlap or leave gaps.

Conduction needs a body divided without either. Of the cells that cover a voxel the
smallest has it; a voxel that none covers goes to the cell fewest steps away.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from .irregular_cells import LevelCells


class Territory(NamedTuple):
    """The division of a body among its cells."""

    owner: Int[np.ndarray, "x y z"]
    """Number of the cell, -1 outside the body."""
    gap: Int[np.ndarray, "x y z"]
    """Steps from the cell; 0 within it."""


def divide(
    body: Bool[np.ndarray, "x y z"], levels: LevelCells
) -> tuple[Territory, LevelCells]:
    """Divide a body among cells, and leave out cells that smaller ones hide entirely.

    Every cell left has voxels of its own, and each of these is joined over faces of
    the body to the cell's centre: no cell joins parts that the body does not.

    Args:
        body: the voxels to divide, with an empty rim.
        levels: for each level l its cells of 2^l voxels. Cells of one level do not
            overlap; the numbers run on from level to level.

    Returns:
        The division, and the cells left in each level.
    """
    owner = _paint(body, levels)
    counts = [len(cells) for cells in levels]
    seen = np.zeros(sum(counts), bool)
    seen[: counts[0]] = True
    seen[owner[owner >= counts[0]]] = True
    if not seen.all():
        parts = np.split(seen, np.cumsum(counts)[:-1])
        levels = [cells[part] for cells, part in zip(levels, parts, strict=True)]
        owner = _paint(body, levels)
    return Territory(owner, grow(body, owner)), levels


def _paint(
    body: Bool[np.ndarray, "x y z"], levels: LevelCells
) -> Int[np.ndarray, "x y z"]:
    """Number of the smallest cell that covers each voxel of the body, else -1."""
    owner = np.full(body.shape, -1, np.int32)
    first = sum(len(cells) for cells in levels)
    for level in reversed(range(len(levels))):
        size, cells = 1 << level, levels[level]
        first -= len(cells)
        number = np.arange(first, first + len(cells), dtype=np.int32)
        # As blocks, so that one index takes all voxels of a cell: [cell, x, y, z].
        shape = [n for axis in body.shape for n in (axis // size, size)]
        x, y, z = cells.T
        at = (x, slice(None), y, slice(None), z, slice(None))
        allowed = body.reshape(shape)[at]
        whole = allowed.all(axis=(1, 2, 3), keepdims=True)
        allowed &= whole | _joined_to_centre(size)
        blocks = owner.reshape(shape)
        blocks[at] = np.where(allowed, number[:, None, None, None], blocks[at])
    return owner


def _joined_to_centre(size: int) -> Bool[np.ndarray, "s s s"]:
    """Voxels of a cell that, if in the body, are joined to its centre within the cell.

    Half of the eight central voxels are `size` steps or more from the outside, so all
    eight are at least size - 2, and every path of fewer steps stays in the body. The
    voxels nearer to the corners may belong to another part of the body.
    """
    place = np.arange(size)
    steps = np.maximum(size // 2 - 1 - place, place - size // 2)
    total = steps[:, None, None] + steps[:, None] + steps
    return total < max(size - 2, 1)


def grow(
    body: Bool[np.ndarray, "x y z"], owner: Int[np.ndarray, "x y z"]
) -> Int[np.ndarray, "x y z"]:
    """Give every voxel without an owner to a neighbour's, step by step, in place.

    What the body does not join to any owner keeps -1.

    Args:
        body: the voxels to divide, with an empty rim.
        owner: of each voxel, -1 for none.

    Returns:
        The steps. Of several neighbours the first in lattice order decides.
    """
    gap = np.zeros(body.shape, np.int16)
    flat_owner, flat_gap = owner.reshape(-1), gap.reshape(-1)
    waiting = np.flatnonzero(body & (owner < 0))
    _, y, z = body.shape
    step = 0
    while len(waiting):
        step += 1
        found = np.full(len(waiting), -1, np.int32)
        for jump in (-y * z, -z, -1, 1, z, y * z):
            found = np.where(found < 0, flat_owner[waiting + jump], found)
        reached = found >= 0
        if not reached.any():
            break
        flat_owner[waiting[reached]] = found[reached]
        flat_gap[waiting[reached]] = step
        waiting = waiting[~reached]
    return gap
