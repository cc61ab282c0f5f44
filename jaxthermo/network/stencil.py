"""Dense conduction stencils: the box of cells around a body, with T = 0 outside it.

| stencil | body |
|---|---|
| `Stencil` | one material: a conductance, or one for each axis, and a byte per voxel |
| `HeterogeneousStencil` | several materials: a conductance for each face |

A state is the lattice with one empty cell on each side. Empty cells hold zero and stay
zero, so that six neighbours are six shifted slices, without a branch or an index.
"""

import abc
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped, UInt8
from typing_extensions import override

from .network import AbstractNetwork, Address, inverse, precise_sum
from .self_adjoint_primitive import Operator, computed_once, conduct, conduct_step


Beyond = tuple[Bool[Array, "s y z"], Bool[Array, "s y z"]]
"""True for the voxels before the first and behind the last plane along x, where these
are on other devices and their temperatures in the rim of a state."""


def _face_heat_rate(
    state: Float[Array, "x y z"],
    by_axis: Sequence[tuple[Float[Array, ""], Shaped[Array, "_ _ _"]]],
    beyond: Beyond | None,
) -> Float[Array, "x y z"]:
    """Conduction into each node [W], exactly 0 between equal temperatures.

    The state has one empty cell on each side. By axis are the conductance of links
    [W/K], and degrees, which are positive in cells with neighbours along that axis.
    """
    # A stencil sums the neighbours and subtracts a multiple of the node, which leaves a
    # rounding error: negligible in one step, but not in a step of 1e8 s.
    centre = state[1:-1, 1:-1, 1:-1]
    total = jnp.zeros_like(centre)
    for axis, (conductance, degree) in enumerate(by_axis):
        # Two adjacent cells that both have neighbours are neighbours of each other.
        node = jnp.pad(degree > 0, 1)
        if beyond is not None and axis == 0:
            first, last = (jnp.pad(plane, ((0, 0), (1, 1), (1, 1))) for plane in beyond)
            node = jnp.concatenate([first, node[1:-1], last])
        net = jnp.zeros_like(centre)
        for side in (slice(None, -2), slice(2, None)):
            neighbour = [slice(1, -1)] * 3
            neighbour[axis] = side
            difference = state[tuple(neighbour)] - centre
            net = net + jnp.where(node[tuple(neighbour)], difference, 0)
        total = total + jnp.where(degree > 0, net, 0) * conductance
    return jnp.pad(total, 1)


def solid_degree(solid: Bool[np.ndarray, "x y z"], bits: int = 0) -> np.ndarray:
    """Number of solid neighbours of each solid voxel, 0 to 6; 0 elsewhere.

    With `bits=2` those along x, + 4 times those along y, + 16 times those along z.
    """
    degree = np.zeros(solid.shape, np.uint8)
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        count = np.moveaxis(degree, axis, 0)
        is_linked = (body[1:] & body[:-1]).view(np.uint8) << (bits * axis)
        count[1:] += is_linked
        count[:-1] += is_linked
    return degree


def end_planes(values: Shaped[Array, "x y z"], count: int) -> Shaped[Array, "_ y z"]:
    """The first and the last `count` planes, one after the other."""
    return jnp.concatenate([values[:count], values[-count:]])


class _NeighbourSums(NamedTuple):
    """Sums of the two neighbours of each inner cell along an axis."""

    x: Array
    y: Array
    z: Array


def _neighbour_sums(state):
    inner = slice(1, -1)
    low = slice(None, -2)
    high = slice(2, None)
    return _NeighbourSums(
        x=state[high, inner, inner] + state[low, inner, inner],
        y=state[inner, high, inner] + state[inner, low, inner],
        z=state[inner, inner, high] + state[inner, inner, low],
    )


def _row(value, lattice):
    # As a row in memory: the CPU compiler vectorizes a loop over it, and one that
    # reloads a scalar it does not.
    row = jnp.broadcast_to(value, (1, 1, lattice.shape[2]))
    return jax.lax.optimization_barrier(row)


def _spread(state, ratio, degree):
    """Inner state, and ratio (sum of the neighbours - degree T) of every node."""
    # The barrier keeps XLA from widening the bytes once, outside the time loop, which
    # would make every step read more.
    state, degree = jax.lax.optimization_barrier((state, degree))
    centre = state[1:-1, 1:-1, 1:-1]
    sums = _neighbour_sums(state)
    if ratio.ndim:
        total = jnp.zeros_like(centre)
        for axis, pair in enumerate(sums):
            axis_degree = _axis_degree(degree, axis, state.dtype)
            total = total + _row(ratio[axis], centre) * (pair - axis_degree * centre)
    else:
        neighbours = sums.z + sums.y + sums.x
        spread = neighbours - degree.astype(state.dtype) * centre
        total = _row(ratio, centre) * spread
    return centre, jnp.where(degree > 0, total, 0)


def _change(state, ratio, degree):
    _, spread = _spread(state, ratio, degree)
    return jnp.pad(spread, 1)


def _step(state, ratio, degree):
    centre, spread = _spread(state, ratio, degree)
    return jnp.pad(centre + spread, 1)


def _inside(values, degree):
    """Values with zeros where no node has a neighbour: nothing conducts there."""
    return jnp.pad(jnp.where(degree > 0, values[1:-1, 1:-1, 1:-1], 0), 1)


def _pull(values, state, ratio, degree):
    values = computed_once(values)
    slopes = []
    for unit in np.eye(ratio.size, dtype=ratio.dtype):
        spread = conduct(
            _STENCIL,
            state=values,
            factors=jnp.asarray(unit.reshape(ratio.shape)),
            layout=degree,
        )
        # In a separate loop: a reduction over the stencil would not be vectorized.
        slopes.append((computed_once(spread) * state).sum())
    return jnp.stack(slopes).reshape(ratio.shape)


_STENCIL = Operator(change=_change, step=_step, inside=_inside, pull=_pull)


def _axis_degree(degree, axis, dtype):
    return ((degree >> jnp.uint8(2 * axis)) & jnp.uint8(3)).astype(dtype)


class AbstractStencil(AbstractNetwork):
    """Stencil of a body, or of a section of one."""

    @abc.abstractmethod
    def ends(self) -> "AbstractStencil":
        """Stencil of the first two and the last two planes, one after the other."""


class Stencil(AbstractStencil):
    """One material: one conductance or three, a capacity, and a byte for each voxel."""

    node_capacity: Float[Array, ""]
    """Heat capacity of each voxel, rho c_p V [J/K]."""
    node_count: int
    degree: UInt8[Array, "x y z"]
    """Number of neighbours of each node; with three conductances the numbers along x,
    y and z in two bits each (`solid_degree`)."""
    conductance: Float[Array, "*axes"]
    """Conductance of each link, k * pitch [W/K], or of those along x, y and z."""
    beyond: Beyond | None = None

    @override
    def ends(self) -> "Stencil":
        return replace(self, degree=end_planes(self.degree, 2))

    def _by_axis(self) -> list[tuple[Float[Array, ""], Shaped[Array, "x y z"]]]:
        """Conductance and number of links along each axis; all links for one of k."""
        if not self.conductance.ndim:
            return [(self.conductance, self.degree)] * 3
        dtype = self.conductance.dtype
        return [
            (conductance, _axis_degree(self.degree, axis, dtype))
            for axis, conductance in enumerate(self.conductance)
        ]

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return conduct(
            _STENCIL, state=state, factors=self.conductance, layout=self.degree
        )

    @override
    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return _face_heat_rate(state, self._by_axis(), self.beyond)

    @override
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        ratio = dt * (self.conductance / self.node_capacity)
        return conduct_step(_STENCIL, state=state, factors=ratio, layout=self.degree)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        by_axis = self._by_axis()[: self.conductance.size]
        total = sum(g * degree.astype(g.dtype) for g, degree in by_axis)
        return jnp.pad(jnp.asarray(total), 1)

    @override
    def max_rate(self) -> Float[Array, ""]:
        return self.diagonal().max() / self.node_capacity

    @override
    def capacity(self) -> Float[Array, "..."]:
        return self.node_capacity

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return self.node_capacity * self.node_count

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        return self.node_capacity * precise_sum(state)


class HeterogeneousStencil(AbstractStencil):
    """Several materials: a conductance for each face, a capacity for each cell."""

    face_conductance: tuple[
        Float[Array, "x_faces y z"],
        Float[Array, "x y_faces z"],
        Float[Array, "x y z_faces"],
    ]
    """Conductances of faces across x, y, z with the outer ones [W/K]; 0 if closed."""
    cell_capacity: Float[Array, "x y z"]
    """Heat capacity [J/K]; 0 where there is no node."""

    @override
    def ends(self) -> "HeterogeneousStencil":
        x, y, z = self.face_conductance
        # Between both pairs of planes is a face, too.
        return replace(
            self,
            face_conductance=(
                jnp.concatenate([x[:3], x[-2:]]),
                end_planes(y, 2),
                end_planes(z, 2),
            ),
            cell_capacity=end_planes(self.cell_capacity, 2),
        )

    def _rate(self, state):
        total = jnp.zeros_like(self.cell_capacity)
        for axis, conductance in enumerate(self.face_conductance):
            line = [slice(1, -1)] * 3
            line[axis] = slice(None)
            flow = conductance * jnp.diff(state[tuple(line)], axis=axis)
            total = total + jnp.diff(flow, axis=axis)
        return total

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.pad(self._rate(state), 1)

    @override
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        rise = dt * inverse(self.cell_capacity) * self._rate(state)
        return jnp.pad(state[1:-1, 1:-1, 1:-1] + rise, 1)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        x, y, z = self.face_conductance
        total = x[1:] + x[:-1] + y[:, 1:] + y[:, :-1] + z[..., 1:] + z[..., :-1]
        return jnp.pad(total, 1)

    @override
    def capacity(self) -> Float[Array, "..."]:
        return jnp.pad(self.cell_capacity, 1)

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        return self.cell_capacity[tuple(index - 1 for index in address)]

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return precise_sum(self.cell_capacity)

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        return precise_sum(self.cell_capacity * state[1:-1, 1:-1, 1:-1])
