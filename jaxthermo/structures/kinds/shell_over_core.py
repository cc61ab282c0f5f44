"""Single voxels at the surface over a core of blocks."""

import equinox as eqx
import numpy as np

from ...errors import whole_number
from ...voxels.grid import VoxelGrid
from ..build.blocks import (
    block_parts,
    build_blocks,
    number_by_first_voxel,
    voxel_layers,
)
from ..cache import cached
from ..fit_card import as_weights
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


class ShellOverCore(AbstractBuiltStructure):
    """Layers of single voxels (level 0) over blocks of factor^3 voxels (level 1)."""

    grid: VoxelGrid = eqx.field(static=True)
    layers: int = eqx.field(static=True, default=1)
    factor: int = eqx.field(static=True, default=4)
    """Voxels along an edge of a block of the core."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        self.layers = whole_number(self.layers, "ShellOverCore(layers=)")
        self.factor = whole_number(self.factor, "ShellOverCore(factor=)")
        grid, layers, factor = self.grid, self.layers, self.factor
        options = {"layers": layers, "factor": factor}
        self.built = cached(
            "shell_over_core", grid, options, lambda: _build(grid, layers, factor)
        )


def _build(grid: VoxelGrid, layers: int, factor: int) -> Built:
    fine = voxel_layers(grid, layers) >= 0
    voxel = block_parts(grid.solid & ~fine, factor)
    # Single voxels are their own first voxel.
    voxel[fine] = np.flatnonzero(fine)
    labels, first = number_by_first_voxel(voxel)
    return build_blocks(grid, labels, ~fine.reshape(-1)[first] * 1)
