"""Air inside a closed body whose temperature follows from that of the walls.

    C dT_air/dt = sum_s h A_s (T_s - T_air) + n C (T_out - T_air)

with the capacity C = rho c V of the air, the surface temperatures T_s of all that faces
it, and the exchange n with outer air. The flux h (T_air - T_s) is part of the balance
of each surface. The sum is what the surfaces lose, so that the air gains exactly that.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from equinox import Module, field
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import Time, TimeVarying
from ...errors import InputError
from ...voxels.selection import known_number
from ..boundary import toward
from ..flux_law import AbstractFluxLaw, Forcing, PerCell, PerCellOrOne
from ..surface import Binding, Omitted, Surface
from ..time_varying import check_value, for_jit, is_zero, largest, value_at
from .interior_air import AbstractInteriorAir, inner_covers


class AirLaw(AbstractFluxLaw):
    """Newton's law, q = h (T_air - T), with the temperature of a body of air."""

    is_linear = True

    coefficient: Any
    """h [W/(m^2 K)], a number or a function of time."""
    air: int = field(static=True)
    """Number of the body of air."""
    temperature: Any
    """T_air [K]."""
    reference: Any = 0.0
    """Temperature from which theta counts [K]."""

    @override
    def flux(self, time: Time, theta: PerCell) -> PerCellOrOne:
        above = self.temperature - self.reference
        return value_at(self.coefficient, time) * (above - theta)

    @override
    def slope(self, time: Time, theta: PerCell) -> PerCellOrOne:
        return value_at(self.coefficient, time).astype(theta.dtype)

    @override
    def max_slope(self, highest: Float[Array, ""], end: float) -> Float[Array, ""]:
        return largest(self.coefficient, end).astype(highest.dtype)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return largest(self.coefficient, end) * (within.highest - within.lowest)

    @override
    def curvature(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return 0.0

    @override
    def in_air(self, temperatures: Mapping[int, Float[Array, ""]]) -> AbstractFluxLaw:
        return replace(self, temperature=temperatures[self.air])


class AirExchange(Module):
    """Heat that a body of air receives from outside and from surfaces."""

    body: int = field(static=True)
    """Number of the body of air."""
    entry: int = field(static=True)
    """Its entry in the energy ledger."""
    walls: tuple[int, ...] = field(static=True)
    """Entries of the surfaces that it loses heat to."""
    rate: Any
    """n [1/s], a number or a function of time."""
    outside: Any
    """T_out [K], a number or a function of time."""
    temperature: Any = 0.0
    """T_air [K], which `Program.in_air` fills in."""

    def heat_rate(
        self, time: Time, capacity: Float[Array, ""], rates: Float[Array, " c"]
    ) -> Float[Array, ""]:
        """Heat rate into the air [W], from those of all ledger entries [W]."""
        gap = value_at(self.outside, time) - self.temperature
        heat = value_at(self.rate, time) * capacity * gap
        return heat - rates[np.array(self.walls, int)].sum()


class EnclosedAir(AbstractInteriorAir):
    """Air of a volume and a temperature of its own in the cavities of a body.

    C dT_air/dt = sum_s h A_s (T_s - T_air) + n C (T_out - T_air)

    The air is another body of the scene, an `AirVolume`.

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Material(45.0, 7850.0, specific_heat=480.0)
        >>> box = jt.shapes.box((1.0, 0.5, 0.5))
        >>> sheet = jt.Sheet(box, (jt.Layer(steel, 0.8e-3),), pitch=0.25)
        >>> van = jt.Body(sheet, temperature=283.0)
        >>> air = jt.Body(jt.AirVolume(0.25), temperature=293.0)
        >>> inside = jt.EnclosedAir(5.0, body=0, air=1)
        >>> scene = jt.Scene((van, air), (inside,))
    """

    heat_transfer_coefficient: TimeVarying
    """h [W/(m^2 K)], a number or a function of time."""
    exchange: TimeVarying = 0.0
    """n [1/s], the volume of outer air that enters in a second over V; a number or a
    function of time."""
    temperature: TimeVarying | None = None
    """T_out of the air that enters [K], a number or a function of time."""
    body: int | str = field(static=True, default=0, kw_only=True)
    """Number or name of the body that encloses the air."""
    air: int | str = field(static=True, kw_only=True)
    """Number or name of the body of air."""

    def __check_init__(self):
        h = self.heat_transfer_coefficient
        check_value(h, "EnclosedAir(heat_transfer_coefficient [W/(m^2 K)])", 0.0)
        check_value(self.exchange, "EnclosedAir(exchange [1/s])", 0.0)
        if self.temperature is not None:
            check_value(self.temperature, "EnclosedAir(temperature [K])", 0.0)
        elif not is_zero(self.exchange):
            raise InputError(
                "EnclosedAir(exchange=): give the `temperature` of the air that enters"
            )

    @property
    def air_number(self) -> int:
        """Number of the body of air in its scene."""
        return known_number(self.air)

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        return (known_number(self.body), self.air_number)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        covers = inner_covers(surface, known_number(self.body), "EnclosedAir")
        law = AirLaw(
            coefficient=for_jit(self.heat_transfer_coefficient, surface.dtype),
            air=self.air_number,
            temperature=np.zeros((), surface.dtype),
        )
        return surface.bind(law, covers)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return Forcing() if self.temperature is None else toward(self.temperature, end)

    def exchanged(self, entry: int, walls: tuple[int, ...], dtype: Any) -> AirExchange:
        """The heat of its air, by entries of the energy ledger."""
        outside = 0.0 if self.temperature is None else self.temperature
        return AirExchange(
            body=self.air_number,
            entry=entry,
            walls=walls,
            rate=for_jit(self.exchange, dtype),
            outside=for_jit(outside, dtype),
        )
