"""Stencil over several devices: one section of the body on each.

The planes of the neighbouring sections are sent by `ppermute`, while each device
evaluates the stencil of its section, see `overlap`. Voxels that the surface cuts are
corrected afterwards, since they may have links to any in those planes.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float
from typing_extensions import override

from ..module import Module
from ..parallel.lattice import (
    Sectioned,
    next_planes,
    on_each_device,
    section_numbers,
    within_section,
)
from .cut_stencil import CutStencil
from .link_operator import RowNetwork
from .network import AbstractDerivedNetwork, Address, precise_sum
from .overlap import overlapped
from .stencil import AbstractStencil


_State = Float[Array, "..."]


class SectionCuts(Module):
    """Voxels of the sections that the surface cuts: arguments of their `CutStencil`s.

    The lists of all sections, one after the other.
    """

    address: Address
    """Position in a device's own part of the state."""
    links: RowNetwork
    own: int = eqx.field(static=True)
    """Number of nodes of each section's own."""


class ShardedStencil(AbstractDerivedNetwork):
    """Stencils of the sections of a body, each on a device of its own."""

    base: AbstractStencil
    """Stencil with the lattices of all sections, one after the other; each device has
    one that is complete, with its faces towards both neighbours."""
    devices: Mesh = eqx.field(static=True)
    cuts: SectionCuts | None = None
    """None where all voxels are whole."""

    @property
    @override
    def mesh(self) -> Mesh | None:
        return self.devices

    def _on_each(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        reduced: Callable[[Any, str], Any] | None = None,
    ) -> Any:
        """Call a function with the stencil of each device's section."""

        def own(base, cuts, *given):
            if self.cuts is not None:
                base = CutStencil(base, *cuts.values, own=self.cuts.own)
            return function(base, *given)

        cuts = self.cuts and Sectioned((self.cuts.address, self.cuts.links))
        return on_each_device(
            self.devices, own, self.base, cuts, *arguments, reduced=reduced
        )

    def _rate(self, law: Callable[..., _State], state: _State) -> _State:
        def rate(section, state):
            beyond = next_planes(state)
            if self.cuts is None:
                return overlapped(law, stencil=section, state=state, beyond=beyond)
            whole = overlapped(law, stencil=section.base, state=state, beyond=beyond)
            surface = section.section_surface(state, beyond)
            return section.corrected_rate(whole, surface)

        return self._on_each(rate, state)

    @override
    def heat_rate(self, state: _State) -> _State:
        return self._rate(lambda part, state: part.heat_rate(state), state)

    @override
    def face_heat_rate(self, state: _State) -> _State:
        return self._rate(lambda part, state: part.face_heat_rate(state), state)

    @override
    def euler_step(self, state: _State, dt: Float[Array, ""]) -> _State:
        return self.combined_step(state, dt, lambda stepped: stepped)

    @override
    def combined_step(
        self,
        state: _State,
        dt: Float[Array, ""],
        combine: Callable[..., _State],
        *others: _State,
    ) -> _State:
        def step(section, state, dt, *others):
            beyond = next_planes(state)
            law = lambda part, state, *others: combine(
                part.euler_step(state, dt), *others
            )
            if self.cuts is None:
                return overlapped(
                    law, stencil=section, state=state, beyond=beyond, others=others
                )
            conduct = lambda part, state: part.euler_step(state, dt)
            whole = overlapped(
                conduct, stencil=section.base, state=state, beyond=beyond
            )
            before = section.section_surface(state, beyond)
            return combine(section.corrected_step(whole, before, dt), *others)

        return self._on_each(step, state, dt, *others)

    @override
    def diagonal(self) -> _State:
        return self._on_each(lambda section: section.diagonal())

    @override
    def max_rate(self) -> Float[Array, ""]:
        rate = lambda section: section.max_rate()
        return self._on_each(rate, reduced=jax.lax.pmax)

    @override
    def capacity(self) -> _State:
        if not self._capacity_varies:
            return self.base.capacity()
        return self._on_each(lambda section: section.capacity())

    @property
    def _capacity_varies(self) -> bool:
        return self.cuts is not None or self._whole_capacity_varies

    @property
    def _whole_capacity_varies(self) -> bool:
        return bool(jax.eval_shape(lambda: self.base.capacity()).ndim)

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        if not self._capacity_varies:
            return self.base.capacity()
        length = jax.eval_shape(self.diagonal).shape[0] // self.devices.size

        def found(section, number, *address):
            x, *others = within_section(number, address, length)
            there = section.capacity_at((jnp.clip(x, 0, length - 1), *others))
            return jnp.where((x >= 0) & (x < length), there, 0)

        number = section_numbers(self.devices)
        capacity = self._on_each(found, number, *address, reduced=jax.lax.psum)
        # Surface cells are padded with places that are no nodes and get no heat.
        return jnp.where(capacity > 0, capacity, jnp.inf)

    @override
    def total_capacity(self) -> Float[Array, ""]:
        if self._whole_capacity_varies:
            total = lambda section: section.total_capacity()
            return self._on_each(total, reduced=jax.lax.psum)
        # Counted for all sections.
        total = self.base.total_capacity()
        if self.cuts is None:
            return total
        excess = lambda section: precise_sum(section.excess_capacity())
        return total + self._on_each(excess, reduced=jax.lax.psum)

    @override
    def stored(self, state: _State) -> Float[Array, ""]:
        stored = lambda section, state: section.stored(state)
        return self._on_each(stored, state, reduced=jax.lax.psum)
