"""Stencil over several devices: one section of the body on each, and planes between.

    C_i dT_i/dt = q_i + sum_j G_ij (T_j - T_i),    i and j a pair across a cut,

q_i the rate of the section's own stencil, in which it lies by itself. The own stencil
does not wait for the planes of the neighbours: they are sent meanwhile.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float
from typing_extensions import override

from ..parallel.lattice import on_each_device, planes_beyond
from .network import AbstractDerivedNetwork, AbstractNetwork, Address, inverse


_State = Float[Array, "..."]


class ShardedStencil(AbstractDerivedNetwork):
    """Stencils of the sections of a body, each on a device of its own."""

    base: AbstractNetwork
    """Stencil with the lattices of all sections, one after the other; each device has
    one that is complete."""
    before: Float[Array, "s y z"]
    """Conductance of each section's faces towards the section before it [W/K]."""
    behind: Float[Array, "s y z"]
    """The same towards the section behind it."""
    devices: Mesh = eqx.field(static=True)

    @property
    @override
    def mesh(self) -> Mesh | None:
        return self.devices

    def _on_each(self, function: Callable[..., _State], *states: _State) -> _State:
        return on_each_device(self.devices, function, self, *states)

    def _across(self, state: _State) -> tuple[_State, _State]:
        """Heat rates over the faces at both ends, into the section [W]."""
        before, behind = planes_beyond(state)
        own = state[1:2, 1:-1, 1:-1], state[-2:-1, 1:-1, 1:-1]
        return self.before * (before - own[0]), self.behind * (behind - own[1])

    @override
    def heat_rate(self, state: _State) -> _State:
        def rate(own, state):
            return _with_ends(own.base.heat_rate(state), *own._across(state))

        return self._on_each(rate, state)

    @override
    def face_heat_rate(self, state: _State) -> _State:
        def rate(own, state):
            return _with_ends(own.base.face_heat_rate(state), *own._across(state))

        return self._on_each(rate, state)

    @override
    def euler_step(self, state: _State, dt: Float[Array, ""]) -> _State:
        def step(own, state, dt):
            before, behind = own._across(state)
            capacity = own.base.capacity()
            first, last = (
                (capacity[at, 1:-1, 1:-1] if capacity.ndim else capacity)
                for at in (slice(1, 2), slice(-2, -1))
            )
            rises = dt * inverse(first) * before, dt * inverse(last) * behind
            return _with_ends(own.base.euler_step(state, dt), *rises)

        return on_each_device(self.devices, step, self, state, dt)

    @override
    def diagonal(self) -> _State:
        def diagonal(own):
            return _with_ends(own.base.diagonal(), own.before, own.behind)

        return self._on_each(diagonal)

    @override
    def capacity(self) -> _State:
        if not self._capacity_varies:
            return self.base.capacity()
        return self._on_each(lambda own: own.base.capacity())

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
        total = lambda own: own.base.total_capacity()
        return on_each_device(self.devices, total, self, summed=True)

    @override
    def stored(self, state: _State) -> Float[Array, ""]:
        stored = lambda own, state: own.base.stored(state)
        return on_each_device(self.devices, stored, self, state, summed=True)


def _with_ends(values: _State, first: _State, last: _State) -> _State:
    """Values of a section with those of its first and last plane added."""
    # The planes alone are written again.
    values = jax.lax.optimization_barrier(values)
    for plane, more in ((1, first), (values.shape[0] - 2, last)):
        own = values[plane : plane + 1, 1:-1, 1:-1] + more
        values = jax.lax.dynamic_update_slice(values, own, (plane, 1, 1))
    return values
