"""Boundary terms: a fixed temperature, a heat flux, convection with a given h.

| term | heat flux into the surface |
|---|---|
| `FixedTemperature` | what holds the surface at T_s, through k / distance to the node |
| `HeatFlux` | q'' |
| `Convection` | h (T_inf - T_surface) (Newton; thesis eq. 5) |

The temperature of the surface is not its node's: see `balance`.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Scalar
from .term import (
    AbstractFluxLaw,
    AbstractSurfaceTerm,
    Binding,
    Forcing,
    LinearLaw,
    Omitted,
    Surface,
    TemperatureRange,
    binding,
)
from .time_varying import (
    check_value,
    for_jit,
    is_number,
    is_zero,
    largest,
    largest_size,
    smallest,
    value_at,
)


class ImposedFlux(AbstractFluxLaw):
    """A heat flux that does not depend on the temperature."""

    heat_flux: Any
    """[W/m^2]"""

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The imposed flux."""
        del theta
        return value_at(self.heat_flux, time)

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """None."""
        del time
        return jnp.zeros((), theta.dtype)

    def linear(self) -> LinearLaw | None:
        """One flux for all, or one a place that does not change."""
        if not callable(self.heat_flux):
            return LinearLaw(self.heat_flux, 1.0)
        return LinearLaw(1.0, self.heat_flux) if is_number(self.heat_flux) else None

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """None."""
        del end
        return jnp.zeros_like(hottest)

    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """The largest of its values."""
        return largest_size(self.heat_flux, reach.end)

    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """None."""
        del reach
        return 0.0

    @property
    def is_linear(self) -> bool:
        """Yes."""
        return True


class Above(eqx.Module):
    """A temperature that changes, above the reference."""

    temperature: Any
    reference: Float[Array, ""]

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """At `time` [s], [K]."""
        return value_at(self.temperature, time) - self.reference


class Exchange(AbstractFluxLaw):
    """Heat exchanged with something at a given temperature through a coefficient."""

    coefficient: Any
    """[W/(m^2 K)]: a number or a function of time."""
    temperature: Any
    """[K]"""
    reference: Float[Array, "*#m"]

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Newton's law, h (T_inf - T)."""
        above = value_at(self.temperature, time) - self.reference
        return value_at(self.coefficient, time) * (above - theta)

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The coefficient, h."""
        return value_at(self.coefficient, time).astype(theta.dtype)

    def linear(self) -> LinearLaw | None:
        """If h does not change, and T_inf is one for all or does not either."""
        h, there = self.coefficient, self.temperature
        if callable(h):
            return None
        if not callable(there):
            return LinearLaw(h * (there - self.reference), 1.0, h)
        if not is_number(there) or jnp.ndim(self.reference):
            return None
        return LinearLaw(h, Above(there, self.reference), h)

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """The largest h."""
        coefficient = self.coefficient
        if callable(coefficient):
            coefficient = largest(coefficient, end)
        return coefficient.astype(hottest.dtype)

    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """The largest h times the largest difference there can be."""
        most = largest(self.temperature, reach.end)
        least = smallest(self.temperature, reach.end)
        gap = jnp.maximum(most - reach.lowest, reach.highest - least)
        return largest(self.coefficient, reach.end) * gap

    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """None."""
        del reach
        return 0.0

    @property
    def is_linear(self) -> bool:
        """Yes."""
        return True


class FixedTemperature(AbstractSurfaceTerm):
    """The surface held at a temperature; the whole surface without `on`.

    Other terms do nothing where it holds: what they bring, the holding takes. Two of
    these on one piece of surface are an error.
    """

    temperature: Any
    """T_s [K], a number or a function of time."""
    on: Any = None

    def __check_init__(self):
        check_value(self.temperature, "FixedTemperature(temperature [K])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "fixed_temperature"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its temperature."""
        return (self.temperature,)

    @property
    def is_dirichlet(self) -> bool:
        """Yes."""
        return True

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """The chosen fragments; its share is the way to the node [W/K]."""
        acts = surface.acted_on(self.on)
        if isinstance(acts, Omitted):
            return acts
        law = Exchange(
            coefficient=jnp.ones((), surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )
        return (binding(surface.half_cell, law, acts),)

    def forcing(self, end: float | int) -> Forcing:
        """Towards its temperature [K]."""
        return Forcing(temperature=largest(self.temperature, end))


class HeatFlux(AbstractSurfaceTerm):
    """A heat flux into the surface; the whole surface without `on`."""

    heat_flux: Any
    """q'' [W/m^2], positive into the body; a number or a function of time."""
    on: Any = None

    def __check_init__(self):
        check_value(self.heat_flux, "HeatFlux(heat_flux [W/m^2])")

    @property
    def name(self) -> str:
        """In the ledger."""
        return "heat_flux"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its flux."""
        return (self.heat_flux,)

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """The chosen fragments."""
        del reference
        if surface.prune and is_zero(self.heat_flux):
            return Omitted("the heat flux is 0")
        acts = surface.acted_on(self.on)
        if isinstance(acts, Omitted):
            return acts
        law = ImposedFlux(for_jit(self.heat_flux, surface.dtype))
        return (binding(surface.area, law, acts),)

    def forcing(self, end: float | int) -> Forcing:
        """An imposed heat flux [W/m^2]."""
        return Forcing(heat_flux=largest(self.heat_flux, end))


class Convection(AbstractSurfaceTerm):
    """Newton's law with a given coefficient; the whole surface without `on`."""

    heat_transfer_coefficient: Any
    """h [W/(m^2 K)], a number or a function of time."""
    temperature: Any
    """T_inf of the fluid [K], a number or a function of time."""
    on: Any = None

    def __check_init__(self):
        h = self.heat_transfer_coefficient
        check_value(h, "Convection(heat_transfer_coefficient [W/(m^2 K)])", 0.0)
        check_value(self.temperature, "Convection(temperature [K])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "convection"

    @property
    def values(self) -> tuple[Any, ...]:
        """Both its values."""
        return (self.heat_transfer_coefficient, self.temperature)

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """The chosen fragments."""
        if surface.prune and is_zero(self.heat_transfer_coefficient):
            return Omitted("the heat transfer coefficient is 0")
        acts = surface.acted_on(self.on)
        if isinstance(acts, Omitted):
            return acts
        law = Exchange(
            coefficient=for_jit(self.heat_transfer_coefficient, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )
        return (binding(surface.area, law, acts),)

    def forcing(self, end: float | int) -> Forcing:
        """Towards its temperature [K]."""
        return Forcing(temperature=largest(self.temperature, end))
