"""Nodes, links and surface of any division of the voxels: labels in, a structure out.

A label volume holds the node of every voxel, -1 where there is none. Nodes are numbered
in the lattice order of their first voxels, so that neighbours lie close in memory.
"""

import numpy as np
from jaxtyping import Int

from ...voxels.grid import VoxelGrid
from ..structure import Built, Nodes
from .block_links import block_links
from .voxel_links import voxel_links


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
