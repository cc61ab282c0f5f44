"""Nested levels (thesis 4.3): layers of voxels from the surface inwards."""

from dataclasses import replace

import equinox as eqx
import numpy as np

from ...errors import InputError, whole_number
from ...voxels.grid import VoxelGrid
from ..build.blocks import build_blocks, index_type, number_by_first_voxel, voxel_layers
from ..cache import cached
from ..fit_card import as_weights
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


class MultiLevel(AbstractBuiltStructure):
    """The outer `levels` layers of voxels, linked over their faces.

    With at least as many levels as the body has layers it is the full volume.
    """

    grid: VoxelGrid = eqx.field(static=True)
    levels: int = eqx.field(static=True, default=10)
    hollow: str = eqx.field(static=True, default="empty")
    """Capacity of deeper voxels: "empty" drops it, "innermost" distributes it evenly
    over the nodes of the innermost level."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        self.levels = whole_number(self.levels, "MultiLevel(levels=)")
        if self.hollow not in ("empty", "innermost"):
            raise InputError(
                f'MultiLevel(hollow={self.hollow!r}): choose "empty" or "innermost"'
            )
        grid, levels, hollow = self.grid, self.levels, self.hollow
        options = {"levels": levels, "hollow": hollow}
        self.built = cached(
            "multilevel", grid, options, lambda: _build(grid, levels, hollow)
        )


def _build(grid: VoxelGrid, levels: int, hollow: str) -> Built:
    layer = voxel_layers(grid, levels)
    index = np.arange(layer.size, dtype=index_type(layer.shape)).reshape(layer.shape)
    labels, first = number_by_first_voxel(np.where(layer >= 0, index, -1))
    built = build_blocks(grid, labels, layer.reshape(-1)[first])
    if hollow == "empty":
        return built
    nodes = built.nodes
    innermost = nodes.level == nodes.level.max()
    missing = (grid.solid_count - len(first)) * grid.voxel_volume
    volume = nodes.volume + innermost * (missing / np.count_nonzero(innermost))
    return replace(built, nodes=nodes._replace(volume=volume))
