"""Octree: large cells deep inside, single voxels at the surface."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Int

from ...errors import whole_number
from ...voxels.grid import VoxelGrid
from ..build.blocks import build_blocks, index_type, number_by_first_voxel
from ..cache import cached
from ..fit_card import as_weights
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


class Octree(AbstractBuiltStructure):
    """Cells of 1, 2, 4, ... voxels per edge, as large as possible inside the body.

    A cell exists where it and its 26 neighbours of the same size are entirely solid.
    """

    # Hence neighbours, over corners too, differ by at most one level: the neighbours of
    # a cell's children all lie in the cell's neighbours, so they could exist there.

    grid: VoxelGrid = eqx.field(static=True)
    levels: int | None = eqx.field(static=True, default=None)
    """Number of cell sizes; 1 for single voxels only, None for no limit."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        if self.levels is not None:
            self.levels = whole_number(self.levels, "Octree(levels=)")
        grid, levels = self.grid, self.levels
        self.built = cached(
            "octree", grid, {"levels": levels}, lambda: _build(grid, levels)
        )


def _build(grid: VoxelGrid, levels: int | None) -> Built:
    labels, first = number_by_first_voxel(octree_cells(grid.solid, levels))
    built = build_blocks(grid, labels, np.zeros(len(first), np.int32))
    size = np.cbrt(built.nodes.volume / grid.voxel_volume)
    level = np.rint(np.log2(size)).astype(np.int32)
    return replace(built, nodes=built.nodes._replace(level=level))


def octree_cells(
    solid: Bool[np.ndarray, "x y z"], levels: int | None
) -> Int[np.ndarray, "x y z"]:
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
    first = np.full((0, 0, 0), -1, index_type(solid.shape))
    for level in reversed(range(len(possible))):
        first = _refine(first, possible[level])
        new = np.nonzero(possible[level] & (first < 0))
        corner = tuple(index << level for index in new)
        first[new] = np.ravel_multi_index(corner, solid.shape)
    return first


def _halve(filled: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "u v w"]:
    """Flag the entirely solid cells of twice the size; an odd last plane is dropped."""
    for axis in range(3):
        along = np.moveaxis(filled, axis, 0)
        pairs = along[: len(along) // 2 * 2]
        filled = np.moveaxis(pairs[::2] & pairs[1::2], 0, axis)
    return filled


def _with_neighbours(filled: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Flag the cells that are solid together with all 26 neighbours."""
    for axis in range(3):
        along = np.moveaxis(filled, axis, 0)
        inner = np.zeros_like(along)
        inner[1:-1] = along[:-2] & along[1:-1] & along[2:]
        filled = np.moveaxis(inner, 0, axis)
    return filled


def _refine(
    coarse: Int[np.ndarray, "u v w"], like: Bool[np.ndarray, "x y z"]
) -> Int[np.ndarray, "x y z"]:
    """Repeat each entry on eight cells of half the size; -1 beyond the coarse ones."""
    fine = np.full(like.shape, -1, coarse.dtype)
    u, v, w = coarse.shape
    fine[: 2 * u, : 2 * v, : 2 * w] = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    return fine
