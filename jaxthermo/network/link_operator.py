"""Conduction along links between nodes, as pairs and as rows.

Both represent one operator. `LinkNetwork` (coordinate format) is a list of pairs with a
conductance each: the readable, tested reference. `RowNetwork` (ELLPACK format) is the
fast form. A state is one value for each node.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import (
    added,
    array_namespace,
    device_array,
    gathered_columns,
    rank_in_group,
    taken,
)
from .network import AbstractNodeNetwork, inverse
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

    neighbour: tuple[Int[np.ndarray, " n"], ...]
    """Neighbour number k of every node; the node itself if it has fewer."""
    link: tuple[Int[np.ndarray, " n"], ...]
    """Links to these neighbours; one past the last link if there is none."""
    list_node: Int[np.ndarray, " r"]
    """Nodes of the links that exceed the rows, sorted."""
    list_neighbour: Int[np.ndarray, " r"]
    """Neighbours over the links that exceed the rows."""
    list_link: Int[np.ndarray, " r"]
    """Numbers of the links that exceed the rows."""


def row_layout(
    nodes: int, src: Int[np.ndarray, " e"], dst: Int[np.ndarray, " e"]
) -> RowLayout:
    """Rows of the links from `src` to `dst` between a number of `nodes`."""
    # Every link is in the rows of both its nodes, so that nothing is scattered.
    # One neighbour of every node is gathered at a time, which a compiler vectorizes.
    # Nodes with far more neighbours than most (a coarse cell surrounded by fine ones)
    # keep the excess in a sparse list.
    order = np.argsort(np.concatenate([src, dst]), kind="stable")
    linked_node = np.concatenate([src, dst])[order]
    linked_neighbour = np.concatenate([dst, src])[order]
    link = np.tile(np.arange(len(src)), 2)[order]
    degree = np.bincount(linked_node, minlength=nodes)
    rank = rank_in_group(linked_node)
    columns = gathered_columns(degree)
    exceeds = rank >= columns
    slot = rank[~exceeds], linked_node[~exceeds]
    row_neighbour = np.tile(np.arange(nodes, dtype=np.int32), (columns, 1))
    row_neighbour[slot] = linked_neighbour[~exceeds]
    row_link = np.full((columns, nodes), len(src), np.int32)
    row_link[slot] = link[~exceeds]
    return RowLayout(
        neighbour=tuple(row_neighbour),
        link=tuple(row_link),
        list_node=linked_node[exceeds].astype(np.int32),
        list_neighbour=linked_neighbour[exceeds].astype(np.int32),
        list_link=link[exceeds].astype(np.int32),
    )


def _row_change(state, factors, layout):
    """Conduction into each node [W], from rows of conductances and neighbours."""
    conductances, list_conductance = factors
    neighbours, list_node, list_neighbour = layout
    if not len(list_node):
        # Otherwise XLA recomputes the previous step for every neighbour it gathers;
        # where a list is added, that step is stored anyway.
        state = computed_once(state)
    rate = jnp.zeros_like(state)
    for index, conductance in zip(neighbours, conductances, strict=True):
        neighbour_temperature = taken(state, index)
        rate = rate + conductance * (neighbour_temperature - state)
    if not len(list_node):
        return rate
    neighbour_temperature = taken(state, list_neighbour)
    node_temperature = taken(state, list_node)
    flow = list_conductance * (neighbour_temperature - node_temperature)
    return added(rate, list_node, flow, is_sorted=True)


def _pull(values, state, factors, layout):
    state = computed_once(state)

    def change(factors):
        return _row_change(state, factors, layout)

    return jax.linear_transpose(change, factors)(computed_once(values))[0]


_ROWS = Operator(
    change=_row_change, step=_row_change, inside=lambda values, _: values, pull=_pull
)


class RowNetwork(AbstractNodeNetwork):
    """Conductances in rows: the fast form of `LinkNetwork`."""

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
        factors = self.conductance, self.list_conductance
        layout = self.neighbour, self.list_node, self.list_neighbour
        return conduct(_ROWS, state=state, factors=factors, layout=layout)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        total = sum(self.conductance, jnp.zeros_like(self.node_capacity))
        return total.at[self.list_node].add(self.list_conductance)


@partial(jax.jit, inline=True)
def row_network(
    layout: RowLayout,
    conductance: Float[np.ndarray | Array, " e"],
    node_capacity: Float[np.ndarray | Array, " n"],
) -> RowNetwork:
    """Operator of links with these conductances [W/K] and capacities [J/K]."""
    xp = array_namespace(conductance)
    padded = xp.append(conductance, xp.zeros(1, conductance.dtype))

    def conductance_of(link: Int[np.ndarray | Array, " _"]) -> Float[Array, " _"]:
        if xp is jnp:
            return padded[link]
        # Known conductances are gathered on the host, where nothing is compiled.
        return device_array(padded[np.asarray(link)])

    return RowNetwork(
        neighbour=tuple(jnp.asarray(index) for index in layout.neighbour),
        conductance=tuple(conductance_of(link) for link in layout.link),
        list_node=jnp.asarray(layout.list_node),
        list_neighbour=jnp.asarray(layout.list_neighbour),
        list_conductance=conductance_of(layout.list_link),
        node_capacity=device_array(node_capacity),
    )


@partial(jax.jit, inline=True)
def series(
    area: Float[np.ndarray | Array, "*e"],
    length1: Float[np.ndarray | Array, "*e"],
    k1: Float[Array, "*#e"],
    length2: Float[np.ndarray | Array, "*e"],
    k2: Float[Array, "*#e"],
) -> Float[Array, "*e"]:
    """Conductance of two lengths [m] in series [W/K]; 0 if either conductivity is 0."""
    # Exact in one dimension, where the arithmetic mean of conductivities is wrong by up
    # to their ratio. This form needs no division by a conductivity, which may be 0.
    dtype = k1.dtype
    length1 = jnp.asarray(length1, dtype)
    length2 = jnp.asarray(length2, dtype)
    resistance = length1 * k2 + length2 * k1
    return jnp.asarray(area, dtype) * k1 * k2 * inverse(resistance)
