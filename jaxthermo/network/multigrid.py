"""Multigrid preconditioner of any network, for implicit steps and steady states.

It is built in two steps. The levels depend on the conductances alone and are built
once; the cycle is cheap and is built for every diagonal m (another time step, another
air). The levels of a lattice are its blocks of 2 x 2 x 2 cells, recursively; those of
nodes and links are connected groups of nodes in cubic blocks, whose edges double too.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import members, taken
from ..geometry.mesh import connected_labels
from ..memo.found import on_device
from ..structures.structure import AbstractStructure
from .column_cycle import column_cycle
from .column_network import ColumnNetwork
from .cut_stencil import CutStencil
from .link_operator import LinkNetwork, RowLayout, RowNetwork, row_layout, row_network
from .multigrid_cycle import (
    AbstractCycle,
    AbstractTransfer,
    JacobiCycle,
    MultigridCycle,
    dense_solve,
    level,
)
from .network import AbstractNetwork, AbstractNodeNetwork, inverse, slot_sums
from .stencil import HeterogeneousStencil, Stencil


MAX_DENSE_SIZE = 256
"""Largest number of values of a state that is solved directly."""

# Levels that keep more than this fraction of the nodes are skipped.
_MAX_SIZE_RATIO = 0.9


class _LatticeTransfer(AbstractTransfer):
    """Transfer between a lattice and its blocks, with one empty cell on each side."""

    shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the fine lattice [cells]."""

    @override
    def restrict(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        values = fine[1:-1, 1:-1, 1:-1]
        for axis in range(3):
            values = _pair_sum(values, axis)
        return jnp.pad(values, 1)

    @override
    def prolong(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        # The loop makes it an array: otherwise XLA repeats the smoothing for each cell.
        values = jax.lax.map(_doubled_along_z, coarse[1:-1, 1:-1, 1:-1])
        for axis in range(2):
            values = jnp.repeat(values, 2, axis=axis)
        x, y, z = self.shape
        return jnp.pad(values[:x, :y, :z], 1)


def _doubled_along_z(plane: Float[Array, "y z"]) -> Float[Array, "y zz"]:
    return jnp.repeat(plane, 2, axis=1)


# One small program, instead of hundreds of single operations to compile.
@eqx.filter_jit
def _lattice_levels(
    network: AbstractNetwork, max_size: int
) -> tuple[tuple[AbstractNetwork, ...], tuple[_LatticeTransfer, ...]]:
    """Stencil and coarser ones down to `max_size` values in a state, with transfers."""
    networks = [network]
    transfers = []
    shape = tuple(n - 2 for n in jax.eval_shape(network.diagonal).shape)
    while math.prod(n + 2 for n in shape) > max_size:
        transfers.append(_LatticeTransfer(shape))
        shape = tuple(-(-n // 2) for n in shape)
        networks.append(_block_stencil(networks[-1], shape))
    return tuple(networks), tuple(transfers)


def _block_stencil(
    network: AbstractNetwork, shape: tuple[int, ...]
) -> HeterogeneousStencil:
    """Stencil of the blocks of 2 x 2 x 2 cells of a lattice."""
    # Voxels that the surface cuts count as whole ones in the coarser levels.
    if isinstance(network, CutStencil):
        network = network.base
    faces = []
    for axis in range(3):
        values = _even_faces(network, axis)
        for face_axis in {0, 1, 2} - {axis}:
            values = _pair_sum(values, face_axis)
        faces.append(values)
    x, y, z = faces
    if isinstance(network, Stencil):
        # Up to here the values are counts of open faces.
        g = jnp.broadcast_to(network.conductance, (3,))
        x, y, z = (n.astype(g.dtype) * g[axis] for axis, n in enumerate(faces))
    # The centres of blocks are twice as far apart, so the conductance is half of that
    # of the faces together. The plain sum, which the transfers imply, would make coarse
    # levels twice as stiff and correct half of the error.
    return HeterogeneousStencil(
        face_conductance=(x / 2, y / 2, z / 2),
        # Only conduction is evaluated: the capacities of blocks are in m.
        cell_capacity=jnp.zeros(shape, x.dtype),
    )


def _even_faces(network: AbstractNetwork, axis: int) -> Array:
    """Every other face across an axis: faces between blocks, not inside them."""
    if isinstance(network, HeterogeneousStencil):
        face = network.face_conductance[axis]
        face = _padded(
            face, axis=axis, cells_before=0, cells_after=(face.shape[axis] + 1) % 2
        )
        return face[_every_other(axis, 0)]
    if not isinstance(network, Stencil):
        raise TypeError(f"no lattice levels of a {type(network).__name__}")
    linked = network.degree > 0
    # Two adjacent cells that have any links are linked to each other.
    linked = _padded(
        linked, axis=axis, cells_before=1, cells_after=1 + linked.shape[axis] % 2
    )
    open_faces = linked[_every_other(axis, 0)] & linked[_every_other(axis, 1)]
    return open_faces.astype(jnp.uint8)


def _pair_sum(values: Array, axis: int) -> Array:
    values = _padded(
        values, axis=axis, cells_before=0, cells_after=values.shape[axis] % 2
    )
    return values[_every_other(axis, 0)] + values[_every_other(axis, 1)]


def _padded(values: Array, axis: int, cells_before: int, cells_after: int) -> Array:
    widths = [(0, 0)] * 3
    widths[axis] = (cells_before, cells_after)
    return jnp.pad(values, widths)


def _every_other(axis: int, start: int) -> tuple[slice, ...]:
    index = [slice(None)] * 3
    index[axis] = slice(start, None, 2)
    return tuple(index)


class _NodeTransfer(AbstractTransfer):
    group: Int[Array, " n"]
    """Group of each node."""
    members: tuple[Int[Array, " c"], ...]
    """Node number k of each group; one past the last node if it has fewer."""

    @override
    def restrict(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        return slot_sums(fine, self.members)

    @override
    def prolong(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        return taken(coarse, self.group)


class _CoarseLayout(NamedTuple):
    """Groups of the nodes of the previous level, computed on the host."""

    group: Int[Any, " n"]
    """Group of each node."""
    members: tuple[Int[Any, " c"], ...]
    """Node number k of each group; one past the last node if it has fewer."""
    crossing: Int[Any, " k"]
    """Links between different groups."""
    link: Int[Any, " k"]
    """Coarse link that contains each crossing link."""
    length_ratio: Float[Any, " k"]
    """Length of each crossing link over that of its coarse link, centre to centre."""
    links: int
    """Number of coarse links."""
    rows: RowLayout


class _NodeLayout(NamedTuple):
    """Rows of a structure's links, their number, and its coarser levels."""

    links: int
    rows: RowLayout
    coarser: tuple[_CoarseLayout, ...]


class _Graph(NamedTuple):
    centre: Float[np.ndarray, "n 3"]
    weight: Float[np.ndarray, " n"]
    links: Int[np.ndarray, "e 2"]


def node_layout(structure: AbstractStructure, max_nodes: int) -> _NodeLayout:
    """Levels of the nodes of a structure, computed once for each geometry.

    The coarsest has at most `max_nodes` nodes, unless more than that are not linked.
    """
    return structure.found(
        ("multigrid", max_nodes), lambda: on_device(_layout(structure, max_nodes))
    )


def _layout(structure: AbstractStructure, max_nodes: int) -> _NodeLayout:
    nodes = structure.nodes()
    links = structure.links()
    pairs = np.stack([links.src, links.dst], axis=1)
    graph = _Graph(structure.cell_position(), nodes.volume, pairs)
    size = graph.centre.max(initial=0)
    edge = 1
    coarser = []
    while len(graph.weight) > max_nodes and len(graph.links):
        edge *= 2
        group = _groups(graph, edge)
        if group.max() + 1 <= _MAX_SIZE_RATIO * len(group) or edge > size:
            level, graph = _merged(graph, group)
            coarser.append(level)
    rows = row_layout(len(nodes.volume), links.src, links.dst)
    return _NodeLayout(len(pairs), rows, tuple(coarser))


def _groups(graph: _Graph, edge: int) -> Int[np.ndarray, " n"]:
    """Group of each node, numbered along z first like the lattice."""
    # A node is in the block of its centre; only nodes that links connect inside a block
    # form a group, so that no heat crosses a gap. A cell larger than the blocks stays
    # alone until they have grown.
    block = (graph.centre / edge).astype(np.int64)
    _, y, z = block.max(axis=0) + 1
    index = (block[:, 0] * y + block[:, 1]) * z + block[:, 2]
    inside = index[graph.links[:, 0]] == index[graph.links[:, 1]]
    component = connected_labels(len(index), graph.links[inside])
    leads = np.flatnonzero(component == np.arange(len(component)))
    number = np.zeros(len(component), np.int32)
    number[leads[np.argsort(index[leads], kind="stable")]] = np.arange(len(leads))
    return number[component]


def _merged(
    graph: _Graph, group: Int[np.ndarray, " n"]
) -> tuple[_CoarseLayout, _Graph]:
    count = int(group.max()) + 1
    weight = np.bincount(group, graph.weight, count)
    moment = graph.centre * graph.weight[:, None]
    centre = np.stack([np.bincount(group, m, count) for m in moment.T], axis=1)
    centre /= weight[:, None]

    ends = np.sort(group[graph.links], axis=1)
    crossing = np.flatnonzero(ends[:, 0] != ends[:, 1])
    joint, link = np.unique(
        ends[crossing, 0].astype(np.int64) * count + ends[crossing, 1],
        return_inverse=True,
    )
    pairs = np.stack(np.divmod(joint, count), axis=1)
    fine_length = _lengths(graph.centre, graph.links[crossing])
    coarse_length = _lengths(centre, pairs)[link]
    # Conductances between groups are sums over their links, each scaled by this ratio:
    # a link between two single nodes keeps its conductance. Centres of curved groups
    # may be close together, hence the maximum.
    length_ratio = fine_length / np.maximum(coarse_length, fine_length)
    layout = _CoarseLayout(
        group=group,
        members=tuple(members(group, count)),
        crossing=crossing.astype(np.int32),
        link=link.astype(np.int32),
        length_ratio=length_ratio,
        links=len(pairs),
        rows=row_layout(count, pairs[:, 0], pairs[:, 1]),
    )
    return layout, _Graph(centre, weight, pairs)


def _lengths(centre, pairs):
    return np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)


@eqx.filter_jit
def _node_levels(
    layout: _NodeLayout, network: AbstractNodeNetwork
) -> tuple[tuple[AbstractNodeNetwork, ...], tuple[_NodeTransfer, ...]]:
    """Network of this layout and successively coarser ones, with the transfers."""
    networks = [network]
    transfers = []
    conductance = link_conductance(layout, network)
    for coarse in layout.coarser:
        dtype = conductance.dtype
        scaled_conductance = conductance[coarse.crossing] * jnp.asarray(
            coarse.length_ratio, dtype
        )
        conductance = (
            jnp.zeros(coarse.links, dtype).at[coarse.link].add(scaled_conductance)
        )
        columns = tuple(jnp.asarray(column) for column in coarse.members)
        transfers.append(_NodeTransfer(jnp.asarray(coarse.group), columns))
        # Only conduction is evaluated: the capacities of groups are in m.
        no_capacity = jnp.zeros(len(columns[0]), dtype)
        networks.append(row_network(coarse.rows, conductance, no_capacity))
    return tuple(networks), tuple(transfers)


def link_conductance(
    layout: _NodeLayout, network: AbstractNodeNetwork
) -> Float[Array, " e"]:
    """Conductance of every link, collected from a network of this layout [W/K]."""
    rows = layout.rows
    if isinstance(network, LinkNetwork):
        return network.conductance
    if isinstance(network, ColumnNetwork):
        return network.by_link
    if not isinstance(network, RowNetwork):
        raise TypeError(f"no node levels of a {type(network).__name__}")
    # The empty entries of the rows refer to one past the last link.
    by_link = jnp.zeros(layout.links + 1, network.node_capacity.dtype)
    for link, conductance in zip(rows.link, network.conductance, strict=True):
        by_link = by_link.at[link].set(conductance)
    return by_link.at[rows.list_link].set(network.list_conductance)[:-1]


class Hierarchy(Module):
    """Network and successively coarser ones of the same body."""

    networks: tuple[AbstractNetwork, ...]
    transfers: tuple[AbstractTransfer, ...]
    """From each network to the next."""

    def cycle(self, m: Float[Array, "..."]) -> AbstractCycle:
        """Cycle that approximates (diag(m) - K)^-1; m [W/K] is 0 without a node."""
        network = self.networks[0]
        of_all_nodes = self._cycle(m)
        if network.columns is None:
            return of_all_nodes
        return column_cycle(network, network.columns, m, of_all_nodes)

    def _cycle(self, m: Float[Array, "..."]) -> MultigridCycle:
        levels = []
        for network, transfer in zip(self.networks[:-1], self.transfers, strict=True):
            levels.append(level(network, m))
            m = transfer.restrict(m)
        # The coarsest level is larger only if none of its nodes are linked.
        is_small = m.size <= MAX_DENSE_SIZE
        solve = dense_solve if is_small else jacobi
        return MultigridCycle(
            levels=tuple(levels),
            transfers=self.transfers,
            coarsest=solve(self.networks[-1], m),
        )


def jacobi(network: AbstractNetwork, m: Float[Array, "..."]) -> JacobiCycle:
    """Inverse of the diagonal of diag(m) - K, with m [W/K] 0 or more."""
    return JacobiCycle(inverse(m + network.diagonal()))


def hierarchy(structure: AbstractStructure, network: AbstractNetwork) -> Hierarchy:
    """Levels of a body, from its structure and the network K of this structure.

    Conductances may be traced. If they depend on the temperature, K is taken at the
    reference.
    """
    network = network.linear
    if isinstance(network, AbstractNodeNetwork):
        layout = node_layout(structure, MAX_DENSE_SIZE)
        return Hierarchy(*_node_levels(layout, network))
    return Hierarchy(*_lattice_levels(network, MAX_DENSE_SIZE))
