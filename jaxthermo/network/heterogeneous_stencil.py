"""The stencil of a lattice whose faces and cells differ: a body of several materials.

A state is the lattice with one empty cell all round, as for the uniform stencil.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .network import AbstractNetwork, inverse, precise_sum


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
