"""Aggregates: blocks of voxels with their true volume and open faces."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError, whole_number
from ...voxels.grid import VoxelGrid
from ..build.blocks import block_parts, build_blocks, number_by_first_voxel
from ..build.links import link_distance
from ..cache import cached
from ..structure import AbstractBuiltStructure, Built, ConductionWeights, as_weights


# More than halves the number of steps at factor 4 and adds 0.05 % of error.
_MIN_TIME_CONSTANT = 0.45

# Halved the error of a heated bust and reduced that of a statue and a bunny by a fifth,
# at factors 2 to 4; between 0.5 and 0.8 it hardly matters.
_ALIGNMENT = 0.7


class Aggregate(AbstractBuiltStructure):
    """Blocks of factor^3 voxels, each with the volume and centre of its solid voxels.

    Disconnected parts of a block are separate nodes, so that heat does not cross a gap.
    Blocks at the upper ends of the lattice may be incomplete.

    Raises:
        InputError: for a factor below 1, or other options outside 0 to 1.
    """

    grid: VoxelGrid = eqx.field(static=True)
    factor: int = eqx.field(static=True, default=4)
    """Voxels along an edge of a block; 1 is the full volume."""
    min_time_constant: float = eqx.field(
        static=True, kw_only=True, default=_MIN_TIME_CONSTANT
    )
    """Smallest time constant of a node relative to a whole block's [-]; 0: no limit."""
    alignment: float = eqx.field(static=True, kw_only=True, default=_ALIGNMENT)
    """Location of nodes between their centre (0) and the middle of their block (1)."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        self.factor = whole_number(self.factor, "Aggregate(factor=)")
        fractions = {
            "min_time_constant": float(self.min_time_constant),
            "alignment": float(self.alignment),
        }
        for name, value in fractions.items():
            if not 0 <= value <= 1:
                raise InputError(
                    f"Aggregate({name}={value!r}): give a number from 0 to 1"
                )
        options = {"factor": self.factor, **fractions}
        self.built = cached("aggregate", self.grid, options, _build)


def _build(
    grid: VoxelGrid, factor: int, min_time_constant: float, alignment: float
) -> Built:
    factor = min(factor, max(grid.solid.shape))
    labels, first = number_by_first_voxel(block_parts(grid.solid, factor))
    # Lattice order of the blocks: neighbours along z are adjacent in memory.
    block = np.stack(np.unravel_index(first, labels.shape)) // factor
    shape = block.max(axis=1) + 1
    order = np.argsort(np.ravel_multi_index(tuple(block), shape), kind="stable")
    # The last entry maps the label -1 to itself.
    number = np.full(len(order) + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    built = build_blocks(grid, number[labels], np.zeros(len(order), np.int32))
    edge, corner = factor * grid.pitch, grid.lattice.origin
    built = _align_nodes(built, block.T[order], corner, edge, alignment)
    # A whole block with six neighbours has V / sum A / L = (factor pitch)^2 / 6.
    whole = (factor * grid.pitch) ** 2 / 6 * grid.volume_ratio
    limit = min_time_constant * whole
    return _limit_small_nodes(built, limit) if limit else built


def _align_nodes(
    built: Built,
    block: Int[np.ndarray, "n 3"],
    corner: Float[np.ndarray, "3"],
    edge: float,
    alignment: float,
) -> Built:
    """Move nodes towards the middle of their block and adapt the links."""
    # The difference of two nodes gives the flux where the line between them is normal
    # to the face. Centres of partly filled blocks are not aligned along a surface: a
    # gradient across it looks like one along it. Middles of blocks are aligned, but the
    # temperature of a node is not that of its middle. In between both errors are small.
    links, centre = built.links, built.nodes.centre
    src, dst = links.src, links.dst
    axis = np.argmax(block[src] != block[dst], axis=1)
    linked = np.zeros(block.shape, bool)
    linked[src, axis] = linked[dst, axis] = True
    # Without a neighbour along an axis, as across a thin sheet, a node stays.
    middle = corner + (block + 0.5) * edge
    location = centre + alignment * np.where(linked, middle - centre, 0)
    row = np.arange(len(src))
    face = corner[axis] + np.maximum(block[src], block[dst])[row, axis] * edge
    to_src, to_dst = (np.abs(face - location[end, axis]) for end in (src, dst))
    normal = to_src + to_dst
    straight = np.linalg.norm(location[dst] - location[src], axis=1)
    links = links._replace(distance_src=to_src, distance_dst=to_dst)
    links = links.lengthened(link_distance(normal, straight) / normal)
    return replace(built, nodes=built.nodes._replace(location=location), links=links)


def _limit_small_nodes(built: Built, minimum: float) -> Built:
    """Lengthen the links of nodes with V / sum_j(A_j / L_j) below `minimum` [m^2]."""
    # The explicit step is limited by the smallest time constant C / sum_j G_j, for one
    # material V / (alpha sum_j A_j / L_j). That of a few thin parts of blocks is far
    # below a whole block's. They follow their neighbours anyway; with longer links they
    # follow a little later. Capacities and areas stay, so no heat is lost.
    links, volume = built.links, built.nodes.volume
    conductance = links.area / (links.distance_src + links.distance_dst)
    total = np.bincount(links.src, conductance, len(volume))
    total += np.bincount(links.dst, conductance, len(volume))
    # Fraction of its conductance that a node keeps: 1 where it is large enough.
    kept = np.minimum(1.0, volume / np.maximum(total * minimum, volume))
    stretch = 1 / np.minimum(kept[links.src], kept[links.dst])
    return replace(built, links=links.lengthened(stretch))
