"""Conduction along links between nodes, as pairs and as rows.

Both hold the same operator. `LinkNetwork` (coordinate format) is a list of pairs with a
conductance each: the readable, tested reference. `RowNetwork` (ELLPACK format) runs
several times faster. A state is one value for each node.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import gathered_columns, rank_in_group
from .network import AbstractNodeNetwork
from .self_adjoint_primitive import Operator, computed_once, conduct


class LinkNetwork(AbstractNodeNetwork):
    """Pairs of nodes with a conductance each: the reference of `RowNetwork`."""

    src: Int[Array, " e"]
    """First node of each link, sorted."""
    dst: Int[Array, " e"]
    conductance: Float[Array, " e"]
    """[W/K]"""
    node_capacity: Float[Array, " n"]
    """[J/K]"""

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]: what leaves one end enters the other."""
        flow = self.conductance * (state[self.dst] - state[self.src])
        inward = jnp.zeros_like(state).at[self.src].add(flow, indices_are_sorted=True)
        return inward.at[self.dst].add(-flow)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        total = jnp.zeros_like(self.node_capacity)
        total = total.at[self.src].add(self.conductance, indices_are_sorted=True)
        return total.at[self.dst].add(self.conductance)


class RowLayout(NamedTuple):
    """Position of each link in the rows; built once for a structure, on the host."""

    following: Int[np.ndarray, " f"]
    """Links from a node to the next one in node order."""
    first: Int[np.ndarray, " f"]
    """First node of each of these links."""
    neighbour: tuple[Int[np.ndarray, " n"], ...]
    """Other neighbour number k of every node; the node itself if it has fewer."""
    link: tuple[Int[np.ndarray, " n"], ...]
    """Links to these neighbours; one past the last link if there is none."""
    list_node: Int[np.ndarray, " r"]
    """Nodes of the entries that exceed the rows, sorted."""
    list_neighbour: Int[np.ndarray, " r"]
    list_link: Int[np.ndarray, " r"]


def row_layout(
    nodes: int, src: Int[np.ndarray, " e"], dst: Int[np.ndarray, " e"]
) -> RowLayout:
    """Rows of the links from `src` to `dst` between a number of `nodes`."""
    # Every link is in the rows of both its nodes, so that nothing is scattered.
    # Neighbours that are consecutive in node order (the next voxel of a column) are
    # shifted slices. The others are gathered, one neighbour of every node at a time,
    # which a compiler vectorizes. Nodes with far more neighbours than the others (a
    # coarse cell surrounded by fine ones) keep the rest in a sparse list.
    low, high = np.minimum(src, dst), np.maximum(src, dst)
    follows = high == low + 1
    # Of several links between the same two nodes, only one fits here.
    following = np.flatnonzero(follows)
    _, once = np.unique(low[following], return_index=True)
    following = following[once]
    rest = np.delete(np.arange(len(src)), following)
    node = np.concatenate([src[rest], dst[rest]])
    neighbour = np.concatenate([dst[rest], src[rest]])
    order = np.argsort(node, kind="stable")
    node, neighbour = node[order], neighbour[order]
    link = np.concatenate([rest, rest])[order]
    degree = np.bincount(node, minlength=nodes)
    rank = rank_in_group(node)
    columns = gathered_columns(degree)
    more = rank >= columns
    slot = rank[~more], node[~more]
    beside = np.tile(np.arange(nodes, dtype=np.int32), (columns, 1))
    beside[slot] = neighbour[~more]
    through = np.full((columns, nodes), len(src), np.int32)
    through[slot] = link[~more]
    return RowLayout(
        following=following.astype(np.int32),
        first=low[following].astype(np.int32),
        neighbour=tuple(beside),
        link=tuple(through),
        list_node=node[more].astype(np.int32),
        list_neighbour=neighbour[more].astype(np.int32),
        list_link=link[more].astype(np.int32),
    )


def _row_change(state, factors, layout):
    """Conduction into each node [W], from rows of conductances and neighbours."""
    following, conductances, list_conductance = factors
    neighbours, list_node, list_neighbour = layout
    rate = jnp.zeros_like(state)
    if following is not None:
        flow = following * jnp.diff(state)
        rate = rate + jnp.pad(flow, (0, 1)) - jnp.pad(flow, (1, 0))
    for index, conductance in zip(neighbours, conductances, strict=True):
        there = state.at[index].get(mode="promise_in_bounds")
        rate = rate + conductance * (there - state)
    if not len(list_node):
        return rate
    there = state.at[list_neighbour].get(mode="promise_in_bounds")
    here = state.at[list_node].get(mode="promise_in_bounds")
    flow = list_conductance * (there - here)
    return rate.at[list_node].add(
        flow, mode="promise_in_bounds", indices_are_sorted=True
    )


def _pull(values, state, factors, layout):
    values, state = computed_once(values), computed_once(state)
    change = lambda factors: _row_change(state, factors, layout)
    return jax.linear_transpose(change, factors)(values)[0]


_ROWS = Operator(_row_change, _row_change, lambda values, _: values, _pull)


class RowNetwork(AbstractNodeNetwork):
    """Conductances in rows: the fast form of `LinkNetwork`."""

    following: Float[Array, " f"] | None
    """Conductance from every node to the next [W/K]; None without such links."""
    neighbour: tuple[Int[Array, " n"], ...]
    conductance: tuple[Float[Array, " n"], ...]
    """Conductances [W/K]; 0 where there is no such neighbour."""
    list_node: Int[Array, " r"]
    list_neighbour: Int[Array, " r"]
    list_conductance: Float[Array, " r"]
    node_capacity: Float[Array, " n"]
    """[J/K]"""

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        factors = self.following, self.conductance, self.list_conductance
        layout = self.neighbour, self.list_node, self.list_neighbour
        return conduct(_ROWS, state, factors, layout)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        total = sum(self.conductance, jnp.zeros_like(self.node_capacity))
        if self.following is not None:
            total = total + jnp.pad(self.following, (0, 1))
            total = total + jnp.pad(self.following, (1, 0))
        return total.at[self.list_node].add(self.list_conductance)


@partial(jax.jit, inline=True)
def row_network(
    layout: RowLayout,
    conductance: Float[Array, " e"],
    node_capacity: Float[Array, " n"],
) -> RowNetwork:
    """Operator of links with these conductances [W/K] and capacities [J/K]."""
    nodes = node_capacity.shape[0]
    padded = jnp.append(conductance, jnp.zeros(1, conductance.dtype))
    following = None
    if len(layout.following):
        following = jnp.zeros(nodes - 1, conductance.dtype)
        following = following.at[layout.first].set(conductance[layout.following])
    return RowNetwork(
        following=following,
        neighbour=tuple(jnp.asarray(index) for index in layout.neighbour),
        conductance=tuple(padded[link] for link in layout.link),
        list_node=jnp.asarray(layout.list_node),
        list_neighbour=jnp.asarray(layout.list_neighbour),
        list_conductance=conductance[layout.list_link],
        node_capacity=node_capacity,
    )
