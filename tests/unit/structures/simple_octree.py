"""Octree cells as the label of every voxel: the simple version of `partition.cubes`."""

import numpy as np

from jaxthermo.structures.partition.blocks import build_blocks, number_by_first_voxel
from jaxthermo.structures.partition.cubes import _halve, _with_neighbours


def build_octree(grid, levels):
    """Octree as groups of voxels with equal labels, linked voxel face by voxel face."""
    labels, first = number_by_first_voxel(octree_cells(grid.solid, levels))
    built = build_blocks(grid, labels, np.zeros(len(first), np.int32))
    size = np.cbrt(np.bincount(labels[labels >= 0]))
    return built, np.rint(np.log2(size)).astype(np.int32)


def octree_cells(solid, levels):
    """Index of the first voxel, in lattice order, of each voxel's cell; -1 if empty."""
    possible = [solid]
    filled = solid
    while levels is None or len(possible) < levels:
        filled = _halve(filled)
        inner = _with_neighbours(filled)
        if not inner.any():
            break
        possible.append(inner)
    # From coarse to fine: a cell is taken only where no larger one was.
    first = np.full((0, 0, 0), -1, np.int64)
    for level in reversed(range(len(possible))):
        first = _refine(first, possible[level])
        new = np.nonzero(possible[level] & (first < 0))
        corner = tuple(index << level for index in new)
        first[new] = np.ravel_multi_index(corner, solid.shape)
    return first


def _refine(coarse, like):
    """Repeat each entry on eight cells of half the size; -1 beyond the coarse ones."""
    fine = np.full(like.shape, -1, coarse.dtype)
    u, v, w = coarse.shape
    fine[: 2 * u, : 2 * v, : 2 * w] = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    return fine
