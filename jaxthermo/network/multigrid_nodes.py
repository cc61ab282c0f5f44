"""Coarser levels of nodes and links: groups of what hangs together in cubic blocks.

The blocks' edges double from level to level. A node is in the block of its centre; only
those that links join inside a block are one group, so that no heat leaps across a gap.
A cell larger than the blocks stays alone until they have grown.

Two groups conduct as the links between them together, each less by how much farther
apart their centres are than its own ends. So a link that is not merged keeps its own.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import members
from ..geometry.connectivity import connected_labels
from ..structures.structure import AbstractBuiltStructure, AbstractStructure
from .link_operator import LinkNetwork, RowLayout, RowNetwork, row_layout, row_network
from .multigrid_cycle import AbstractTransfer
from .network import AbstractNodeNetwork, slot_sums


LEAST_SHRINKING = 0.9
"""Blocks that leave more than this share of the nodes are passed over."""


class NodeTransfer(AbstractTransfer):
    """Between nodes and their groups."""

    group: Int[Array, " n"]
    """Of each node."""
    members: tuple[Int[Array, " c"], ...]
    """Of each group, its k-th node; one past the last where it has fewer."""

    def total(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each group the sum over its nodes."""
        return slot_sums(fine, self.members)

    def spread(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each node the value of its group."""
        return coarse.at[self.group].get(mode="promise_in_bounds")


class CoarseLayout(NamedTuple):
    """One level's groups of the nodes of the level before; made on the host."""

    group: Int[np.ndarray, " n"]
    members: tuple[Int[np.ndarray, " c"], ...]
    kept: Int[np.ndarray, " k"]
    """Links between different groups."""
    link: Int[np.ndarray, " k"]
    """The coarse link that each of them is part of."""
    nearer: Float[np.ndarray, " k"]
    """Its length over that of the coarse link, from centre to centre [-]."""
    links: int
    """How many coarse ones."""
    rows: RowLayout


class NodeLayout(NamedTuple):
    """Rows of a structure's links, and its coarser levels."""

    links: int
    """How many."""
    rows: RowLayout
    coarser: tuple[CoarseLayout, ...]


class _Graph(NamedTuple):
    centre: Float[np.ndarray, "n 3"]
    weight: Float[np.ndarray, " n"]
    links: Int[np.ndarray, "e 2"]


_FOUND: WeakKeyDictionary = WeakKeyDictionary()


def node_layout(structure: AbstractStructure, most: int) -> NodeLayout:
    """The levels of a structure's nodes, found once and kept as long as it lives.

    Args:
        structure: nodes and links.
        most: nodes of the coarsest level, if no more parts are left unlinked.
    """
    built = isinstance(structure, AbstractBuiltStructure)
    key = structure.built if built else structure.grid
    found = _FOUND.setdefault(key, {})
    if most not in found:
        found[most] = _layout(structure, most)
    return found[most]


def _layout(structure: AbstractStructure, most: int) -> NodeLayout:
    nodes, links = structure.nodes(), structure.links()
    lattice = structure.grid.lattice
    pairs = np.stack([links.src, links.dst], axis=1)
    graph = _Graph((nodes.centre - lattice.origin) / lattice.pitch, nodes.volume, pairs)
    edge, coarser = 1, []
    while len(graph.weight) > most and len(graph.links):
        edge *= 2
        group = _groups(graph, edge)
        if group.max() + 1 <= LEAST_SHRINKING * len(group) or edge > max(lattice.shape):
            level, graph = _merged(graph, group)
            coarser.append(level)
    rows = row_layout(len(nodes.volume), links.src, links.dst)
    return NodeLayout(len(pairs), rows, tuple(coarser))


def _groups(graph: _Graph, edge: int) -> Int[np.ndarray, " n"]:
    """The group of each node, numbered along z first as the lattice is."""
    block = (graph.centre / edge).astype(np.int64)
    _, y, z = block.max(axis=0) + 1
    place = (block[:, 0] * y + block[:, 1]) * z + block[:, 2]
    inside = place[graph.links[:, 0]] == place[graph.links[:, 1]]
    part = connected_labels(len(place), graph.links[inside])
    leads = np.flatnonzero(part == np.arange(len(part)))
    number = np.zeros(len(part), np.int32)
    number[leads[np.argsort(place[leads], kind="stable")]] = np.arange(len(leads))
    return number[part]


def _merged(graph: _Graph, group: Int[np.ndarray, " n"]) -> tuple[CoarseLayout, _Graph]:
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
    # Centres of bent groups may lie close together.
    nearer = before / np.maximum(after, before)
    layout = CoarseLayout(
        group=group,
        members=tuple(members(group, count)),
        kept=kept.astype(np.int32),
        link=link.astype(np.int32),
        nearer=nearer,
        links=len(pairs),
        rows=row_layout(count, pairs[:, 0], pairs[:, 1]),
    )
    return layout, _Graph(centre, weight, pairs)


def _lengths(centre, pairs):
    return np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)


def node_levels(
    layout: NodeLayout, network: AbstractNodeNetwork
) -> tuple[tuple[AbstractNodeNetwork, ...], tuple[NodeTransfer, ...]]:
    """The network and ever coarser ones, with the transfers between them.

    Args:
        layout: of the network's structure.
        network: rows or links.
    """
    networks, transfers = [network], []
    conductance = link_conductance(layout, network)
    for coarse in layout.coarser:
        dtype = conductance.dtype
        part = conductance[coarse.kept] * jnp.asarray(coarse.nearer, dtype)
        conductance = jnp.zeros(coarse.links, dtype).at[coarse.link].add(part)
        columns = tuple(jnp.asarray(column) for column in coarse.members)
        transfers.append(NodeTransfer(jnp.asarray(coarse.group), columns))
        # Conduction alone is asked of it: what groups hold is in m.
        nothing = jnp.zeros(len(columns[0]), dtype)
        networks.append(row_network(coarse.rows, conductance, nothing))
    return tuple(networks), tuple(transfers)


def link_conductance(
    layout: NodeLayout, network: AbstractNodeNetwork
) -> Float[Array, " e"]:
    """The conductance of every link, read from where it is kept [W/K].

    Args:
        layout: of the network's structure.
        network: rows or links.
    """
    rows = layout.rows
    if isinstance(network, LinkNetwork):
        return network.conductance
    if not isinstance(network, RowNetwork):
        raise TypeError(f"no node levels of a {type(network).__name__}")
    # One past the last link for the rows' empty entries.
    found = jnp.zeros(layout.links + 1, network.node_capacity.dtype)
    if network.following is not None:
        found = found.at[rows.following].set(network.following[rows.first])
    for link, conductance in zip(rows.link, network.conductance, strict=True):
        found = found.at[link].set(conductance)
    return found.at[rows.list_link].set(network.list_conductance)[:-1]
