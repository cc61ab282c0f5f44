"""Stencil of a body whose surface cuts voxels: uniform, and corrected there.

Only the nodes S at the surface have capacities and conductances of their own. With the
uniform stencil's rate q_i and capacity C of whole voxels,

    C_i dT_i/dt = q_i + sum_j (G_ij - G) (T_j - T_i),    i and j in S,

so that a step is the uniform one, and then another change at these nodes:

    T_i + (C / C_i) (change of the uniform step + dt / C sum_j (G_ij - G) (T_j - T_i)).
"""

import math
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Shaped
from typing_extensions import override

from ..arrays import added, taken
from .link_operator import RowNetwork
from .network import (
    AbstractDerivedNetwork,
    AbstractNetwork,
    Address,
    inverse,
    precise_sum,
)


# Positions in a larger lattice cannot be counted in 32 bits.
_MAX_CELLS = 2**31 - 1


class CutStencil(AbstractDerivedNetwork):
    """Voxels of which some are cut."""

    base: AbstractNetwork
    """Stencil of whole voxels."""
    address: Address
    """Position of the surface nodes in the state, in its order."""
    links: RowNetwork
    """Links of the surface nodes to each other, less whole ones [W/K], with the
    capacities of these nodes [J/K]."""
    own: int | None = eqx.field(static=True, default=None)
    """Number of the body's own nodes where it is a section of one; those after them are
    of the sections beside it, in the rim of the state. None where all are its own.
    Where there are fewer, empty cells of infinite capacity fill up their number."""

    def _of_own(self, values: Shaped[Array, " m"]) -> Shaped[Array, " n"]:
        return values if self.own is None else values[: self.own]

    @property
    def _own_address(self) -> Address:
        return tuple(map(self._of_own, self.address))

    def _surface(self, values: Float[Array, "..."]) -> Float[Array, " m"]:
        return taken(values, self.address)

    def section_surface(
        self, state: Float[Array, "x y z"], beyond: Float[Array, "2 y z"]
    ) -> Float[Array, " m"]:
        """Temperatures of the nodes of a section and beside it, which are in `beyond`.

        These are the planes before and behind the section.
        """
        assert self.own is not None
        x, y, z = (index[self.own :] for index in self.address)
        beside = jnp.minimum(x, 1), y, z
        others = taken(beyond, beside)
        own = taken(state, self._own_address)
        return jnp.concatenate([own, others])

    def corrected_rate(
        self, rate: Float[Array, "..."], surface: Float[Array, " m"]
    ) -> Float[Array, "..."]:
        """Conduction [W], from that of whole voxels and the nodes' temperatures."""
        return self._add(rate, self.links.heat_rate(surface))

    def corrected_step(
        self,
        stepped: Float[Array, "..."],
        before: Float[Array, " m"],
        dt: Float[Array, ""],
    ) -> Float[Array, "..."]:
        """The state after a step, from that of whole voxels and the nodes before."""
        after = self._surface(stepped)
        more = dt / self.links.node_capacity * self.links.heat_rate(before)
        whole = self.base.capacity_at(self.address)
        ratio = whole / self.links.node_capacity
        return self._add(stepped, more + (ratio - 1) * (after - before))

    def _add(self, values: Float[Array, "..."], more: Float[Array, " m"]):
        address, is_unique = self._own_address, self.own is None
        own = self._of_own(more)
        return added(values, address, own, is_sorted=True, is_unique=is_unique)

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
        return self.corrected_step(stepped, self._surface(state), dt)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        return self._add(self.base.diagonal(), self.links.diagonal())

    @override
    def capacity(self) -> Float[Array, "..."]:
        # Without a node there is none: nothing conducts there.
        whole = jnp.where(self.base.diagonal() > 0, self.base.capacity(), 0)
        own = self._of_own(self.links.node_capacity)
        return whole.at[self._own_address].set(jnp.where(jnp.isfinite(own), own, 0))

    @override
    def max_rate(self) -> Float[Array, ""]:
        # Without an array of all capacities, which are those of whole voxels elsewhere.
        rate = self.base.diagonal() * inverse(self.base.capacity())
        others = rate.at[self.address].set(0)
        own = self._surface(self.base.diagonal()) + self.links.diagonal()
        capacity = self.links.node_capacity
        return jnp.maximum(others.max(), (own * inverse(capacity)).max())

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        shape = jax.eval_shape(self.base.diagonal).shape
        if math.prod(shape) > _MAX_CELLS:
            return self.capacity()[address]
        return _capacity_at(self, address, shape)

    def excess_capacity(self) -> Float[Array, " m"]:
        """Capacities of the surface nodes less those of whole voxels [J/K]."""
        own = self.links.node_capacity
        excess = own - self.base.capacity_at(self.address)
        return jnp.where(jnp.isfinite(own), excess, 0)

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return self.base.total_capacity() + precise_sum(self.excess_capacity())

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        # Without an array of all capacities, which takes as long to read as the state.
        more = self.excess_capacity() * self._surface(state)
        return self.base.stored(state) + precise_sum(more)


@partial(jax.jit, static_argnames="shape", inline=True)
def _capacity_at(
    network: CutStencil, address: Address, shape: tuple[int, ...]
) -> Float[Array, " m"]:
    """Capacities of some nodes [J/K], searched among those of the surface."""
    # An array of the whole lattice would be as large as a state.
    place = lambda at: (at[0] * shape[1] + at[1]) * shape[2] + at[2]
    own, wanted = place(network._own_address), place(address)
    index = jnp.searchsorted(own, wanted).clip(max=len(own) - 1)
    whole = network.base.capacity_at(address)
    return jnp.where(own[index] == wanted, network.links.node_capacity[index], whole)
