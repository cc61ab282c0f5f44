"""Coarser levels of nodes and links: connected groups of nodes in cubic blocks.

The edges of the blocks double from level to level.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import members
from ..geometry.connectivity import connected_labels
from ..structures.structure import AbstractBuiltStructure, AbstractStructure
from .link_operator import LinkNetwork, RowLayout, RowNetwork, row_layout, row_network
from .multigrid_cycle import AbstractTransfer
from .network import AbstractNodeNetwork, slot_sums


# Levels that keep more than this fraction of the nodes are skipped.
_MAX_SIZE_RATIO = 0.9


class _NodeTransfer(AbstractTransfer):
    """Transfer between nodes and their groups."""

    group: Int[Array, " n"]
    """Group of each node."""
    members: tuple[Int[Array, " c"], ...]
    """Node number k of each group; one past the last node if it has fewer."""

    @override
    def restrict(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        return slot_sums(fine, self.members)

    @override
    def prolong(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        return coarse.at[self.group].get(mode="promise_in_bounds")


class _CoarseLayout(NamedTuple):
    """Groups of the nodes of the previous level; built on the host."""

    group: Int[np.ndarray, " n"]
    members: tuple[Int[np.ndarray, " c"], ...]
    kept: Int[np.ndarray, " k"]
    """Links between different groups."""
    link: Int[np.ndarray, " k"]
    """Coarse link that contains each of these links."""
    length_ratio: Float[np.ndarray, " k"]
    """Length of each link over that of its coarse link, centre to centre [-]."""
    links: int
    """Number of coarse links."""
    rows: RowLayout


class _NodeLayout(NamedTuple):
    """Rows of a structure's links, and its coarser levels."""

    links: int
    """Number of links."""
    rows: RowLayout
    coarser: tuple[_CoarseLayout, ...]


class _Graph(NamedTuple):
    centre: Float[np.ndarray, "n 3"]
    weight: Float[np.ndarray, " n"]
    links: Int[np.ndarray, "e 2"]


# Layouts of each structure, kept as long as it exists.
_LAYOUTS: WeakKeyDictionary = WeakKeyDictionary()


def node_layout(structure: AbstractStructure, max_nodes: int) -> _NodeLayout:
    """Levels of the nodes of a structure, built once for each structure.

    The coarsest has at most `max_nodes` nodes, unless more than that are not linked.
    """
    built = isinstance(structure, AbstractBuiltStructure)
    key = structure.built if built else structure.grid
    found = _LAYOUTS.setdefault(key, {})
    if max_nodes not in found:
        found[max_nodes] = _layout(structure, max_nodes)
    return found[max_nodes]


def _layout(structure: AbstractStructure, max_nodes: int) -> _NodeLayout:
    nodes, links = structure.nodes(), structure.links()
    lattice = structure.grid.lattice
    pairs = np.stack([links.src, links.dst], axis=1)
    graph = _Graph((nodes.centre - lattice.origin) / lattice.pitch, nodes.volume, pairs)
    edge, coarser = 1, []
    while len(graph.weight) > max_nodes and len(graph.links):
        edge *= 2
        group = _groups(graph, edge)
        if group.max() + 1 <= _MAX_SIZE_RATIO * len(group) or edge > max(lattice.shape):
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
    part = connected_labels(len(index), graph.links[inside])
    leads = np.flatnonzero(part == np.arange(len(part)))
    number = np.zeros(len(part), np.int32)
    number[leads[np.argsort(index[leads], kind="stable")]] = np.arange(len(leads))
    return number[part]


def _merged(
    graph: _Graph, group: Int[np.ndarray, " n"]
) -> tuple[_CoarseLayout, _Graph]:
    count = int(group.max()) + 1
    weight = np.bincount(group, graph.weight, count)
    moment = graph.centre * graph.weight[:, None]
    centre = np.stack([np.bincount(group, m, count) for m in moment.T], axis=1)
    centre /= weight[:, None]

    ends = np.sort(group[graph.links], axis=1)
    kept = np.flatnonzero(ends[:, 0] != ends[:, 1])
    joint, link = np.unique(
        ends[kept, 0].astype(np.int64) * count + ends[kept, 1], return_inverse=True
    )
    pairs = np.stack(np.divmod(joint, count), axis=1)
    before = _lengths(graph.centre, graph.links[kept])
    after = _lengths(centre, pairs)[link]
    # Conductances between groups are sums over their links, each scaled by this ratio:
    # a link between two single nodes keeps its conductance. Centres of curved groups
    # may be close together, hence the maximum.
    length_ratio = before / np.maximum(after, before)
    layout = _CoarseLayout(
        group=group,
        members=tuple(members(group, count)),
        kept=kept.astype(np.int32),
        link=link.astype(np.int32),
        length_ratio=length_ratio,
        links=len(pairs),
        rows=row_layout(count, pairs[:, 0], pairs[:, 1]),
    )
    return layout, _Graph(centre, weight, pairs)


def _lengths(centre, pairs):
    return np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)


def node_levels(
    layout: _NodeLayout, network: AbstractNodeNetwork
) -> tuple[tuple[AbstractNodeNetwork, ...], tuple[_NodeTransfer, ...]]:
    """Network of this layout and successively coarser ones, with the transfers."""
    networks, transfers = [network], []
    conductance = link_conductance(layout, network)
    for coarse in layout.coarser:
        dtype = conductance.dtype
        part = conductance[coarse.kept] * jnp.asarray(coarse.length_ratio, dtype)
        conductance = jnp.zeros(coarse.links, dtype).at[coarse.link].add(part)
        columns = tuple(jnp.asarray(column) for column in coarse.members)
        transfers.append(_NodeTransfer(jnp.asarray(coarse.group), columns))
        # Only conduction is evaluated: the capacities of groups are in m.
        nothing = jnp.zeros(len(columns[0]), dtype)
        networks.append(row_network(coarse.rows, conductance, nothing))
    return tuple(networks), tuple(transfers)


def link_conductance(
    layout: _NodeLayout, network: AbstractNodeNetwork
) -> Float[Array, " e"]:
    """Conductance of every link, collected from a network of this layout [W/K]."""
    rows = layout.rows
    if isinstance(network, LinkNetwork):
        return network.conductance
    if not isinstance(network, RowNetwork):
        raise TypeError(f"no node levels of a {type(network).__name__}")
    # The empty entries of the rows refer to one past the last link.
    found = jnp.zeros(layout.links + 1, network.node_capacity.dtype)
    if network.following is not None:
        found = found.at[rows.following].set(network.following[rows.first])
    for link, conductance in zip(rows.link, network.conductance, strict=True):
        found = found.at[link].set(conductance)
    return found.at[rows.list_link].set(network.list_conductance)[:-1]
