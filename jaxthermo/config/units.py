"""Quantities with units, read once when a config is loaded: "2 mm" -> 0.002."""

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import pint

from ..errors import InputError
from .show import show


@dataclass(frozen=True)
class Dimension:
    """What a config value measures, and how to ask for it."""

    noun: str
    unit: str
    example: str
    only: tuple[str, ...] = ()
    """If given, the units allowed: pint cannot tell an angle from a plain ratio."""


LENGTH = Dimension("a length", "m", "2 mm")
TIME = Dimension("a time", "s", "3 min")
TEMPERATURE = Dimension("a temperature", "K", "25 degC")
HEAT_FLUX = Dimension("a heat flux", "W/m^2", "1 kW/m^2")
IRRADIANCE = Dimension("an irradiance", "W/m^2", "800 W/m^2")
HEAT_TRANSFER_COEFFICIENT = Dimension(
    "a heat transfer coefficient", "W/(m^2 K)", "10 W/(m^2 K)"
)
CONTACT_CONDUCTANCE = Dimension(
    "a contact conductance ('bonded' for no resistance)",
    "W/(m^2 K)",
    "1000 W/(m^2 K)",
)
HEAT_RATE_DENSITY = Dimension("a heat rate density", "W/m^3", "5 kW/m^3")
RADIANT_INTENSITY = Dimension("a radiant intensity", "W/sr", "20 W/sr")
RADIANCE = Dimension("a radiance", "W/(m^2 sr)", "100 W/(m^2 sr)")
SPEED = Dimension("a speed", "m/s", "3 m/s")
CONDUCTIVITY = Dimension("a conductivity", "W/(m K)", "16 W/(m K)")
DENSITY = Dimension("a density", "kg/m^3", "8000 kg/m^3")
SPECIFIC_HEAT = Dimension("a specific heat", "J/(kg K)", "500 J/(kg K)")
ANGLE = Dimension(
    "an angle",
    "rad",
    "30 deg",
    only=("deg", "degree", "degrees", "°", "rad", "radian", "radians", "mrad", "turn"),
)
NUMBER = Dimension("a number", "", "0.9", only=("%", "percent"))

_NUMBER = re.compile(r"\s*([-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(.*)", re.S)
# A power on a power ("m^9^9^9") would be evaluated, and may never end.
_TOWER = re.compile(r"[\d)]\s*(?:\*\*|\^)")
_LONGEST_UNIT = 40


def to_si(value: Any, dimension: Dimension) -> float:
    """The value in SI units; a bare number is taken as SI already.

    Args:
        value: a number, a number in a string, or a string such as "2 mm".
        dimension: what the value has to measure.

    Raises:
        InputError: if it is no finite number of that dimension.
    """
    if isinstance(value, str):
        number, unit = _split(value, dimension)
        number = _with_unit(number, unit, value, dimension) if unit else number
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = _float(value)
    else:
        raise InputError(_expected(value, dimension))
    if not math.isfinite(number):
        raise InputError(f"must be finite, got {show(value)}")
    return number


def _expected(value: Any, dimension: Dimension) -> str:
    return f"expected {dimension.noun} such as '{dimension.example}', got {show(value)}"


def _float(value: float | int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _split(text: str, dimension: Dimension) -> tuple[float, str]:
    match = _NUMBER.fullmatch(text)
    if match is not None:
        return float(match[1]), match[2].strip()
    try:
        return float(text), ""
    except ValueError:
        raise InputError(_expected(text, dimension)) from None


def _with_unit(number: float, unit: str, text: str, dimension: Dimension) -> float:
    if dimension.only and unit not in dimension.only:
        raise InputError(_expected(text, dimension))
    registry = _registry()
    try:
        if len(unit) > _LONGEST_UNIT or _TOWER.search(unit):
            raise ValueError
        # Only a temperature is affine; in W/(m^2 degC) the degree is a difference.
        parsed = registry.parse_units(unit, as_delta=dimension is not TEMPERATURE)
    except Exception as error:  # pint's parser raises whatever it stumbles on
        raise InputError(
            f"{_expected(text, dimension)} (unknown unit {show(unit)})"
        ) from error
    try:
        quantity = registry.Quantity(number, parsed)
        # For pint W/sr and W are one: 4 pi apart, they must not be mixed up.
        if _steradians(quantity) != _steradians(registry.Quantity(1, dimension.unit)):
            raise ValueError
        return float(quantity.to(dimension.unit).magnitude)
    except (pint.PintError, ArithmeticError, ValueError) as error:
        hint = {"C": " (degrees Celsius are 'degC')", "F": " (write 'degF')"}
        hint = hint.get(unit, "") if dimension is TEMPERATURE else ""
        raise InputError(_expected(text, dimension) + hint) from error


def _steradians(quantity: Any) -> Any:
    """The power of the steradian in a unit."""
    return dict(quantity.unit_items()).get("steradian", 0)


@cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(cache_folder=None)
