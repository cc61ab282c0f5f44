"""The dense masked stencil: the box of cells, with T = 0 outside the body.

A state is the lattice with one empty cell all round. Empty cells hold zero and stay
zero, so six neighbours are six shifted slices, without a branch or an index.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped, UInt8

from .network import AbstractNetwork, inverse, precise_sum
from .self_adjoint_primitive import Operator, computed_once, conduct, conduct_step


# Conduction of a stencil as differences over faces.
#
# A stencil takes neighbours together and then the node as many times, of which rounding
# leaves something: little in a step, much in one of 1e8 s.


def face_heat_rate(
    state: Float[Array, "x y z"],
    conductances: Sequence[Float[Array, ""]],
    degrees: Sequence[Shaped[Array, "_ _ _"]],
) -> Float[Array, "x y z"]:
    """Conduction into each node [W]: exactly 0 where all neighbours are equally warm.

    Args:
        state: the lattice with one empty cell all round.
        conductances: of links along x, y, z [W/K].
        degrees: along each, of every cell inside: more than 0 where it has neighbours.
    """
    total = jnp.zeros_like(state)
    for axis, (conductance, degree) in enumerate(
        zip(conductances, degrees, strict=True)
    ):
        # Two cells beside each other that both have neighbours are each other's.
        node = jnp.moveaxis(jnp.pad(degree > 0, 1), axis, 0)
        here = jnp.moveaxis(state, axis, 0)
        flow = jnp.where(node[1:] & node[:-1], here[1:] - here[:-1], 0) * conductance
        none = jnp.zeros_like(flow[:1])
        net = jnp.concatenate([flow, none]) - jnp.concatenate([none, flow])
        total = total + jnp.moveaxis(net, 0, axis)
    return total


def solid_degree(solid: Bool[np.ndarray, "x y z"]) -> np.ndarray:
    """How many of the six neighbours of each solid voxel are solid; 0 elsewhere."""
    degree = np.zeros(solid.shape, np.uint8)
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        count = np.moveaxis(degree, axis, 0)
        both = (body[1:] & body[:-1]).view(np.uint8)
        count[1:] += both
        count[:-1] += both
    return degree


def _neighbour_sum(state):
    inner, before, after = slice(1, -1), slice(None, -2), slice(2, None)
    along_z = state[inner, inner, after] + state[inner, inner, before]
    along_y = state[inner, after, inner] + state[inner, before, inner]
    along_x = state[after, inner, inner] + state[before, inner, inner]
    return along_z + along_y + along_x


def _spread(state, degree):
    """The state inside, and the sum of neighbours less degree times it."""
    # The barrier keeps XLA from widening the bytes once, outside the time loop:
    # five bytes a voxel more to read at every step.
    state, degree = jax.lax.optimization_barrier((state, degree))
    centre = state[1:-1, 1:-1, 1:-1]
    spread = _neighbour_sum(state) - degree.astype(state.dtype) * centre
    return centre, jnp.where(degree > 0, spread, 0)


def uniform_change(state, ratio, degree):
    """Ratio (sum of six neighbours - degree T)."""
    return jnp.pad(ratio * _spread(state, degree)[1], 1)


def uniform_step(state, ratio, degree):
    """T + ratio (sum of six neighbours - degree T)."""
    centre, spread = _spread(state, degree)
    # As a row in memory: the CPU compiler vectorizes a loop over it, and one that
    # reloads a scalar it does not.
    row = jnp.broadcast_to(ratio, (1, 1, degree.shape[2]))
    return jnp.pad(centre + jax.lax.optimization_barrier(row) * spread, 1)


def _inside(values, degree):
    """Zero where no node has a neighbour: nothing conducts there."""
    return jnp.pad(jnp.where(degree > 0, values[1:-1, 1:-1, 1:-1], 0), 1)


def _pull(values, state, ratio, degree):
    # Apart, or the compiler reduces over the stencil without vectors.
    spread = conduct(UNIFORM, computed_once(values), jnp.ones_like(ratio), degree)
    return (computed_once(spread) * state).sum()


UNIFORM = Operator(uniform_change, uniform_step, _inside, _pull)


class UniformStencil(AbstractNetwork):
    """A body of one material: one conductance, one capacity, and a byte a voxel."""

    degree: UInt8[Array, "x y z"]
    conductance: Float[Array, ""]
    """Of each link, k * pitch [W/K]."""
    node_capacity: Float[Array, ""]
    """Of each voxel, rho c_p V [J/K]."""
    node_count: int

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        return conduct(UNIFORM, state, self.conductance, self.degree)

    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node, of differences over faces [W]."""
        return face_heat_rate(state, (self.conductance,) * 3, (self.degree,) * 3)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """T + r (sum of six neighbours - degree T), r = dt G / C."""
        ratio = dt * (self.conductance / self.node_capacity)
        return conduct_step(UNIFORM, state, ratio, self.degree)

    def diagonal(self) -> Float[Array, "..."]:
        """Conductance times degree [W/K]."""
        degree = self.degree.astype(self.conductance.dtype)
        return jnp.pad(self.conductance * degree, 1)

    def capacity(self) -> Float[Array, "..."]:
        """The same for every voxel [J/K]."""
        return self.node_capacity

    def largest_rate(self) -> Float[Array, ""]:
        """Of a voxel with the most solid neighbours [1/s]."""
        most = self.degree.max().astype(self.conductance.dtype)
        return most * self.conductance / self.node_capacity

    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""
        return self.node_capacity * self.node_count

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature [J]."""
        return self.node_capacity * precise_sum(state)


# The dense stencil of a body that conducts differently along x, y and z.
#
# As the uniform stencil, with a conductance an axis. How many neighbours a voxel has
# along each axis, 0 to 2, shares one byte: two bits an axis.


def solid_degrees(solid: Bool[np.ndarray, "x y z"]) -> np.ndarray:
    """Solid neighbours of each solid voxel: along x + 4 along y + 16 along z."""
    degrees = np.zeros(solid.shape, np.uint8)
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        count = np.moveaxis(degrees, axis, 0)
        both = (body[1:] & body[:-1]).view(np.uint8) << (2 * axis)
        count[1:] += both
        count[:-1] += both
    return degrees


def _pair_sums(state):
    """Of the two neighbours along x, y and z."""
    inner, before, after = slice(1, -1), slice(None, -2), slice(2, None)
    return (
        state[after, inner, inner] + state[before, inner, inner],
        state[inner, after, inner] + state[inner, before, inner],
        state[inner, inner, after] + state[inner, inner, before],
    )


class AxisStencil(AbstractNetwork):
    """A body of one material: three conductances, one capacity, and a byte a voxel."""

    degrees: UInt8[Array, "x y z"]
    conductance: Float[Array, "3"]
    """Of each link along x, y, z: k * pitch [W/K]."""
    node_capacity: Float[Array, ""]
    """Of each voxel, rho c_p V [J/K]."""
    node_count: int

    def _change(self, state, factor):
        """The state inside, and sum over the axes of factor (neighbours - degree T)."""
        # The barriers: see the uniform stencil.
        state, degrees = jax.lax.optimization_barrier((state, self.degrees))
        centre = state[1:-1, 1:-1, 1:-1]
        total = jnp.zeros_like(centre)
        for axis, pair in enumerate(_pair_sums(state)):
            row = jnp.broadcast_to(factor[axis], (1, 1, centre.shape[2]))
            degree = ((degrees >> jnp.uint8(2 * axis)) & jnp.uint8(3)).astype(row.dtype)
            total = total + jax.lax.optimization_barrier(row) * (pair - degree * centre)
        return centre, jnp.where(degrees > 0, total, 0)

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        return jnp.pad(self._change(state, self.conductance)[1], 1)

    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node, of differences over faces [W]."""
        degrees = tuple(map(self._degree, range(3)))
        return face_heat_rate(state, tuple(self.conductance), degrees)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """T + sum over the axes of r (two neighbours - degree T), r = dt G / C."""
        ratio = dt * (self.conductance / self.node_capacity)
        centre, change = self._change(state, ratio)
        return jnp.pad(centre + change, 1)

    def _degree(self, axis):
        """Neighbours along one axis of every voxel."""
        return ((self.degrees >> jnp.uint8(2 * axis)) & jnp.uint8(3)).astype(
            self.conductance.dtype
        )

    def diagonal(self) -> Float[Array, "..."]:
        """Sum of conductance times degree over the axes [W/K]."""
        total = sum(g * self._degree(axis) for axis, g in enumerate(self.conductance))
        return jnp.pad(jnp.asarray(total), 1)

    def capacity(self) -> Float[Array, "..."]:
        """The same for every voxel [J/K]."""
        return self.node_capacity

    def largest_rate(self) -> Float[Array, ""]:
        """Over all voxels [1/s]."""
        return self.diagonal().max() / self.node_capacity

    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""
        return self.node_capacity * self.node_count

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature [J]."""
        return self.node_capacity * precise_sum(state)


# The stencil of a lattice whose faces and cells differ: a body of several materials.
#
# A state is the lattice with one empty cell all round, as for the uniform stencil.


class LatticeStencil(AbstractNetwork):
    """A conductance for every face of a lattice, and a capacity for every cell."""

    face_conductance: tuple[
        Float[Array, "x_faces y z"],
        Float[Array, "x y_faces z"],
        Float[Array, "x y z_faces"],
    ]
    """Of the faces across x, y, z, the outer ones included [W/K]; 0 where closed."""
    cell_capacity: Float[Array, "x y z"]
    """[J/K]; 0 where there is no node."""

    def _rate(self, state):
        total = jnp.zeros_like(self.cell_capacity)
        for axis, conductance in enumerate(self.face_conductance):
            line = [slice(1, -1)] * 3
            line[axis] = slice(None)
            flow = conductance * jnp.diff(state[tuple(line)], axis=axis)
            total = total + jnp.diff(flow, axis=axis)
        return total

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        return jnp.pad(self._rate(state), 1)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """T + dt / C * (what flows in through six faces)."""
        rise = dt * inverse(self.cell_capacity) * self._rate(state)
        return jnp.pad(state[1:-1, 1:-1, 1:-1] + rise, 1)

    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the six face conductances [W/K]."""
        x, y, z = self.face_conductance
        total = x[1:] + x[:-1] + y[:, 1:] + y[:, :-1] + z[..., 1:] + z[..., :-1]
        return jnp.pad(total, 1)

    def capacity(self) -> Float[Array, "..."]:
        """Of each node [J/K]."""
        return jnp.pad(self.cell_capacity, 1)

    def largest_rate(self) -> Float[Array, ""]:
        """Over all nodes [1/s]."""
        return (self.diagonal() * inverse(self.capacity())).max()

    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""
        return precise_sum(self.cell_capacity)

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature [J]."""
        return precise_sum(self.cell_capacity * state[1:-1, 1:-1, 1:-1])
