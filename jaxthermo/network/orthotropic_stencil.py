"""The dense stencil of a body that conducts differently along x, y and z.

As the uniform stencil, with a conductance an axis. How many neighbours a voxel has
along each axis, 0 to 2, shares one byte: two bits an axis.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from .face_flux import face_heat_rate
from .network import AbstractNetwork, precise_sum


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
