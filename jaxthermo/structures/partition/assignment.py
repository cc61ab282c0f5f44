"""Assignment of voxels to nodes, and to cells that overlap or leave gaps.

Conduction needs a body divided without overlaps and gaps. A voxel belongs to the
smallest cell that covers it, or else to the cell the fewest steps away. By the same
rule quantities given per voxel, such as a heated region, are assigned to nodes, so that
their total is the same in all structures.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_voxels
from ..structure import AbstractVoxelStructure
from .blocks import voxel_layers


LevelCells = list[Int[np.ndarray, "_ 3"]]
"""Cells of each level l, 2^l voxels wide; [i, j, k] begins at voxel 2^l [i, j, k]."""


def voxel_depth(grid: VoxelGrid) -> Int[np.ndarray, "x y z"]:
    """Steps over faces from outside to each voxel: 1 in the shell, 0 outside.

    On a lattice with one empty voxel before the grid's first: voxel v is v + 1 there.
    """
    # With that rim each level of a cube begins where the level above ends. At the upper
    # ends the lattice is extended to a multiple of the largest cells that could fit.
    shape = np.array(grid.solid.shape)
    layer = voxel_layers(grid, int(shape.max()))
    largest = 1 << (max(int(layer.max()) + 1, 1).bit_length() - 1)
    beyond = -(shape + 1) % largest
    # Where the largest cells end with the body the rim is still needed behind them.
    beyond = np.where(beyond == 0, largest, beyond)
    depth = np.zeros(tuple(shape + 1 + beyond), np.int16)
    x, y, z = shape + 1
    depth[1:x, 1:y, 1:z] = layer + 1
    return depth


def nested_cells(depth: Int[np.ndarray, "x y z"]) -> LevelCells:
    """Cells of 2^l voxels that form the shell of each level l, in lattice order.

    Level 0 is the shell of the body. A cell of level l is inside the remaining core
    (the body without its outer 2^l - 1 layers, from `voxel_depth`) if at least four of
    the eight voxels around its centre are; those with a face to a cell outside form the
    level.
    """
    levels = [np.argwhere(depth == 1)]
    for level in range(1, int(depth.max()).bit_length()):
        levels.append(surface_voxels(_inside(depth, 1 << level)))
    while len(levels) > 1 and not len(levels[-1]):
        levels.pop()
    return levels


def _inside(depth: Int[np.ndarray, "x y z"], size: int) -> Bool[np.ndarray, "a b c"]:
    """Cells with at least four of their eight central voxels as deep as `size`."""
    middle = (slice(size // 2 - 1, None, size), slice(size // 2, None, size))
    deep = [depth[around] >= size for around in product(middle, repeat=3)]
    return np.stack(deep).sum(axis=0, dtype=np.uint8) >= 4


class Assignment(NamedTuple):
    """Division of a body among cells."""

    owner: Int[np.ndarray, "x y z"]
    """Number of the cell of each voxel, -1 outside the body."""
    gap: Int[np.ndarray, "x y z"]
    """Steps from the voxel to its cell, 0 within it."""


def assign_voxels(
    body: Bool[np.ndarray, "x y z"], levels: LevelCells
) -> tuple[Assignment, LevelCells]:
    """Divide a body among cells; drop the cells that smaller ones hide entirely.

    The body has an empty rim. Cells of one level do not overlap; their numbers continue
    from level to level. Returns the division and the remaining cells.
    """
    owner = _paint(body, levels)
    counts = [len(cells) for cells in levels]
    visible = np.zeros(sum(counts), bool)
    # Cells of level 0 are always kept, since fragments lie on them.
    visible[: counts[0]] = True
    visible[owner[owner >= counts[0]]] = True
    if not visible.all():
        visible_by_level = np.split(visible, np.cumsum(counts)[:-1])
        levels = [
            cells[is_visible]
            for cells, is_visible in zip(levels, visible_by_level, strict=True)
        ]
        owner = _paint(body, levels)
    gap = _assign_nearest(body, owner)
    return Assignment(owner=owner, gap=gap), levels


def _paint(
    body: Bool[np.ndarray, "x y z"], levels: LevelCells
) -> Int[np.ndarray, "x y z"]:
    """Number of the smallest cell that covers each voxel of the body, else -1."""
    # From coarse to fine, so that smaller cells overwrite larger ones.
    owner = np.full(body.shape, -1, np.int32)
    first = sum(len(cells) for cells in levels)
    for level in reversed(range(len(levels))):
        size = 1 << level
        cells = levels[level]
        first -= len(cells)
        number = np.arange(first, first + len(cells), dtype=np.int32)
        # As blocks, so that one index takes all voxels of a cell: [cell, x, y, z].
        shape = [n for axis in body.shape for n in (axis // size, size)]
        x, y, z = cells.T
        in_blocks = (x, slice(None), y, slice(None), z, slice(None))
        allowed = body.reshape(shape)[in_blocks]
        is_full = allowed.all(axis=(1, 2, 3), keepdims=True)
        allowed &= is_full | _joined_to_centre(size)
        blocks = owner.reshape(shape)
        cell_number = number[:, None, None, None]
        blocks[in_blocks] = np.where(allowed, cell_number, blocks[in_blocks])
    return owner


def _joined_to_centre(size: int) -> Bool[np.ndarray, "s s s"]:
    """Voxels of a cell that, if in the body, are connected to its centre within it."""
    # Half of the eight central voxels have a depth of `size` or more, so all eight have
    # size - 2, and every shorter path stays in the body. Voxels nearer to the corners
    # may belong to another part of the body, which no cell may connect.
    index = np.arange(size)
    steps = np.maximum(size // 2 - 1 - index, index - size // 2)
    total = steps[:, None, None] + steps[:, None] + steps
    return total < max(size - 2, 1)


def _assign_nearest(
    body: Bool[np.ndarray, "x y z"], owner: Int[np.ndarray, "x y z"]
) -> Int[np.ndarray, "x y z"]:
    """Assign voxels without an owner to the nearest one, in place.

    Returns the number of steps from each voxel to its owner.

    The body has an empty rim; voxels that it connects to no owner keep -1.
    """
    gap = np.zeros(body.shape, np.int16)
    flat_owner = owner.reshape(-1)
    flat_gap = gap.reshape(-1)
    unassigned = np.flatnonzero(body & (owner < 0))
    _, y, z = body.shape
    step = 0
    while len(unassigned):
        step += 1
        nearest = np.full(len(unassigned), -1, np.int32)
        # The first neighbour in lattice order decides: results are reproducible.
        for jump in (-y * z, -z, -1, 1, z, y * z):
            nearest = np.where(nearest < 0, flat_owner[unassigned + jump], nearest)
        reached = nearest >= 0
        if not reached.any():
            break
        flat_owner[unassigned[reached]] = nearest[reached]
        flat_gap[unassigned[reached]] = step
        unassigned = unassigned[~reached]
    return gap


def voxel_owner(structure: AbstractVoxelStructure) -> Int[np.ndarray, " v"]:
    """Node that the heat of each solid voxel is assigned to, in lattice order.

    A voxel in no node, as inside a shell, is assigned to the nearest node through the
    body; one that is connected to no node keeps -1.
    """
    node = structure.voxel_node()
    solid = structure.grid.solid
    if (node >= 0).all():
        return node
    owner = np.full(np.add(solid.shape, 2), -1, np.int32)
    padded = np.pad(solid, 1)
    owner[padded] = node
    _assign_nearest(padded, owner)
    return owner[padded]


def volume_within(
    structure: AbstractVoxelStructure, fraction: Float[np.ndarray, " v"]
) -> Float[np.ndarray, " n"]:
    """Volume of each node, of a fraction of each solid voxel in lattice order [m^3]."""
    owner = np.where(fraction > 0, voxel_owner(structure), -1)
    volume = structure.grid.volume_of(owner, structure.node_count, fraction)
    sharing = structure.sharing_node()
    return volume if sharing is None else volume[sharing] * structure.shared_fraction()
