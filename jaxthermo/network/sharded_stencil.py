"""Stencil over several devices: one section of the body on each.

The planes of the neighbouring sections are sent by `ppermute`, while each device
evaluates the stencil of its section, see `overlap`. Voxels that the surface cuts are
corrected afterwards, since they may have links to any voxel in those planes.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Float
from typing_extensions import override

from ..parallel.lattice import (
    Sectioned,
    next_planes,
    on_each_device,
    section_numbers,
    within_section,
)
from .cut_stencil import CutStencil
from .link_operator import RowNetwork
from .network import AbstractDerivedNetwork, Address, StepStart, precise_sum
from .overlap import apply_overlapping_exchange
from .stencil import AbstractStencil


_State = Float[Array, "..."]


class SectionCuts(Module):
    """Voxels that the surface cuts, by section: the fields of their `CutStencil`s.

    The lists of all sections follow one another.
    """

    address: Address
    """Position in the state of the section."""
    links: RowNetwork
    inner_count: int = eqx.field(static=True)
    """Number of surface nodes inside each section."""


class ShardedStencil(AbstractDerivedNetwork):
    """Stencils of the sections of a body, with one section on each device."""

    base: AbstractStencil
    """Stencil with the lattices of all sections, one after the other. Each device holds
    a complete stencil, with the faces towards both neighbours."""
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

        def with_section(base, cuts, *local):
            section = base
            if self.cuts is not None:
                address, links = cuts.values
                section = CutStencil(
                    base=base,
                    address=address,
                    links=links,
                    inner_count=self.cuts.inner_count,
                )
            return function(section, *local)

        cuts = self.cuts and Sectioned((self.cuts.address, self.cuts.links))
        return on_each_device(
            self.devices, with_section, self.base, cuts, *arguments, reduced=reduced
        )

    def _rate(self, law: Callable[..., _State], state: _State) -> _State:
        def rate(section, state):
            beyond = next_planes(state)
            stencil = section if self.cuts is None else section.base
            rate = apply_overlapping_exchange(
                law, stencil=stencil, state=state, beyond=beyond
            )
            if self.cuts is None:
                return rate
            return section.corrected_rate(rate, section.section_surface(state, beyond))

        return self._on_each(rate, state)

    @override
    def heat_rate(self, state: _State) -> _State:
        return self._rate(lambda section, state: section.heat_rate(state), state)

    @override
    def face_heat_rate(self, state: _State) -> _State:
        return self._rate(lambda section, state: section.face_heat_rate(state), state)

    @override
    def euler_step(self, state: _State, dt: Float[Array, ""]) -> _State:
        return self._combined(state, dt, lambda stepped: stepped)

    @override
    def combined_step(
        self,
        change: _State,
        start: StepStart,
        dt: Float[Array, ""],
        combine: Callable[..., _State],
        *fields: _State,
    ) -> _State:
        def combine_with_rise(stepped, first, rise, *further):
            return combine(stepped, rise, first, *further)

        first, *further = fields
        return self._combined(
            change, dt, combine_with_rise, first, start.rise, *further
        )

    def _combined(
        self,
        state: _State,
        dt: Float[Array, ""],
        combine: Callable[..., _State],
        *fields: _State,
    ) -> _State:
        """combine(euler_step(state, dt), *fields); it may overwrite the first field."""

        def step(section, state, dt, *fields):
            beyond = next_planes(state)

            def conduct(stencil, state):
                return stencil.euler_step(state, dt)

            def conduct_and_combine(stencil, state, *fields):
                return combine(stencil.euler_step(state, dt), *fields)

            if self.cuts is None:
                return apply_overlapping_exchange(
                    conduct_and_combine,
                    stencil=section,
                    state=state,
                    beyond=beyond,
                    fields=fields,
                )
            stepped = apply_overlapping_exchange(
                conduct, stencil=section.base, state=state, beyond=beyond
            )
            old_surface = section.section_surface(state, beyond)
            stepped = section.corrected_step(stepped, old_surface=old_surface, dt=dt)
            return combine(stepped, *fields)

        return self._on_each(step, state, dt, *fields)

    @override
    def diagonal(self) -> _State:
        return self._on_each(lambda section: section.diagonal())

    @override
    def max_rate(self) -> Float[Array, ""]:
        return self._on_each(lambda section: section.max_rate(), reduced=jax.lax.pmax)

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

        def section_capacity(section, number, *address):
            x, y, z = within_section(number, address, length)
            capacity = section.capacity_at((jnp.clip(x, 0, length - 1), y, z))
            return jnp.where((x >= 0) & (x < length), capacity, 0)

        number = section_numbers(self.devices)
        capacity = self._on_each(
            section_capacity, number, *address, reduced=jax.lax.psum
        )
        # Surface cells are padded with places that are no nodes and get no heat.
        return jnp.where(capacity > 0, capacity, jnp.inf)

    @override
    def total_capacity(self) -> Float[Array, ""]:
        if self._whole_capacity_varies:
            return self._on_each(
                lambda section: section.total_capacity(), reduced=jax.lax.psum
            )
        # The uniform stencil counts the nodes of all sections.
        total = self.base.total_capacity()
        if self.cuts is None:
            return total
        return total + self._on_each(
            lambda section: precise_sum(section.excess_capacity()),
            reduced=jax.lax.psum,
        )

    @override
    def stored(self, state: _State) -> Float[Array, ""]:
        return self._on_each(
            lambda section, state: section.stored(state), state, reduced=jax.lax.psum
        )
