"""Forced convection by a coefficient that is linear in the speed of the wind."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import Time, TimeVarying
from ...voxels.selection import AbstractSelection
from ..boundary import Convection
from ..flux_law import Forcing
from ..surface import Binding, Omitted, Surface
from ..term import AbstractSurfaceTerm, OperatingPoint, Scale
from ..time_varying import Table, check_value, value_at
from ..windows import PiecewiseLinear


_CALM = 2.8  # [W/(m^2 K)]
_BY_SPEED = 3.0  # [J/(m^3 K)]


def wind_coefficient(speed: Any) -> Any:
    """Heat transfer coefficient of `LinearWind` [W/(m^2 K)] by the speed [m/s]."""
    return _CALM + _BY_SPEED * speed


def linear_in(value: TimeVarying, at_zero: Any, slope: Any) -> Any:
    """Linear function of a number, a table or another function of time."""
    function = _Linear(value, at_zero=at_zero, slope=slope)
    if isinstance(value, Table):
        return replace(value, values=function.at(value.values))
    if isinstance(value, PiecewiseLinear):
        first = function.at(value.first)
        return replace(value, first=first, last=function.at(value.last))
    return function if callable(value) else function.at(value)


class LinearWind(AbstractSurfaceTerm):
    """Wind over flat surfaces, with a coefficient that is linear in its speed.

    q = h (T_inf - T_s),    h = h_0 + c v [W/(m^2 K)]

    It has neither a direction nor a length: it is for the faces of buildings and
    collectors outdoors. The defaults are 2.8 + 3.0 v of Watmuff, Charters and Proctor
    (COMPLES 2, 1977, 56), for up to 7 m/s; the older 5.7 + 3.8 v of McAdams contains
    the radiation too, which is a term of its own here.

    Raises:
        InputError: for a negative number, or a speed that is negative at some time.

    Example:
        >>> import jaxthermo as jt
        >>> gust = jt.LinearWind(jt.Table([0.0, 60.0], [1.0, 5.0]), 290.0)
        >>> gust.convection.heat_transfer_coefficient.values.tolist()
        [5.8, 17.8]
    """

    name = "linear_wind"
    from_outside = True
    is_convective = True

    speed: TimeVarying
    """v of the wind [m/s], a number or a function of time."""
    temperature: TimeVarying
    """T_inf of the air [K], a number or a function of time."""
    calm: Any = _CALM
    """h_0, the coefficient without wind [W/(m^2 K)]."""
    by_speed: Any = _BY_SPEED
    """c, its rise with the speed [J/(m^3 K)]."""
    on: AbstractSelection | None = None
    """Part of the surface; several may be on parts without overlap."""

    def __check_init__(self):
        check_value(self.speed, "LinearWind(speed [m/s])", 0.0)
        check_value(self.temperature, "LinearWind(temperature [K])", 0.0)
        check_value(self.calm, "LinearWind(calm [W/(m^2 K)])", 0.0)
        check_value(self.by_speed, "LinearWind(by_speed [J/(m^3 K)])", 0.0)

    @property
    def convection(self) -> Convection:
        """The same heat flux by its heat transfer coefficient."""
        coefficient = linear_in(self.speed, self.calm, slope=self.by_speed)
        return Convection(coefficient, self.temperature, on=self.on)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        return self.convection.bind(surface)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return self.convection.forcing(end)

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        return self.convection.scale(point)


class _Linear(Module):
    """A function that is linear in another function of time."""

    value: Any
    at_zero: Any
    slope: Any

    def at(self, value: Any) -> Any:
        """The function at a value."""
        return self.at_zero + self.slope * value

    def __call__(self, time: Time) -> Float[Array, ""]:
        """The function at `time` [s]."""
        return jnp.asarray(self.at(value_at(self.value, time)), time.dtype)
