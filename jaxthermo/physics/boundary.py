"""Boundary terms: a fixed temperature, a heat flux, convection with a given h.

| term | heat rate into a fragment of area A |
|---|---|
| `FixedTemperature` | 2 k A / pitch (T_s - T): the half cell between node and surface |
| `HeatFlux` | q'' A |
| `Convection` | U A (T_inf - T), 1/U = 1/h + pitch/(2 k) (Newton; thesis eq. 5) |

T is the node's: heat exchanged with the surface passes half a cell first, without which
the error would be of first order in the pitch.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..array_types import Scalar
from ..voxels.select import AbstractSelection
from .term import AbstractBoundTerm, AbstractTerm, Drive, LeftOut, Surface
from .values import check_value, for_jit, is_zero, largest, value_at


class BoundExchange(AbstractBoundTerm):
    """Heat exchanged with something at a given temperature through a coefficient."""

    fragments: Int[Array, " m"] | None
    area: Float[Array, " m"]
    coefficient: Any
    """[W/(m^2 K)]: one number, one a fragment, or a function of time."""
    half_cell: Float[Array, "*s"] | None
    """2 k / pitch in series with the coefficient [W/(m^2 K)]; None: in it already."""
    temperature: Any
    reference: Float[Array, ""]

    def _through_half_cell(self, coefficient):
        if self.half_cell is None:
            return coefficient
        total = coefficient + self.half_cell
        product = coefficient * self.half_cell
        return jnp.where(total > 0, product / jnp.where(total > 0, total, 1), 0)

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Coefficient times area times the temperature difference [W]."""
        above = value_at(self.temperature, time) - self.reference
        coefficient = value_at(self.coefficient, time)
        return self._through_half_cell(coefficient) * self.area * (above - theta)

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """Coefficient times area [W/K]."""
        del hottest
        coefficient = self.coefficient
        if callable(coefficient):
            coefficient = largest(coefficient, end).astype(self.area.dtype)
        return self._through_half_cell(coefficient) * self.area


class BoundFlux(AbstractBoundTerm):
    """An imposed heat flux, whatever the temperature."""

    fragments: Int[Array, " m"] | None
    area: Float[Array, " m"]
    """Times whatever share of the flux each fragment takes [m^2]."""
    heat_flux: Any

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Heat flux times area [W]."""
        del theta
        return value_at(self.heat_flux, time) * self.area

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """None: it does not depend on the temperature."""
        del hottest, end
        return jnp.zeros_like(self.area)


def _choose(
    surface: Surface, on: AbstractSelection | None
) -> tuple[Any, Float[Array, " m"]] | LeftOut:
    """Fragments `on` selects, as an array for jit (None: all), and their areas."""
    fragments = surface.chosen(on)
    if fragments is None:
        return None, surface.area
    if not len(fragments):
        return LeftOut("`on` selects no fragment of this body")
    return jnp.asarray(fragments), surface.area[fragments]


def _half_cell(surface: Surface, fragments) -> Float[Array, "*s"]:
    """Conductance between node and surface for unit area, 2 k / pitch [W/(m^2 K)]."""
    k = surface.conductivity
    if fragments is not None and k.ndim:
        k = k[fragments]
    return 2 * k / surface.pitch


class FixedTemperature(AbstractTerm):
    """The surface held at a temperature; the whole surface without `on`."""

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

    def bind(self, surface: Surface, reference: Scalar) -> AbstractBoundTerm | LeftOut:
        """The chosen fragments, through half a cell of their own material."""
        chosen = _choose(surface, self.on)
        if isinstance(chosen, LeftOut):
            return chosen
        fragments, area = chosen
        return BoundExchange(
            fragments=fragments,
            area=area,
            coefficient=_half_cell(surface, fragments),
            half_cell=None,
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )

    def drive(self, end: float | int) -> Drive:
        """Towards its temperature [K]."""
        return Drive(temperature=largest(self.temperature, end))


class HeatFlux(AbstractTerm):
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

    def bind(self, surface: Surface, reference: Scalar) -> AbstractBoundTerm | LeftOut:
        """The chosen fragments."""
        del reference
        if is_zero(self.heat_flux):
            return LeftOut("the heat flux is 0")
        chosen = _choose(surface, self.on)
        if isinstance(chosen, LeftOut):
            return chosen
        fragments, area = chosen
        return BoundFlux(
            fragments=fragments,
            area=area,
            heat_flux=for_jit(self.heat_flux, surface.dtype),
        )

    def drive(self, end: float | int) -> Drive:
        """An imposed heat flux [W/m^2]."""
        return Drive(heat_flux=largest(self.heat_flux, end))


class Convection(AbstractTerm):
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

    def bind(self, surface: Surface, reference: Scalar) -> AbstractBoundTerm | LeftOut:
        """The chosen fragments."""
        if is_zero(self.heat_transfer_coefficient):
            return LeftOut("the heat transfer coefficient is 0")
        chosen = _choose(surface, self.on)
        if isinstance(chosen, LeftOut):
            return chosen
        fragments, area = chosen
        return BoundExchange(
            fragments=fragments,
            area=area,
            coefficient=for_jit(self.heat_transfer_coefficient, surface.dtype),
            half_cell=_half_cell(surface, fragments),
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )

    def drive(self, end: float | int) -> Drive:
        """Towards its temperature [K]."""
        return Drive(temperature=largest(self.temperature, end))
