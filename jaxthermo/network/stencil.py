"""The dense masked stencil: the box of cells, with T = 0 outside the body.

A state is the lattice with one empty cell all round. Empty cells hold zero and stay
zero, so six neighbours are six shifted slices, without a branch or an index.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from .face_flux import face_heat_rate
from .network import AbstractNetwork, precise_sum
from .self_adjoint_primitive import Operator, computed_once, conduct, conduct_step


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
