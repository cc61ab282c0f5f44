"""Aggregates: blocks of voxels with their true volume and open faces."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError, positive_length, whole_number
from ...voxels.grid import VoxelGrid
from ..cache import built_once
from ..partition.blocks import block_parts, count_blocks, number_by_first_voxel
from ..partition.links import link_distance
from ..partition.slabs import Slab, build_slabs, count_parts
from ..structure import AbstractBuiltStructure, Built, check_grid


# A compromise: at factor 4 it more than halves the number of steps and adds 0.05 % of
# error.
_MIN_TIME_CONSTANT = 0.45

# Thickness over the edge of a block below which a part is thin: parts of one voxel in
# blocks of more than 8. At 32 such an end took a third of a bar's heat.
_THIN = 1 / 8

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

    factor: int = eqx.field(static=True, default=4)
    """Voxels along an edge of a block; 1 is the full volume."""
    min_time_constant: float = eqx.field(
        static=True, kw_only=True, default=_MIN_TIME_CONSTANT
    )
    """Smallest time constant of a node relative to a whole block's [-]; 0: no limit."""
    alignment: float = eqx.field(static=True, kw_only=True, default=_ALIGNMENT)
    """Location of nodes between their centre (0) and the middle of their block (1)."""

    @staticmethod
    def factor_for(
        grid: VoxelGrid, *, nodes: int | None = None, size: float | None = None
    ) -> int:
        """Factor by the number of nodes, or by the size of a block.

        Args:
            grid: of the body.
            nodes: largest number of nodes; the smallest factor that keeps to it.
            size: edge of a block [m], rounded to whole voxels.

        Raises:
            InputError: unless one of the two is given, or for a number of nodes below
                that of the body's parts, or a size below the pitch.

        Example:
            >>> import jaxthermo as jt
            >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.005)
            >>> jt.Aggregate.factor_for(grid, nodes=30)
            3
        """
        check_grid(grid, "Aggregate.factor_for")
        if (nodes is None) == (size is None):
            raise InputError("Aggregate.factor_for: give nodes= or size=, one of them")
        return _factor_of_size(grid, size) if nodes is None else _finest(grid, nodes)

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
        self.built = built_once(
            "aggregate", grid=self.grid, options=options, build=_build
        )


def _factor_of_size(grid: VoxelGrid, size: Any) -> int:
    size = positive_length("Aggregate.factor_for(size=)", size)
    # A block of a voxel may be a rounding error below the pitch.
    if size < grid.pitch * (1 - 1e-6):
        raise InputError(
            f"Aggregate.factor_for(size={size:g}): a block has the edge of a voxel, "
            f"{grid.pitch:g} m, at least: give more, or a finer pitch"
        )
    return round(size / grid.pitch)


def _finest(grid: VoxelGrid, nodes: Any) -> int:
    """Smallest factor with at most so many nodes."""
    nodes = whole_number(nodes, "Aggregate.factor_for(nodes=)")
    solid = grid.solid
    # Whole blocks in a body without a surface would be the fewest.
    first = int(np.cbrt(max(grid.solid_count - 1, 0) / nodes)) or 1
    for factor in range(first, max(solid.shape) + 1):
        # Blocks first: they need no labelling of connected parts, and are no more.
        if count_blocks(solid, factor) > nodes:
            continue
        if count_parts(solid, factor) <= nodes:
            return factor
    separate = count_parts(solid, max(solid.shape))
    raise InputError(
        f"Aggregate.factor_for(nodes={nodes}): the body has {separate} parts that do "
        "not touch, and each needs a node: give more"
    )


def _build(
    grid: VoxelGrid, factor: int, min_time_constant: float, alignment: float
) -> Built:
    factor = min(factor, max(grid.solid.shape))
    built = build_slabs(
        grid,
        factor=factor,
        surface_nodes=0,
        slab_of=lambda x: _numbered(grid.solid[x], factor),
    )
    edge = factor * grid.pitch
    corner = grid.lattice.origin
    # A centre is at least half a voxel inside its block, whatever voxels are solid.
    block = ((built.nodes.centre - corner) / edge).astype(np.int64)
    thin = _thin_parts(built, edge * grid.volume_ratio)
    aligned = np.where(thin.is_thin, 0.0, alignment)
    built = _align_nodes(
        built, block=block, corner=corner, edge=edge, alignment=aligned
    )
    # A whole block with six neighbours has V / sum A / L = (factor pitch)^2 / 6.
    minimum = min_time_constant * (edge**2 / 6 * grid.volume_ratio)
    return _limit_small_nodes(_refill(built, thin, minimum), minimum)


def _numbered(solid: Bool[np.ndarray, "x y z"], factor: int) -> Slab:
    """Number the parts of blocks in the order of the blocks."""
    labels, first = number_by_first_voxel(block_parts(solid, factor))
    # Lattice order of the blocks: neighbours along z are adjacent in memory.
    block = np.stack(np.unravel_index(first, labels.shape)) // factor
    shape = block.max(axis=1, initial=0) + 1
    order = np.argsort(np.ravel_multi_index(tuple(block), shape), kind="stable")
    # The last entry maps the label -1 to itself.
    number = np.full(len(order) + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    return Slab(labels=number[labels], level=np.zeros(len(order), np.int32))


class _ThinParts(NamedTuple):
    """Parts of blocks that are slices of a voxel or a few on one face of the block."""

    is_thin: Bool[np.ndarray, " n"]
    donor: Int[np.ndarray, " n"]
    """Node of a whole block next to each part, over the part's largest face."""


def _thin_parts(built: Built, edge: float) -> _ThinParts:
    """Find the parts whose volume over their largest face is far below an edge [m]."""
    links = built.links
    volume = built.nodes.volume
    node = np.concatenate([links.src, links.dst])
    opposite = np.concatenate([links.dst, links.src])
    area = np.concatenate([links.area, links.area])
    # Written in rising order, the largest area remains.
    order = np.argsort(area, kind="stable")
    neighbour = np.arange(len(volume))
    largest = np.zeros(len(volume))
    neighbour[node[order]] = opposite[order]
    largest[node[order]] = area[order]
    # A part is at least a voxel thick: up to a factor of 8 none is thin.
    is_thin = volume < _THIN * (1 - 1e-9) * edge * largest
    # Beyond an edge or a corner of a block the first neighbours are thin, too.
    for _ in range(2):
        neighbour = np.where(is_thin[neighbour], neighbour[neighbour], neighbour)
    return _ThinParts(is_thin=is_thin, donor=neighbour)


def _align_nodes(
    built: Built,
    block: Int[np.ndarray, "n 3"],
    corner: Float[np.ndarray, "3"],
    edge: float,
    alignment: Float[np.ndarray, " n"],
) -> Built:
    """Move nodes towards the middle of their block and adapt the links."""
    # The difference of two nodes gives the flux where the line between them is normal
    # to the face. Centres of partly filled blocks are not aligned along a surface: a
    # gradient across it looks like one along it. Middles of blocks are aligned, but the
    # temperature of a node is not that of its middle. In between both errors are small.
    links = built.links
    centre = built.nodes.centre
    src = links.src
    dst = links.dst
    axis = np.argmax(block[src] != block[dst], axis=1)
    linked = np.zeros(block.shape, bool)
    linked[src, axis] = linked[dst, axis] = True
    # Without a neighbour along an axis, as across a thin sheet, a node stays.
    middle = corner + (block + 0.5) * edge
    shift = np.where(linked, middle - centre, 0)
    location = centre + alignment[:, None] * shift
    row = np.arange(len(src))
    face = corner[axis] + np.maximum(block[src], block[dst])[row, axis] * edge
    to_src, to_dst = (np.abs(face - location[end, axis]) for end in (src, dst))
    normal = to_src + to_dst
    straight = np.linalg.norm(location[dst] - location[src], axis=1)
    links = links._replace(distance_src=to_src, distance_dst=to_dst)
    links = links.lengthened(link_distance(normal, straight) / normal)
    return replace(built, nodes=built.nodes._replace(location=location), links=links)


def _conductance(built: Built) -> Float[np.ndarray, " n"]:
    """Sum of A / L over the links of each node [m]."""
    links = built.links
    count = len(built.nodes.volume)
    conductance = links.area / links.length
    of_src = np.bincount(links.src, conductance, count)
    # Without links both are whole numbers.
    return 0.0 + of_src + np.bincount(links.dst, conductance, count)


def _refill(built: Built, thin: _ThinParts, minimum: float) -> Built:
    """Give thin parts with V / sum_j(A_j / L_j) below `minimum` volume of a neighbour.

    The total stays, and no neighbour falls below the minimum itself.
    """
    # Longer links would shut the end of a bar that reaches a voxel into a block of 32.
    # A thin part has nearly its neighbour's temperature: it does not matter which of
    # the two stores the heat.
    volume = built.nodes.volume
    spare = volume - minimum * _conductance(built)
    missing = np.where(thin.is_thin, np.maximum(-spare, 0), 0)
    available = np.where(thin.is_thin, 0, np.maximum(spare, 0))
    demand = np.bincount(thin.donor, missing, len(volume))
    met_fraction = np.minimum(1, available / np.where(demand > 0, demand, 1))
    gain = missing * met_fraction[thin.donor]
    volume = volume + gain - np.bincount(thin.donor, gain, len(volume))
    return replace(built, nodes=built.nodes._replace(volume=volume))


def _limit_small_nodes(built: Built, minimum: float) -> Built:
    """Lengthen the links of nodes with V / sum_j(A_j / L_j) below `minimum` [m^2]."""
    # The explicit step is limited by the smallest time constant C / sum_j G_j, for one
    # material V / (alpha sum_j A_j / L_j). That of a few thin parts of blocks is far
    # below a whole block's. They follow their neighbours anyway; with longer links they
    # follow a little later. Capacities and areas stay, so no heat is lost.
    links = built.links
    volume = built.nodes.volume
    total = _conductance(built)
    # Fraction of its conductance that a node keeps: 1 where it is large enough.
    fraction = np.minimum(1.0, volume / np.maximum(total * minimum, volume))
    stretch = 1 / np.minimum(fraction[links.src], fraction[links.dst])
    return replace(built, links=links.lengthened(stretch))
