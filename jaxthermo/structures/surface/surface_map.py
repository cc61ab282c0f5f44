"""From nodes to the surface: the temperature of every fragment.

- `ConstantMap`: the node's temperature;
- `LinearMap`: with the gradient there times the offset from node to fragment, by least
  squares over the node's links;
- `FluxCorrectedMap`: along the normal by heat flux x distance / k, which the balance at
  the surface gives, with the gradient's part; along the surface by the gradient.

A map reads at the surface itself or, `at="voxel"`, at the centre of the surface voxel,
half a voxel below, which is what a full volume's nodes say and what errors are measured
at. In a full volume nodes are those centres, and no gradient is ever needed.
"""

import abc
from typing import Any, Literal

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


class BoundMap(eqx.Module):
    """A map on one body."""

    gradient: Gradient | None
    offset: Components | None
    """Along x, y, z, from the node to the point that is read, as far as the gradient
    covers it [m]."""
    along_flux: Float[Array, " s"] | None
    """Of the surface's excess over its node, the part at the point that is read."""

    @property
    def needs_excess(self) -> bool:
        """Whether it reads the balance at the surface."""
        return self.along_flux is not None

    def read(
        self,
        theta: Float[Array, "..."],
        nodes: Float[Array, " m"],
        below: Float[Array, " s"],
        place: Int[Array, " s"],
        excess: Float[Array, " s"] | None,
    ) -> Float[Array, " s"]:
        """Temperature of every fragment above the reference [K].

        Args:
            theta: the state.
            nodes: of those that have surface.
            below: of each fragment's node.
            place: number of each fragment's node among those that have surface.
            excess: of the surface over the node, from the balance.
        """
        total = below
        if self.gradient is not None and self.offset is not None:
            slopes = self.gradient(theta, nodes)
            for slope, length in zip(slopes, self.offset, strict=True):
                total = total + length * slope.at[place].get(mode="promise_in_bounds")
        if self.along_flux is not None and excess is not None:
            total = total + self.along_flux * excess
        return total


Depth = Literal["surface", "voxel"]


class AbstractSurfaceMap(eqx.Module):
    """How fragments' temperatures are read from nodes."""

    @abc.abstractmethod
    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """This map on the surface of one body."""


class ConstantMap(AbstractSurfaceMap):
    """The node's temperature."""

    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """Nothing to add."""
        del structure, dtype
        return BoundMap(None, None, None)


class LinearMap(AbstractSurfaceMap):
    """The node's temperature and its gradient's part on the way to the fragment."""

    at: Depth = eqx.field(static=True, default="surface")

    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """With the offset from node to fragment."""
        offset = structure.fragment_offset()
        if self.at == "surface":
            grid = structure.grid
            voxel = grid.lattice.centres(grid.fragment_voxel)
            offset = offset + grid.fragment_position - voxel
        return _with_gradient(structure, offset, None, dtype)


FLUX_PART, GRADIENT_PART = 2 / 3, 1 / 3
"""From a cell's mean to its surface, of a parabola with the flux at the surface and the
gradient at the cell's far side: T_s - T = (2 q'' / k + g) / 3 times the distance."""


class FluxCorrectedMap(AbstractSurfaceMap):
    """The balance at the surface along the normal, the gradient along the surface.

    From the voxel under a fragment to the surface the flux alone; from a deeper node to
    that voxel a parabola that has the flux at one end and the gradient at the other.
    """

    at: Depth = eqx.field(static=True, default="surface")

    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """With the distances from node to fragment."""
        offset, normal = structure.fragment_offset(), structure.grid.fragment_normal
        along = np.maximum(np.einsum("si,si->s", offset, normal), 0)[:, None] * normal
        outermost = structure.grid.pitch / 2 / structure.fragment_distance()
        part = FLUX_PART * (1 - outermost)
        if self.at == "surface":
            part = part + outermost
        flux = jnp.asarray(part, dtype)
        flux = flux * jnp.asarray(structure.weights.surface_distance, dtype)
        inside = offset - (1 - GRADIENT_PART) * along
        return _with_gradient(structure, inside, flux, dtype)


def _with_gradient(structure, offset, part, dtype) -> BoundMap:
    if np.abs(offset).max(initial=0) < 1e-6 * structure.grid.pitch:
        return BoundMap(None, None, part)
    gradient = gradient_at(structure, np.unique(structure.fragment_node()), dtype)
    return BoundMap(gradient, _components(offset, dtype), part)


def _components(vectors: Float[np.ndarray, "m 3"], dtype: Any) -> Components:
    x, y, z = (jnp.asarray(vectors[:, i], dtype) for i in range(3))
    return x, y, z
