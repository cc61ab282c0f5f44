"""Which cell each voxel belongs to, where cells of several sizes overlap or leave gaps.

Conduction needs a body divided without either. Of the cells that cover a voxel the
smallest has it; a voxel that none covers goes to the cell fewest steps away.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_voxels
from ..structure import AbstractStructure
from .blocks import voxel_layers


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


def voxel_owner(structure: AbstractStructure) -> Int[np.ndarray, " v"]:
    """The node that each solid voxel's heat goes to, in lattice order.

    A voxel in no node, as inside a shell, goes to the node the fewest steps through
    the body away; one that the body joins to no node keeps -1.
    """
    own, solid = structure.voxel_node(), structure.grid.solid
    if (own >= 0).all():
        return own
    owner = np.full(np.add(solid.shape, 2), -1, np.int32)
    padded = np.pad(solid, 1)
    owner[padded] = own
    grow(padded, owner)
    return owner[padded]


def volume_within(
    structure: AbstractStructure, chosen: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " n"]:
    """Volume of the chosen solid voxels that goes to each node [m^3].

    Args:
        structure: of the body.
        chosen: of the solid voxels, in lattice order.
    """
    owner = voxel_owner(structure)[chosen]
    count = np.bincount(owner[owner >= 0], minlength=structure.node_count)
    return count * structure.grid.voxel_volume


LEAST_SHARE = 0.5
"""Of its own volume, that a node keeps however little is nearest to it: an edge with a
tenth would make the whole body ten times as stiff, and its heat spreads at once."""


def nearest_volume(structure: AbstractStructure) -> Float[np.ndarray, " n"]:
    """Volume of all solid voxels that are nearest to each node [m^3]."""
    everything = np.ones(structure.grid.solid_count, bool)
    least = LEAST_SHARE * structure.nodes().volume
    return np.maximum(volume_within(structure, everything), least)
