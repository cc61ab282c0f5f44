"""Growing voxels: blocks of voxels with their true volume and open faces."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError, whole_number
from ...voxels.grid import VoxelGrid
from ..build.blocks import block_parts, build_blocks, number_by_first_voxel
from ..build.links import link_distance
from ..cache import cached
from ..fit_card import as_weights
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


MIN_TIME_CONSTANT = 0.45
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
    min_time_constant: float = eqx.field(
        static=True, kw_only=True, default=MIN_TIME_CONSTANT
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
            "min_time_constant": float(self.min_time_constant),
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


def in_line(
    built: Built,
    block: Int[np.ndarray, "n 3"],
    corner: Float[np.ndarray, "3"],
    edge: float,
    alignment: float,
) -> Built:
    """The same structure with its nodes moved, and its links as long as they then are.

    A node without a neighbour along an axis stays where it is on it: a thin sheet has
    nothing to be in line with across.

    Args:
        built: nodes that are parts of cubic blocks.
        block: of each, its place among the blocks.
        corner: of the first block [m].
        edge: of a block [m].
        alignment: how far to move, from the centre (0) to the middle of the block (1).
    """
    links, centre = built.links, built.nodes.centre
    src, dst = links.src, links.dst
    axis = np.argmax(block[src] != block[dst], axis=1)
    linked = np.zeros(block.shape, bool)
    linked[src, axis] = linked[dst, axis] = True
    middle = corner + (block + 0.5) * edge
    place = centre + alignment * np.where(linked, middle - centre, 0)
    row = np.arange(len(src))
    face = corner[axis] + np.maximum(block[src], block[dst])[row, axis] * edge
    to_src, to_dst = (np.abs(face - place[end, axis]) for end in (src, dst))
    normal = to_src + to_dst
    straight = np.linalg.norm(place[dst] - place[src], axis=1)
    longer = link_distance(normal, straight) / normal
    return replace(
        built,
        nodes=built.nodes._replace(place=place),
        links=links._replace(
            distance_src=to_src * longer, distance_dst=to_dst * longer
        ),
    )


def hold_back(built: Built, least: float) -> Built:
    """The same structure with the links of slivers lengthened.

    Args:
        built: nodes and links.
        least: time constant that no node is below, times the diffusivity [m^2].
    """
    links, volume = built.links, built.nodes.volume
    conductance = links.area / (links.distance_src + links.distance_dst)
    total = np.bincount(links.src, conductance, len(volume))
    total += np.bincount(links.dst, conductance, len(volume))
    share = _share(volume, total * least)
    stretch = 1 / np.minimum(share[links.src], share[links.dst])
    longer = links._replace(
        distance_src=links.distance_src * stretch,
        distance_dst=links.distance_dst * stretch,
    )
    return replace(built, links=longer)


def _share(
    volume: Float[np.ndarray, " n"], needed: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Of their conductances, what nodes may keep: 1 where they are large enough."""
    return np.minimum(1.0, volume / np.maximum(needed, volume))
