"""Nodes, links and surface of any division of the voxels: labels in, a structure out.

A label volume holds the node of every voxel, -1 where there is none. Nodes are numbered
in the lattice order of their first voxels, so that neighbours lie close in memory.
"""

import numpy as np
from jaxtyping import Bool, Int
from skimage import measure

from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_voxels
from ..structure import Built, Nodes
from .links import block_links, voxel_links


def index_type(shape: tuple[int, ...]) -> np.dtype:
    """Integers that can number all cells of a lattice: int32, or int64 if need be."""
    return np.promote_types(np.int32, np.min_scalar_type(-int(np.prod(shape))))


def number_by_first_voxel(
    first: Int[np.ndarray, "x y z"],
) -> tuple[Int[np.ndarray, "x y z"], Int[np.ndarray, " n"]]:
    """Labels from 0 without gaps.

    Args:
        first: for each voxel the number, in lattice order, of the first voxel of its
            node; -1 for voxels in no node.

    Returns:
        The labels, and the first voxel of each node.
    """
    flat = first.reshape(-1)
    covered = np.flatnonzero(flat >= 0)
    theirs = flat[covered]
    leads = theirs == covered
    # Only the entries at first voxels are read.
    number = np.zeros(len(flat), np.int32)
    number[covered] = np.cumsum(leads, dtype=np.int32) - 1
    labels = np.full(len(flat), -1, np.int32)
    labels[covered] = number[theirs]
    return labels.reshape(first.shape), covered[leads]


def build_blocks(
    grid: VoxelGrid, labels: Int[np.ndarray, "x y z"], level: Int[np.ndarray, " n"]
) -> Built:
    """A structure whose nodes are groups of voxels.

    Args:
        grid: the body.
        labels: node of each voxel, -1 for none; every number below n occurs, and every
            voxel with a fragment has one.
        level: of each node.
    """
    covered = np.flatnonzero(labels.reshape(-1) >= 0)
    node = labels.reshape(-1)[covered]
    voxels = np.bincount(node, minlength=len(level))
    place = np.unravel_index(covered, labels.shape)
    total = [np.bincount(node, index, len(level)) for index in place]
    centre = np.stack(total, axis=1) / voxels[:, None] + 0.5
    if np.array_equal(node, np.arange(len(level))):
        links = voxel_links(labels, grid.pitch)
    else:
        links = block_links(labels, centre, grid.pitch)
    middle = grid.lattice.origin + centre * grid.pitch
    return Built(
        nodes=Nodes(
            centre=middle,
            volume=voxels * grid.voxel_volume,
            level=level.astype(np.int32),
            place=middle,
        ),
        links=links,
        fragment_node=labels[tuple(grid.fragment_voxel.T)],
        voxel_node=labels[grid.solid].astype(np.int32),
    )


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


def voxel_layers(grid: VoxelGrid, most: int) -> Int[np.ndarray, "x y z"]:
    """Number of the layer of each voxel, 0 at the surface; -1 outside and deeper.

    Layer 0 are the solid voxels with an empty face neighbour, and the few others that
    carry a fragment; layer i + 1 are the face neighbours of layer i not yet reached.

    Args:
        grid: the body.
        most: how many layers to take off.
    """
    padded = np.pad(grid.solid, 1)
    _, y, z = padded.shape
    waiting = padded.reshape(-1)
    layer = np.full(waiting.shape, -1, np.int32)
    first = tuple(shell_voxels(grid).T + 1)
    front = np.asarray(np.ravel_multi_index(first, padded.shape))
    waiting[front] = False
    layer[front] = 0
    for number in range(1, most):
        reached = []
        for jump in (-y * z, -z, -1, 1, z, y * z):
            near = front + jump
            near = near[waiting[near]]
            waiting[near] = False
            reached.append(near)
        front = np.concatenate(reached)
        if not len(front):
            break
        layer[front] = number
    return layer.reshape(padded.shape)[1:-1, 1:-1, 1:-1]


def shell_voxels(grid: VoxelGrid) -> Int[np.ndarray, "m 3"]:
    """Voxels with an open face or a surface fragment, in lattice order."""
    exposed = surface_voxels(grid.solid)
    in_shell = np.zeros(grid.solid.shape, bool)
    in_shell[tuple(exposed.T)] = True
    in_shell[tuple(grid.fragment_voxel.T)] = True
    return np.argwhere(in_shell)
