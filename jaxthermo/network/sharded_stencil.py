"""Stencil over several devices: one section of the body on each.

The stencil of a section reads the temperatures of the neighbouring sections where its
own state has an empty rim: both planes are sent by `ppermute` and written there before
each evaluation, and the rim of what it returns is empty again.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float
from typing_extensions import override

from ..parallel.lattice import on_each_device, with_neighbours
from .network import AbstractDerivedNetwork, AbstractNetwork, Address


_State = Float[Array, "..."]


class ShardedStencil(AbstractDerivedNetwork):
    """Stencils of the sections of a body, each on a device of its own."""

    base: AbstractNetwork
    """Stencil with the lattices of all sections, one after the other; each device has
    one that is complete, with its faces towards both neighbours."""
    devices: Mesh = eqx.field(static=True)

    @property
    @override
    def mesh(self) -> Mesh | None:
        return self.devices

    def _on_each(self, function: Callable[..., _State], *arguments: Array) -> _State:
        return on_each_device(self.devices, function, self.base, *arguments)

    @override
    def heat_rate(self, state: _State) -> _State:
        rate = lambda base, state: base.heat_rate(with_neighbours(state))
        return self._on_each(rate, state)

    @override
    def face_heat_rate(self, state: _State) -> _State:
        rate = lambda base, state: base.face_heat_rate(with_neighbours(state))
        return self._on_each(rate, state)

    @override
    def euler_step(self, state: _State, dt: Float[Array, ""]) -> _State:
        step = lambda base, state, dt: base.euler_step(with_neighbours(state), dt)
        return self._on_each(step, state, dt)

    @override
    def diagonal(self) -> _State:
        return self._on_each(lambda base: base.diagonal())

    @override
    def capacity(self) -> _State:
        if not self._capacity_varies:
            return self.base.capacity()
        return self._on_each(lambda base: base.capacity())

    @property
    def _capacity_varies(self) -> bool:
        return bool(jax.eval_shape(lambda: self.base.capacity()).ndim)

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        capacity = self.capacity()
        if not capacity.ndim:
            return capacity
        found = capacity.at[address].get(mode="promise_in_bounds")
        # Surface cells are padded with places that are no nodes and get no heat.
        return jnp.where(found > 0, found, jnp.inf)

    @override
    def total_capacity(self) -> Float[Array, ""]:
        if not self._capacity_varies:
            return self.base.total_capacity()
        total = lambda base: base.total_capacity()
        return on_each_device(self.devices, total, self.base, summed=True)

    @override
    def stored(self, state: _State) -> Float[Array, ""]:
        stored = lambda base, state: base.stored(state)
        return on_each_device(self.devices, stored, self.base, state, summed=True)
