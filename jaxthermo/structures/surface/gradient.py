"""The temperature's gradient at nodes, by least squares over their links."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import gathered_columns, rank_in_group
from ..structure import AbstractStructure


Components = tuple[Float[Array, " m"], Float[Array, " m"], Float[Array, " m"]]
"""Of vectors, each an array of its own: rows of three are slow to work on."""

FLAT = 0.05
"""Of the largest moment of a node's neighbours, the least in a direction that has a
gradient: from neighbours nearly in a plane it would be multiplied errors."""


class Gradient(eqx.Module):
    """Weighted sums of the differences to all linked nodes."""

    neighbour: tuple[Int[Array, "k m"], ...]
    """State addresses of the k-th neighbour of each node; its own where it has less."""
    weight: tuple[Float[Array, "k m"], Float[Array, "k m"], Float[Array, "k m"]]
    """Of its temperature difference, along x, y, z [1/m]."""
    list_node: Int[Array, " r"]
    """Sorted: nodes of the neighbours that did not fit."""
    list_neighbour: tuple[Int[Array, " r"], ...]
    list_weight: tuple[Float[Array, " r"], Float[Array, " r"], Float[Array, " r"]]

    def __call__(
        self, theta: Float[Array, "..."], nodes: Float[Array, " m"]
    ) -> Components:
        """At all its nodes, along x, y, z [K/m].

        Args:
            theta: the state.
            nodes: of it, those whose gradient this is.
        """

        def add(slopes, column):
            address, weights = column
            gap = theta.at[address].get(mode="promise_in_bounds") - nodes
            pairs = zip(slopes, weights, strict=True)
            return tuple(slope + weight * gap for slope, weight in pairs), None

        zero = jnp.zeros_like(nodes)
        # A loop, or XLA would compute it anew for every fragment that reads it.
        slopes, _ = jax.lax.scan(add, (zero,) * 3, (self.neighbour, self.weight))
        if len(self.list_node):
            slopes = self._with_list(slopes, theta, nodes)
        x, y, z = slopes
        return x, y, z

    def _with_list(self, slopes, theta, nodes):
        there = theta.at[self.list_neighbour].get(mode="promise_in_bounds")
        gap = there - nodes.at[self.list_node].get(mode="promise_in_bounds")
        return tuple(
            slope.at[self.list_node].add(
                weight * gap, mode="promise_in_bounds", indices_are_sorted=True
            )
            for slope, weight in zip(slopes, self.list_weight, strict=True)
        )


def gradient_at(
    structure: AbstractStructure, chosen: Int[np.ndarray, " m"], dtype: Any
) -> Gradient:
    """Least squares of the differences to all linked nodes, weighted by area.

    Directions in which no neighbour lies get no gradient (the pseudo-inverse).

    Args:
        structure: nodes and links.
        chosen: nodes to have it at, in order.
        dtype: of the weights.
    """
    node, other, row = _rows(structure, chosen)
    rank = rank_in_group(node)
    columns = gathered_columns(np.bincount(node, minlength=len(chosen)))
    first = rank < columns
    index = np.tile(chosen, (columns, 1))
    weights = np.zeros((3, columns, len(chosen)))
    index[rank[first], node[first]] = other[first]
    weights[:, rank[first], node[first]] = row[first].T
    address = np.stack(structure.node_address())
    x, y, z = (jnp.asarray(w, dtype) for w in weights)
    further = [jnp.asarray(w, dtype) for w in row[~first].T]
    return Gradient(
        neighbour=tuple(jnp.asarray(a[index]) for a in address),
        weight=(x, y, z),
        list_node=jnp.asarray(node[~first].astype(np.int32)),
        list_neighbour=tuple(jnp.asarray(a[other[~first]]) for a in address),
        list_weight=(further[0], further[1], further[2]),
    )


def _rows(structure, chosen):
    """Entries of the gradient, sorted: place among the chosen, neighbour, weights."""
    links, nodes = structure.links(), structure.nodes()
    slot = np.full(len(nodes.volume), -1)
    slot[chosen] = np.arange(len(chosen))
    node = np.concatenate([links.src, links.dst])
    other = np.concatenate([links.dst, links.src])
    area = np.concatenate([links.area, links.area])
    here = np.flatnonzero(slot[node] >= 0)
    here = here[np.argsort(slot[node[here]], kind="stable")]
    node, other, area = slot[node[here]], other[here], area[here]
    step = nodes.place[other] - nodes.place[chosen][node]
    length = np.einsum("ei,ei->e", step, step)
    weight = area / np.where(length > 0, length, 1)
    moment = np.zeros((len(chosen), 3, 3))
    for i in range(3):
        for j in range(3):
            each = weight * step[:, i] * step[:, j]
            moment[:, i, j] = np.bincount(node, each, len(chosen))
    solved = np.linalg.pinv(moment, rcond=FLAT, hermitian=True)
    row = np.einsum("eij,ej->ei", solved[node], step) * weight[:, None]
    return node, other, row
