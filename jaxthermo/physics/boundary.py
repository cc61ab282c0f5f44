"""Boundary terms: a fixed temperature, a heat flux, convection with a given h.

| term | heat flux into the surface |
|---|---|
| `FixedTemperature` | k (T_s - T_node) / distance, which holds the surface at T_s |
| `HeatFlux` | q'' |
| `Convection` | h (T_inf - T_surface) (Newton; thesis eq. 5) |

The temperature of the surface is not its node's: see `surface_energy_balance`.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import Time, TimeVarying, namespace
from ..voxels.fractions import selected_area
from ..voxels.selection import AbstractSelection
from .flux_law import (
    AbstractFluxLaw,
    Forcing,
    LinearLaw,
    PerCell,
    PerCellOrOne,
)
from .surface import Binding, Cover, Omitted, Surface
from .term import AbstractSurfaceTerm, OperatingPoint, Scale
from .time_varying import (
    Table,
    Until,
    check_one_of,
    check_value,
    for_jit,
    is_zero,
    largest,
    largest_size,
    smallest,
    value_at,
)
from .windows import PiecewiseLinear


def _is_number(value: Any) -> bool:
    """True if the value is one number at any time, not one per surface cell."""
    # A trace is needed for unknown functions only.
    if not callable(value):
        return np.ndim(value) == 0
    if isinstance(value, Table):
        return True
    if isinstance(value, PiecewiseLinear):
        return value.first.ndim == 1
    if isinstance(value, Until):
        return _is_number(value.value)
    time = jax.ShapeDtypeStruct((), jnp.result_type(float))
    return not eqx.filter_eval_shape(lambda t: value_at(value, t), time).shape


class ImposedFlux(AbstractFluxLaw):
    """A heat flux that does not depend on the temperature."""

    is_linear = True

    heat_flux: Any
    """[W/m^2]"""

    @property
    @override
    def imposed_flux(self) -> Any:
        return self.heat_flux

    @override
    def flux(self, time: Time, theta: PerCell) -> PerCellOrOne:
        return value_at(self.heat_flux, time)

    @override
    def slope(self, time: Time, theta: PerCell) -> PerCellOrOne:
        return jnp.zeros((), theta.dtype)

    @override
    def uniform_flux(self, time: Time) -> Float[Array, ""] | None:
        flux = value_at(self.heat_flux, time)
        return None if flux.ndim else flux

    @override
    def linear(self) -> LinearLaw | None:
        if not callable(self.heat_flux):
            return LinearLaw(self.heat_flux, 1.0)
        return LinearLaw(1.0, self.heat_flux) if _is_number(self.heat_flux) else None

    @override
    def max_slope(self, highest: Float[Array, ""], end: float) -> Float[Array, ""]:
        return jnp.zeros_like(highest)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return largest_size(self.heat_flux, end)

    @override
    def curvature(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return 0.0


class _Above(Module):
    """Temperature above the reference [K] as a function of time."""

    temperature: Any
    reference: Float[Any, ""]

    def __call__(self, time: Time) -> Float[Array, ""]:
        """The difference at `time` [s]."""
        return value_at(self.temperature, time) - self.reference


class Exchange(AbstractFluxLaw):
    """Newton's law, q = h (T_inf - T)."""

    is_linear = True

    coefficient: Any
    """h [W/(m^2 K)], a number or a function of time."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Any = 0.0
    """Temperature from which theta counts [K]."""

    @override
    def flux(self, time: Time, theta: PerCell) -> PerCellOrOne:
        # Differences first: they keep their digits in float32.
        above = value_at(self.temperature, time) - self.reference
        return value_at(self.coefficient, time) * (above - theta)

    @override
    def slope(self, time: Time, theta: PerCell) -> PerCellOrOne:
        return value_at(self.coefficient, time).astype(theta.dtype)

    @override
    def linear(self) -> LinearLaw | None:
        h = self.coefficient
        ambient = self.temperature
        if callable(h):
            return None
        if not callable(ambient):
            return LinearLaw(h * (ambient - self.reference), 1.0, h)
        # A function of time with one value per cell has no common forcing.
        if not _is_number(ambient) or jnp.ndim(self.reference):
            return None
        return LinearLaw(h, _Above(ambient, self.reference), h)

    @override
    def equilibrium(
        self, around: Float[Array, ""], imposed: PerCell, end: float
    ) -> PerCell:
        weakest = jnp.asarray(smallest(self.coefficient, end), imposed.dtype)
        return around + jnp.where(imposed > 0, imposed / weakest, 0)

    @override
    def max_slope(self, highest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # A coefficient that varies limits the step by its largest value.
        coefficient = self.coefficient
        if callable(coefficient):
            coefficient = largest(coefficient, end)
        return coefficient.astype(highest.dtype)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        warmest = largest(self.temperature, end)
        coldest = smallest(self.temperature, end)
        xp = namespace((warmest, coldest))
        gap = xp.maximum(warmest - within.lowest, within.highest - coldest)
        return largest(self.coefficient, end) * gap

    @override
    def curvature(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return 0.0


class FixedTemperature(AbstractSurfaceTerm):
    """A prescribed surface temperature T_s; on the whole surface without `on`.

    Other terms have no effect where a temperature is prescribed, but that surface
    radiates to others through `RadiativeExchange` and stays at T_s. Two of these on one
    piece of surface are an error.
    """

    name = "fixed_temperature"
    is_dirichlet = True

    temperature: TimeVarying
    """T_s [K], a number or a function of time."""
    on: AbstractSelection | None = None

    def __check_init__(self):
        check_value(self.temperature, "FixedTemperature(temperature [K])", 0.0)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        law = Exchange(
            coefficient=np.ones((), surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
        )
        # The surface is at T_s: its heat goes through the half cell to the node. A
        # fragment has one temperature: its centre decides.
        covers: list[Cover | Omitted] = []
        for body in surface.bodies:
            exposed = body.exposed(self.on)
            is_omitted = isinstance(exposed, Omitted)
            ones = np.ones(len(body.area), surface.dtype)
            covers.append(exposed if is_omitted else (ones, exposed))
        return tuple(
            bound
            if isinstance(bound, Omitted)
            else bound._replace(effective_area=bound.effective_area * surface.half_cell)
            for bound in surface.bind(law, covers)
        )

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)


class HeatFlux(AbstractSurfaceTerm):
    """A heat flux q'' into the surface; on the whole surface without `on`.

    Give either the flux or its heat rate Q, which the selected surface that nothing
    touches receives evenly: q'' = Q / A, with A of all bodies together.

    Example:
        >>> import jaxthermo as jt
        >>> top = jt.HeatFlux(heat_rate=60.0, on=jt.Side((0.0, 0.0, 1.0)))
    """

    name = "heat_flux"

    heat_flux: TimeVarying | None = None
    """q'' [W/m^2], positive into the body; a number or a function of time."""
    on: AbstractSelection | None = None
    heat_rate: TimeVarying | None = None
    """Q [W], in place of the flux; a number or a function of time."""

    def __check_init__(self):
        values = {"heat_flux [W/m^2]": self.heat_flux, "heat_rate [W]": self.heat_rate}
        check_one_of("HeatFlux", values)

    @property
    def _strength(self) -> Any:
        return self.heat_rate if self.heat_flux is None else self.heat_flux

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        if surface.prune and is_zero(self._strength):
            return (Omitted("the heat flux is 0"),)
        law = ImposedFlux(for_jit(self._strength, surface.dtype))
        covers = [body.cover(body.area, self.on) for body in surface.bodies]
        if self.heat_rate is not None:
            covers = _shares_of_all(covers)
        return surface.bind(law, covers)

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        # Cooling counts like heating: what matters is the gradient that it makes.
        strength = float(largest_size(self._strength, point.end))
        if self.heat_flux is not None:
            return Scale(heat_flux=strength)
        grids = [structure.grid for structure in point.structures]
        return Scale(heat_flux=strength / selected_area(self.on, grids))


def _shares_of_all(covers: Sequence[Cover | Omitted]) -> list[Cover | Omitted]:
    """Covers with areas relative to the area of all [-]."""
    acting = [cover for cover in covers if not isinstance(cover, Omitted)]
    total = sum(float(area[mask].sum()) for area, mask in acting)
    if not total:
        return list(covers)
    return [
        cover if isinstance(cover, Omitted) else (cover[0] / total, cover[1])
        for cover in covers
    ]


class Convection(AbstractSurfaceTerm):
    """Convection, q = h (T_inf - T_s); on the whole surface without `on`.

    Example:
        >>> import jaxthermo as jt
        >>> still = jt.Convection(10.0, 290.0)
        >>> top = jt.Convection(25.0, 290.0, on=jt.Side((0.0, 0.0, 1.0)))
    """

    name = "convection"
    from_outside = True
    is_convective = True

    heat_transfer_coefficient: TimeVarying
    """h [W/(m^2 K)], a number or a function of time."""
    temperature: TimeVarying
    """T_inf of the fluid [K], a number or a function of time."""
    on: AbstractSelection | None = None

    def __check_init__(self):
        h = self.heat_transfer_coefficient
        check_value(h, "Convection(heat_transfer_coefficient [W/(m^2 K)])", 0.0)
        check_value(self.temperature, "Convection(temperature [K])", 0.0)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        if surface.prune and is_zero(self.heat_transfer_coefficient):
            return (Omitted("the heat transfer coefficient is 0"),)
        law = Exchange(
            coefficient=for_jit(self.heat_transfer_coefficient, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
        )
        return surface.bind(law, on=self.on)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        h = float(largest(self.heat_transfer_coefficient, point.end))
        return Scale(heat_transfer_coefficient=h)


def toward(temperature: Any, end: float | int) -> Forcing:
    """Bounds of the exchange with surroundings at a temperature [K], which may vary."""
    return Forcing(highest=largest(temperature, end), lowest=smallest(temperature, end))


def either(bounds: Sequence[Forcing]) -> Forcing:
    """Bounds of the exchange with several surroundings at once [K]."""
    xp = namespace(bounds)
    return Forcing(
        highest=xp.stack([bound.highest for bound in bounds]).max(),
        lowest=xp.stack([bound.lowest for bound in bounds]).min(),
    )
