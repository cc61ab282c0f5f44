"""Stencil of a body whose surface cuts voxels: uniform, and corrected there.

Only the nodes S at the surface differ in capacity and conductance from whole voxels.
With the uniform stencil's rate q_i and capacity C of whole voxels,

    C_i dT_i/dt = q_i + sum_j (G_ij - G) (T_j - T_i),    i and j in S,

so that a step is the uniform one, and then another change at these nodes:

    T_i + (C / C_i) (change of the uniform step + dt / C sum_j (G_ij - G) (T_j - T_i)).
"""

import math
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped
from typing_extensions import override

from ..arrays import added, taken
from .link_operator import RowNetwork
from .network import (
    AbstractDerivedNetwork,
    AbstractNetwork,
    Address,
    inverse,
    listed_or_default,
    precise_sum,
)


# Positions in a larger lattice cannot be counted in 32 bits.
_MAX_CELLS = 2**31 - 1


class CutStencil(AbstractDerivedNetwork):
    """Stencil of whole voxels, with corrections for the voxels the surface cuts."""

    base: AbstractNetwork
    """Stencil of whole voxels."""
    address: Address
    """Position of the surface nodes in the state, in its order."""
    links: RowNetwork
    """Differences G_ij - G between surface nodes [W/K], with the capacities of these
    nodes [J/K]."""
    inner_count: int | None = eqx.field(static=True, default=None)
    """Number of surface nodes inside a section of a body; the nodes after them lie in
    the neighbouring sections, in the rim of the state. None for an undivided body.
    Sections with fewer nodes are filled up with empty cells of infinite capacity."""

    def _inner(self, values: Shaped[Array, " m"]) -> Shaped[Array, " n"]:
        return values if self.inner_count is None else values[: self.inner_count]

    @property
    def _inner_address(self) -> Address:
        return tuple(map(self._inner, self.address))

    def _surface(self, values: Float[Array, "..."]) -> Float[Array, " m"]:
        return taken(values, self.address)

    def section_surface(
        self, state: Float[Array, "x y z"], beyond: Float[Array, "2 y z"]
    ) -> Float[Array, " m"]:
        """Temperatures of the nodes of a section, then of those in `beyond`.

        `beyond` holds the planes before and behind the section.
        """
        assert self.inner_count is not None
        x, y, z = (index[self.inner_count :] for index in self.address)
        plane = jnp.minimum(x, 1)
        outer_temperature = taken(beyond, (plane, y, z))
        inner_temperature = taken(state, self._inner_address)
        return jnp.concatenate([inner_temperature, outer_temperature])

    def corrected_rate(
        self, rate: Float[Array, "..."], surface: Float[Array, " m"]
    ) -> Float[Array, "..."]:
        """Conduction [W], from that of whole voxels and the surface temperatures."""
        return self._add(rate, self.links.heat_rate(surface))

    def corrected_step(
        self,
        stepped: Float[Array, "..."],
        old_surface: Float[Array, " m"],
        dt: Float[Array, ""],
    ) -> Float[Array, "..."]:
        """State after a step: that of whole voxels, corrected at the surface.

        `old_surface` is the surface temperature before the step.
        """
        uniform_change = self._surface(stepped) - old_surface
        node_capacity = self.links.node_capacity
        ratio = self.base.capacity_at(self.address) / node_capacity
        link_change = dt / node_capacity * self.links.heat_rate(old_surface)
        return self._add(stepped, link_change + (ratio - 1) * uniform_change)

    def _add(self, values: Float[Array, "..."], surface_values: Float[Array, " m"]):
        return added(
            values,
            self._inner_address,
            self._inner(surface_values),
            is_sorted=True,
            is_unique=self.inner_count is None,
        )

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return self.corrected_rate(self.base.heat_rate(state), self._surface(state))

    @override
    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        rate = self.base.face_heat_rate(state)
        return self.corrected_rate(rate, self._surface(state))

    @override
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        stepped = self.base.euler_step(state, dt)
        return self.corrected_step(stepped, old_surface=self._surface(state), dt=dt)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        return self._add(self.base.diagonal(), self.links.diagonal())

    @override
    def capacity(self) -> Float[Array, "..."]:
        # Cells that conduct nothing hold no node, and so have no capacity.
        capacity = jnp.where(self.base.diagonal() > 0, self.base.capacity(), 0)
        surface = self._inner(self.links.node_capacity)
        surface = jnp.where(jnp.isfinite(surface), surface, 0)
        return capacity.at[self._inner_address].set(surface)

    @override
    def max_rate(self) -> Float[Array, ""]:
        # Inside, capacities are those of whole voxels: no array of all is needed.
        rate = self.base.diagonal() * inverse(self.base.capacity())
        interior_rate = rate.at[self.address].set(0)
        diagonal = self._surface(self.base.diagonal()) + self.links.diagonal()
        surface_rate = diagonal * inverse(self.links.node_capacity)
        return jnp.maximum(interior_rate.max(), surface_rate.max())

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        shape = jax.eval_shape(self.base.diagonal).shape
        if math.prod(shape) > _MAX_CELLS:
            return self.capacity()[address]
        return _capacity_at(self, address, shape)

    def excess_capacity(self) -> Float[Array, " m"]:
        """Capacities of the surface nodes less those of whole voxels [J/K]."""
        node_capacity = self.links.node_capacity
        excess = node_capacity - self.base.capacity_at(self.address)
        return jnp.where(jnp.isfinite(node_capacity), excess, 0)

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return self.base.total_capacity() + precise_sum(self.excess_capacity())

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        # An array of all capacities would take as long to read as the state.
        surface_excess = self.excess_capacity() * self._surface(state)
        return self.base.stored(state) + precise_sum(surface_excess)


@partial(jax.jit, static_argnames="shape", inline=True)
def _capacity_at(
    network: CutStencil, address: Address, shape: tuple[int, ...]
) -> Float[Array, " m"]:
    """Capacities of some nodes [J/K], searched among those of the surface."""
    return listed_or_default(
        _flat_index(address, shape),
        listed=_flat_index(network._inner_address, shape),
        values=network._inner(network.links.node_capacity),
        default=network.base.capacity_at(address),
    )


def _flat_index(address: Address, shape: tuple[int, ...]) -> Int[Array, " m"]:
    x, y, z = address
    return (x * shape[1] + y) * shape[2] + z
