"""Growing voxels: blocks of voxels with their true volume and open faces."""

import equinox as eqx
import numpy as np

from ...errors import InputError
from ...voxels.grid import VoxelGrid
from ..build.block_parts import block_parts
from ..build.blocks import build_blocks, number_by_first_voxel
from ..build.node_alignment import in_line
from ..build.small_cell_limiter import hold_back
from ..cache import cached
from ..fit_card import as_weights
from ..options import whole_number
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


LEAST_TIME_CONSTANT = 0.45
"""By default: more than halves the steps at factor 4 and adds 0.05 % of error."""

ALIGNMENT = 0.7
"""By default: halved the error of a heated bust and took a fifth off a statue's and a
bunny's, at factors 2 to 4; between 0.5 and 0.8 it hardly matters."""


class Aggregate(AbstractBuiltStructure):
    """Blocks of factor^3 voxels, each with the volume and centre of what is solid.

    Parts of a block that do not touch inside it are nodes of their own, so that heat
    does not leap across a gap. Blocks at the upper ends of the lattice may be cut.
    Where nodes stand, see `alignment`.
    """

    grid: VoxelGrid = eqx.field(static=True)
    factor: int = eqx.field(static=True, default=4)
    """Voxels along an edge of a block; 1 is the full volume."""
    least_time_constant: float = eqx.field(
        static=True, kw_only=True, default=LEAST_TIME_CONSTANT
    )
    """That slivers are held to, of a whole block's inside the body; 0 for none."""
    alignment: float = eqx.field(static=True, kw_only=True, default=ALIGNMENT)
    """How far nodes stand from their centre (0) towards the middle of their block (1),
    in line with their neighbours."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        self.factor = whole_number(self.factor, "Aggregate(factor=)")
        grid, factor = self.grid, self.factor
        options = {
            "least_time_constant": float(self.least_time_constant),
            "alignment": float(self.alignment),
        }
        for name, value in options.items():
            if not 0 <= value <= 1:
                raise InputError(
                    f"Aggregate({name}={value!r}): give a number from 0 to 1"
                )
        self.built = cached(
            "aggregate",
            grid,
            {"factor": factor, **options},
            lambda: _build(grid, factor, *options.values()),
        )


def _build(grid: VoxelGrid, factor: int, least: float, alignment: float) -> Built:
    factor = min(factor, max(grid.solid.shape))
    labels, first = number_by_first_voxel(block_parts(grid.solid, factor))
    # Blocks in lattice order: neighbours along z follow one another in memory.
    block = np.stack(np.unravel_index(first, labels.shape)) // factor
    shape = block.max(axis=1) + 1
    order = np.argsort(np.ravel_multi_index(tuple(block), shape), kind="stable")
    # The last entry serves the label -1.
    number = np.full(len(order) + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    built = build_blocks(grid, number[labels], np.zeros(len(order), np.int32))
    edge, corner = factor * grid.pitch, grid.lattice.origin
    built = in_line(built, block.T[order], corner, edge, alignment)
    # Of a whole block with six neighbours: V / sum A / L = (factor pitch)^2 / 6.
    whole = (factor * grid.pitch) ** 2 / 6 * grid.volume_ratio
    return hold_back(built, least * whole) if least else built
