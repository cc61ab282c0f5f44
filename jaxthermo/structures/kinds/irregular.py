"""Irregular levels (thesis 4.3): shells inside shells, each of cells twice as large."""

import equinox as eqx
import numpy as np
from jaxtyping import Int

from ...voxels.grid import VoxelGrid
from ..build.irregular_cells import LevelCells, nested_cells, voxel_depth
from ..build.irregular_links import irregular_links
from ..build.voxel_assignment import divide
from ..cache import cached
from ..coverage import Coverage, cover_count, coverage
from ..fit_card import as_weights
from ..options import whole_number
from ..structure import AbstractBuiltStructure, Built, Nodes
from ..weights import ConductionWeights
from .shell import fragment_rank


class IrregularMultiLevel(AbstractBuiltStructure):
    """The shell, and inside it copies at half the resolution of the one above.

    Cells of level l are cubes of 2^l voxels on a lattice of their own, so they overlap
    or leave cracks wherever the body is not made of such cubes: `coverage` says how
    much. A node's capacity is that of its whole cube, as in the thesis; the total is
    `capacity_ratio` of the body's. Material in cracks conducts but stores no heat.

    Raises:
        InputError: unless `levels` is a whole number of at least 1.
    """

    grid: VoxelGrid = eqx.field(static=True)
    levels: int | None = eqx.field(static=True, default=None)
    """At most so many; without, as many as fit. What lies deeper is left empty."""
    keep_capacity: bool = eqx.field(static=True, default=False)
    """Scale all capacities by one factor, so that the total is the body's."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        if self.levels is not None:
            self.levels = whole_number(self.levels, "IrregularMultiLevel(levels=)")
        self.keep_capacity = bool(self.keep_capacity)
        options = {"levels": self.levels, "keep_capacity": self.keep_capacity}
        self.built = cached("irregular_multi_level", self.grid, options, self._build)

    def _build(self) -> Built:
        grid, pitch = self.grid, self.grid.pitch
        depth = voxel_depth(grid)
        levels = nested_cells(depth)
        body = depth > 0
        if self.levels is not None and self.levels < len(levels):
            levels = levels[: self.levels]
            # Deeper than all cells of these levels there is nothing to conduct.
            body &= depth <= 1 << self.levels
        territory, levels = divide(body, levels)
        x, y, z = grid.solid.shape
        return Built(
            nodes=self._nodes(levels),
            links=irregular_links(levels, territory, pitch),
            fragment_node=fragment_rank(grid, levels[0] - 1),
            # The division has one empty voxel before the grid's first.
            voxel_node=territory.owner[1 : x + 1, 1 : y + 1, 1 : z + 1][grid.solid],
        )

    def _nodes(self, levels: LevelCells) -> Nodes:
        """One node a cell, level by level."""
        grid = self.grid
        counts = [len(cells) for cells in levels]
        level = np.repeat(np.arange(len(levels), dtype=np.int32), counts)
        size = (1 << level)[:, None]
        # The cells are counted from one voxel before the grid's first.
        middle = (np.concatenate(levels) + 0.5) * size - 1
        volume = size[:, 0] ** 3 * grid.voxel_volume
        if self.keep_capacity:
            volume *= grid.solid_count * grid.voxel_volume / volume.sum()
        centre = grid.origin + middle * grid.pitch
        return Nodes(centre, volume, level, centre)

    @property
    def level_count(self) -> int:
        """How many levels there are."""
        return int(self.built.nodes.level.max(initial=-1)) + 1

    def cover_count(self) -> Int[np.ndarray, "x y z"]:
        """How many nodes cover each voxel of the lattice."""
        return cover_count(self.grid, self.built.nodes)

    def coverage(self) -> Coverage:
        """Overlap, cracks and what sticks out, as shares of the body."""
        return coverage(self.grid, self.cover_count())
