"""Surface maps: the temperature of every fragment from those of the nodes.

- `ConstantMap`: the node's temperature;
- `LinearMap`: plus the gradient times the offset from node to fragment, with the
  gradient by least squares over the node's links;
- `FluxCorrectedMap`: along the normal by heat flux x distance / k from the surface
  balance, together with the gradient; along the surface by the gradient.

A map is evaluated at the surface or, with `at="voxel"`, at the centre of the surface
voxel half a voxel below: the location of a full volume's nodes, where errors are
measured. A full volume needs no gradient there.

At the surface, a prescribed temperature is read as it is. A gradient may lead beyond
what surrounds a fragment: the temperature is limited to the range of its node, of the
nodes linked to it, of its surface balance and of the equilibrium with what acts on it
(the discrete maximum principle; cf. Barth and Jespersen, AIAA paper 89-0366, 1989).
"""

import abc
from functools import partial
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ..arrays import (
    added,
    device_array,
    gathered_columns,
    is_traced,
    rank_in_group,
    taken,
)
from .structure import AbstractStructure


_Components = tuple[Float[Array, " m"], Float[Array, " m"], Float[Array, " m"]]
"""Components x, y, z of vectors in separate arrays: rows of three are slow in XLA."""

_Depth = Literal["surface", "voxel"]

# Second moment of the neighbours, relative to the largest, below which a direction has
# no gradient: from neighbours nearly in a plane it would amplify errors.
_MIN_MOMENT = 0.05


class Range(NamedTuple):
    """Lowest and highest temperature around each node or fragment [K]."""

    lowest: Float[Array, " m"]
    highest: Float[Array, " m"]

    def including(self, values: Float[Array, " m"]) -> "Range":
        """The range that contains other temperatures as well [K]."""
        return Range(
            lowest=jnp.minimum(self.lowest, values),
            highest=jnp.maximum(self.highest, values),
        )

    def including_groups(
        self, values: Float[Array, " r"], group: Int[Array, " r"]
    ) -> "Range":
        """The range that contains the values of the group of each entry as well [K]."""
        count = len(self.lowest)
        low = -_largest_of(-values, group, count)
        high = _largest_of(values, group, count)
        return Range(
            lowest=jnp.minimum(self.lowest, low),
            highest=jnp.maximum(self.highest, high),
        )


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def _largest_of(
    values: Float[Array, " r"], group: Int[Array, " r"], count: int
) -> Float[Array, " m"]:
    """Largest value of each group; minus infinity for none."""
    return jax.ops.segment_max(values, group, count)


@_largest_of.defjvp
def _along_largest(count, primals, tangents):
    # JAX has no derivative of a maximum by group: it is that of the last value that
    # attains the maximum.
    values, group = primals
    along_values, _ = tangents
    largest = _largest_of(values, group, count)
    entry = jnp.arange(len(values), dtype=group.dtype)
    entry = jnp.where(values >= taken(largest, group), entry, -1)
    entry = jax.ops.segment_max(entry, group, count)
    along = taken(along_values, jnp.maximum(entry, 0))
    return largest, jnp.where(entry >= 0, along, 0)


class SurfaceState(NamedTuple):
    """State of the fragments of a body, for reading their temperatures."""

    excess: Float[Array, " s"]
    """Excess of each fragment over its node by the surface balance [K]."""
    held: Bool[Array, " s"] | None
    """Fragments whose temperature is prescribed; None for none."""
    equilibrium: Float[Array, " s"] | None
    """Temperature at which each fragment receives no heat from what acts on it, above
    the reference [K]; infinite towards heat that is imposed at any temperature. None to
    limit nothing."""


class Gradient(Module):
    """Temperature gradient at nodes: weighted sums of differences to linked nodes."""

    neighbour: tuple[Int[Array, "k m"], ...]
    """State indices of each node's k-th neighbour; of the node if it has fewer."""
    weight: tuple[Float[Array, "k m"], Float[Array, "k m"], Float[Array, "k m"]]
    """Weight of its temperature difference, along x, y, z [1/m]."""
    list_node: Int[Array, " r"]
    """Nodes of further neighbours, beyond the first k of each node; sorted."""
    list_neighbour: tuple[Int[Array, " r"], ...]
    """State indices of the further neighbours."""
    list_weight: tuple[Float[Array, " r"], Float[Array, " r"], Float[Array, " r"]]
    """Weights of their temperature differences, along x, y, z [1/m]."""

    def __call__(
        self, theta: Float[Array, "..."], nodes: Float[Array, " m"]
    ) -> _Components:
        """Gradient along x, y, z [K/m], from the state and from its nodes [K]."""

        def add(slopes, column):
            address, weights = column
            gap = taken(theta, address) - nodes
            pairs = zip(slopes, weights, strict=True)
            return tuple(slope + weight * gap for slope, weight in pairs), None

        zero = jnp.zeros_like(nodes)
        # A loop, or XLA would recompute the sum for every fragment that reads it.
        slopes, _ = jax.lax.scan(add, (zero,) * 3, (self.neighbour, self.weight))
        if len(self.list_node):
            slopes = self._with_list(slopes, theta, nodes)
        x, y, z = slopes
        return x, y, z

    def neighbour_range(
        self, theta: Float[Array, "..."], nodes: Float[Array, " m"]
    ) -> "Range":
        """Lowest and highest temperature of each node and its neighbours [K]."""

        def extend(reached: Range, address) -> tuple[Range, None]:
            return reached.including(taken(theta, address)), None

        # A loop, for the reason above.
        reached, _ = jax.lax.scan(extend, Range(nodes, nodes), self.neighbour)
        if not len(self.list_node):
            return reached
        further = taken(theta, self.list_neighbour)
        return reached.including_groups(further, self.list_node)

    def _with_list(self, slopes, theta, nodes):
        neighbour = taken(theta, self.list_neighbour)
        gap = neighbour - taken(nodes, self.list_node)
        return tuple(
            added(slope, self.list_node, weight * gap, is_sorted=True)
            for slope, weight in zip(slopes, self.list_weight, strict=True)
        )


def gradient_at(
    structure: AbstractStructure, at_nodes: Int[np.ndarray, " m"], dtype: Any
) -> Gradient:
    """Gradient at sorted nodes by least squares over links.

    Weighted by area / distance^2; zero in directions without neighbours (by the
    pseudo-inverse).
    """
    rows = gradient_rows(structure, at_nodes)
    node = rows.node
    neighbour = rows.neighbour
    row = rows.weight
    rank = rank_in_group(node)
    columns = gathered_columns(np.bincount(node, minlength=len(at_nodes)))
    # Most nodes have few neighbours: dense columns for those, a list for any others.
    first = rank < columns
    index = np.tile(at_nodes, (columns, 1))
    weights = np.zeros((3, columns, len(at_nodes)))
    index[rank[first], node[first]] = neighbour[first]
    weights[:, rank[first], node[first]] = row[first].T
    address = np.stack(structure.node_address())
    x, y, z = (device_array(w, dtype) for w in weights)
    further = [device_array(w, dtype) for w in row[~first].T]
    return Gradient(
        neighbour=tuple(device_array(a[index]) for a in address),
        weight=(x, y, z),
        list_node=device_array(node[~first].astype(np.int32)),
        list_neighbour=tuple(device_array(a[neighbour[~first]]) for a in address),
        list_weight=(further[0], further[1], further[2]),
    )


class _GradientRows(NamedTuple):
    """Entries of the gradients at some nodes, sorted by node."""

    node: Int[np.ndarray, " r"]
    """Index of the node among those at which gradients are evaluated."""
    neighbour: Int[np.ndarray, " r"]
    """Number of the neighbour."""
    weight: Float[np.ndarray, "r 3"]
    """Weight of its temperature difference, along x, y, z [1/m]."""
    link: Int[np.ndarray, " r"]
    """Link to the neighbour."""
    is_src: Bool[np.ndarray, " r"]
    """True where the node is the first of the link."""


def gradient_rows(
    structure: AbstractStructure, at_nodes: Int[np.ndarray, " m"]
) -> _GradientRows:
    """Gradients at sorted nodes by least squares over links, see `gradient_at`."""
    links = structure.links()
    nodes = structure.nodes()
    slot = np.full(len(nodes.volume), -1)
    slot[at_nodes] = np.arange(len(at_nodes))
    node = np.concatenate([links.src, links.dst])
    neighbour = np.concatenate([links.dst, links.src])
    area = np.concatenate([links.area, links.area])
    used = np.flatnonzero(slot[node] >= 0)
    used = used[np.argsort(slot[node[used]], kind="stable")]
    node = slot[node[used]]
    neighbour = neighbour[used]
    area = area[used]
    step = nodes.location[neighbour] - nodes.location[at_nodes][node]
    length = np.einsum("ei,ei->e", step, step)
    weight = area / np.where(length > 0, length, 1)
    moment = np.zeros((len(at_nodes), 3, 3))
    for i in range(3):
        for j in range(3):
            product = weight * step[:, i] * step[:, j]
            moment[:, i, j] = np.bincount(node, product, len(at_nodes))
    solved = np.linalg.pinv(moment, rcond=_MIN_MOMENT, hermitian=True)
    row = np.einsum("eij,ej->ei", solved[node], step) * weight[:, None]
    count = len(links.src)
    return _GradientRows(
        node=node,
        neighbour=neighbour,
        weight=row,
        link=used % count,
        is_src=used < count,
    )


class BoundMap(Module):
    """Surface map of one body, with its arrays."""

    gradient: Gradient | None
    offset: _Components | None
    """Part of the vector from the node to the point that the gradient covers [m]."""
    along_flux: Float[Array, " s"] | None
    """Excess of the point over its node relative to that of the surface [-]."""
    at: _Depth = eqx.field(static=True)
    """Depth at which it is evaluated."""

    @property
    def needs_excess(self) -> bool:
        """True if the map needs the surface balance."""
        return self.along_flux is not None

    @property
    def is_limited(self) -> bool:
        """True if it needs the equilibrium with what acts on the surface."""
        return self.gradient is not None

    def read(
        self,
        theta: Float[Array, "..."],
        nodes: Float[Array, " m"],
        index: Int[Array, " s"],
        acting: SurfaceState | None,
    ) -> Float[Array, " s"]:
        """Temperature of every fragment above the reference [K].

        Args:
            theta: temperatures of all nodes, as a state [K].
            nodes: those of the nodes with a surface [K].
            index: index of each fragment's node among the latter.
            acting: state of the fragments; None if nothing has acted yet.
        """
        below = taken(nodes, index)
        total = below
        if self.gradient is not None and self.offset is not None:
            slopes = self.gradient(theta, nodes)
            for slope, length in zip(slopes, self.offset, strict=True):
                total = total + length * taken(slope, index)
        if acting is None:
            return total
        if self.along_flux is not None:
            total = total + self.along_flux * acting.excess
        if self.gradient is not None and acting.equilibrium is not None:
            around = self.gradient.neighbour_range(theta, nodes)
            limits = Range(taken(around.lowest, index), taken(around.highest, index))
            limits = limits.including(below + acting.excess)
            limits = limits.including(acting.equilibrium)
            total = jnp.clip(total, limits.lowest, limits.highest)
        if acting.held is not None and self.at == "surface":
            total = jnp.where(acting.held, below + acting.excess, total)
        return total


class AbstractSurfaceMap(Module):
    """Rule for the temperature of fragments from those of nodes."""

    @abc.abstractmethod
    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """Compute the arrays of this map for one body."""


class ConstantMap(AbstractSurfaceMap):
    """Temperature of the node: T_s = T."""

    @override
    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        del structure, dtype
        return BoundMap(gradient=None, offset=None, along_flux=None, at="surface")


class LinearMap(AbstractSurfaceMap):
    """Node temperature plus gradient times offset: T_s = T + g . (x_s - x)."""

    at: _Depth = eqx.field(static=True, default="surface")

    @override
    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        by = "linear_map", self.at, jnp.dtype(dtype).name
        return structure.found(by, lambda: self._bound(structure, dtype))

    def _bound(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        offset = structure.fragment_offset()
        if self.at == "surface":
            foot = structure.grid.fragment_foot
            offset = offset + foot - structure.cell_centre()
        return _with_gradient(
            structure, offset=offset, along_flux=None, at=self.at, dtype=dtype
        )


# From the mean of a cell to its surface, of a parabola with the flux at the surface and
# the gradient at the far side of the cell: T_s - T = (2 q'' / k + g) / 3 x distance.
_FLUX_FRACTION = 2 / 3
_GRADIENT_FRACTION = 1 / 3


class FluxCorrectedMap(AbstractSurfaceMap):
    """Surface balance along the normal, gradient along the surface.

    From the voxel under a fragment to the surface T_s - T = q'' d / k; from a deeper
    node to that voxel T_s - T = (2 q'' / k + g) d / 3, a parabola with the flux at one
    end and the gradient at the other. With the distance d [m], flux q'' [W/m^2],
    gradient g [K/m] and conductivity k [W/(m K)].
    """

    at: _Depth = eqx.field(static=True, default="surface")

    @override
    def bind(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        by = "flux_corrected_map", self.at, jnp.dtype(dtype).name
        unweighted = structure.found(by, lambda: self._bound(structure, dtype))
        longer = structure.weights.surface_distance
        if not is_traced(longer) and longer == 1:
            return unweighted
        assert unweighted.along_flux is not None
        flux = unweighted.along_flux * device_array(longer, dtype)
        return BoundMap(
            gradient=unweighted.gradient,
            offset=unweighted.offset,
            along_flux=flux,
            at=self.at,
        )

    def _bound(self, structure: AbstractStructure, dtype: Any) -> BoundMap:
        """The map without the weight of the surface's distance."""
        offset = structure.fragment_offset()
        normal = structure.grid.fragment_normal
        along = np.maximum(np.einsum("si,si->s", offset, normal), 0)[:, None] * normal
        outermost = structure.cell_depth() / structure.fragment_distance
        flux_fraction = _FLUX_FRACTION * (1 - outermost)
        if self.at == "surface":
            flux_fraction = flux_fraction + outermost
        flux = device_array(flux_fraction, dtype)
        inside = offset - (1 - _GRADIENT_FRACTION) * along
        return _with_gradient(
            structure, offset=inside, along_flux=flux, at=self.at, dtype=dtype
        )


def _with_gradient(structure, offset, along_flux, at: _Depth, dtype) -> BoundMap:
    # Zero but for rounding, as in a full volume: no gradient to compute.
    if np.abs(offset).max(initial=0) < 1e-6 * structure.grid.pitch:
        return BoundMap(gradient=None, offset=None, along_flux=along_flux, at=at)
    gradient = gradient_at(structure, np.unique(structure.fragment_node()), dtype)
    x, y, z = (device_array(offset[:, i], dtype) for i in range(3))
    return BoundMap(gradient=gradient, offset=(x, y, z), along_flux=along_flux, at=at)
