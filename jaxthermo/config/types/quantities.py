"""Quantities: field types that validate to plain SI numbers, "2 mm" to 0.002.

A field says its unit where it is declared, `Annotated[float, LENGTH]`: validation,
messages, JSON Schemas and the units of fitted parameters all read it there.
"""

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Protocol, runtime_checkable

import pint
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ...errors import InputError
from ..messages import MISTAKE, quoted


ALLOW_EXTREME = "allow_extreme_temperatures"
_COLDEST = 150.0
"""Temperature below which a bare number is taken for degrees Celsius [K]."""
_NUMBER = re.compile(r"\s*([-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(.*)", re.S)
# A power on a power ("m^9^9^9") would be evaluated, and may never end.
_TOWER = re.compile(r"[\d)]\s*(?:\*\*|\^)")
_JSON_LIMITS = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
}
_MAX_UNIT_LENGTH = 40
"""Length of a unit's text above which it is not parsed [characters]."""


@dataclass(frozen=True)
class Unit:
    """The SI unit of a field, and the words with which a message asks for it."""

    symbol: str
    noun: str
    example: str
    only: tuple[str, ...] = ()
    """If given, the units allowed: pint cannot tell an angle from a plain ratio."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner = handler(source)
        return core_schema.no_info_before_validator_function(self._read, inner)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        # Pydantic leaves the limits of a validated number under their own names.
        number = {_JSON_LIMITS.get(k, k): v for k, v in handler(schema).items()}
        pattern = r"^\s*[-+]?\.?\d"
        text = {"type": "string", "pattern": pattern, "examples": [self.example]}
        unit = {"unit": self.symbol} if self.symbol else {}
        return {"anyOf": [number, text], **unit}

    def _read(self, value: Any) -> float:
        try:
            return to_si(value, self)
        except InputError as error:
            raise refuse(str(error)) from error


LENGTH = Unit("m", "a length", "2 mm")
TIME = Unit("s", "a time", "3 min")
TEMPERATURE = Unit("K", "a temperature", "25 degC")
HEAT_FLUX = Unit("W/m^2", "a heat flux", "1 kW/m^2")
IRRADIANCE = Unit("W/m^2", "an irradiance", "800 W/m^2")
HEAT_TRANSFER_COEFFICIENT = Unit(
    "W/(m^2 K)", "a heat transfer coefficient", "10 W/(m^2 K)"
)
CONTACT_CONDUCTANCE = Unit(
    "W/(m^2 K)",
    "a contact conductance ('bonded' for no resistance)",
    "1000 W/(m^2 K)",
)
HEAT_RATE_DENSITY = Unit("W/m^3", "a heat rate density", "5 kW/m^3")
RADIANT_INTENSITY = Unit("W/sr", "a radiant intensity", "20 W/sr")
RADIANCE = Unit("W/(m^2 sr)", "a radiance", "100 W/(m^2 sr)")
SPEED = Unit("m/s", "a speed", "3 m/s")
CONDUCTIVITY = Unit("W/(m K)", "a conductivity", "16 W/(m K)")
DENSITY = Unit("kg/m^3", "a density", "8000 kg/m^3")
SPECIFIC_HEAT = Unit("J/(kg K)", "a specific heat", "500 J/(kg K)")
ANGLE = Unit(
    "rad",
    "an angle",
    "30 deg",
    only=("deg", "degree", "degrees", "°", "rad", "radian", "radians", "mrad", "turn"),
)
NUMBER = Unit("", "a number", "0.9", only=("%", "percent"))


def to_si(value: Any, unit: Unit) -> float:
    """The value in SI units; a bare number is taken as SI already.

    Args:
        value: a number, a number in a string, or a string such as "2 mm".
        unit: what the value is converted to.

    Raises:
        InputError: if it is no finite number of that dimension.
    """
    if isinstance(value, str):
        number, given = _split(value, unit)
        number = _converted(number, given, value, unit) if given else number
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = _float(value)
    else:
        raise InputError(_expected(value, unit))
    if not math.isfinite(number):
        raise InputError(f"must be finite, got {quoted(value)}")
    return number


def _expected(value: Any, unit: Unit) -> str:
    return f"expected {unit.noun} such as '{unit.example}', got {quoted(value)}"


def _float(value: float | int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _split(text: str, unit: Unit) -> tuple[float, str]:
    match = _NUMBER.fullmatch(text)
    if match is not None:
        return float(match[1]), match[2].strip()
    try:
        return float(text), ""
    except ValueError:
        raise InputError(_expected(text, unit)) from None


def _converted(number: float, given: str, text: str, unit: Unit) -> float:
    if unit.only and given not in unit.only:
        raise InputError(_expected(text, unit))
    registry = _registry()
    try:
        if len(given) > _MAX_UNIT_LENGTH or _TOWER.search(given):
            raise ValueError
        # Only a temperature is affine; in W/(m^2 degC) the degree is a difference.
        parsed = registry.parse_units(given, as_delta=unit is not TEMPERATURE)
    except Exception as error:  # pint's parser raises many unrelated types
        raise InputError(
            f"{_expected(text, unit)} (unknown unit {quoted(given)})"
        ) from error
    try:
        quantity = registry.Quantity(number, parsed)
        # For pint W/sr and W are one: 4 pi apart, they must not be mixed up.
        if _steradians(quantity) != _steradians(registry.Quantity(1, unit.symbol)):
            raise ValueError
        return float(quantity.to(unit.symbol).magnitude)
    except (pint.PintError, ArithmeticError, ValueError) as error:
        hints = {"C": " (degrees Celsius are 'degC')", "F": " (write 'degF')"}
        hint = hints.get(given, "") if unit is TEMPERATURE else ""
        raise InputError(_expected(text, unit) + hint) from error


def _steradians(quantity: Any) -> Any:
    """Power of the steradian in a unit."""
    return dict(quantity.unit_items()).get("steradian", 0)


@cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(cache_folder=None)


@runtime_checkable
class Info(Protocol):
    """The context of a validation; pydantic's own protocol is not checkable."""

    @property
    def context(self) -> Any:
        """The argument `context` of `model_validate`."""


def refuse(message: str) -> PydanticCustomError:
    """The error for one value; pydantic adds its location."""
    return PydanticCustomError(MISTAKE, "{message}", {"message": message})


def _plausible(value: float, info: Info) -> float:
    if value < 0.0:
        raise refuse(f"{value:g} K is below absolute zero (a bare number is in kelvin)")
    if value < _COLDEST and not (info.context or {}).get(ALLOW_EXTREME, False):
        raise refuse(
            f"{value:g} K is below {_COLDEST:g} K (a bare number is in kelvin: for "
            f"degrees Celsius write '{value:g} degC'); if it is meant, set "
            f"`{ALLOW_EXTREME}: true`"
        )
    return value


@dataclass(frozen=True)
class NoneWord:
    """Marks a field in which a word stands for None."""

    word: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        read = lambda value: None if value == self.word else value
        return core_schema.no_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"const": self.word}]}


Auto = NoneWord("auto")
"""Marks a value that is chosen from the scene where "auto" or nothing is given."""


def _not_empty(value: Any) -> Any:
    if isinstance(value, list) and not value:
        raise refuse("must not be empty")
    return value


# Field(min_length=1) would also count entries out that are wrong by themselves.
NotEmpty = BeforeValidator(_not_empty)
"""Marks a list that needs an entry."""


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise refuse(f"expected three numbers [x, y, z], got {quoted(value)}")
    return value


def _two(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refuse(f"expected two values, got {quoted(value)}")
    return value


def _not_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*value) == 0.0:
        raise refuse("must not be [0, 0, 0]: it has to point somewhere")
    return value


Three = BeforeValidator(_three)
Number = Annotated[float, NUMBER]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Length = Annotated[float, LENGTH]
PositiveLength = Annotated[Length, Field(gt=0)]
Time = Annotated[float, TIME]
PositiveTime = Annotated[Time, Field(gt=0)]
Temperature = Annotated[float, TEMPERATURE, AfterValidator(_plausible)]
Angle = Annotated[float, ANGLE]
Irradiance = Annotated[float, IRRADIANCE, Field(ge=0)]
HeatFlux = Annotated[float, HEAT_FLUX]
HeatTransferCoefficient = Annotated[float, HEAT_TRANSFER_COEFFICIENT, Field(ge=0)]
ContactConductance = Annotated[float, CONTACT_CONDUCTANCE, Field(ge=0)]
HeatRateDensity = Annotated[float, HEAT_RATE_DENSITY]
RadiantIntensity = Annotated[float, RADIANT_INTENSITY, Field(ge=0)]
Radiance = Annotated[float, RADIANCE, Field(ge=0)]
Speed = Annotated[float, SPEED, Field(ge=0)]
Conductivity = Annotated[float, CONDUCTIVITY, Field(gt=0)]
Density = Annotated[float, DENSITY, Field(gt=0)]
SpecificHeat = Annotated[float, SPECIFIC_HEAT, Field(gt=0)]
Flag = Annotated[bool, Strict()]
Whole = Annotated[int, Strict()]
Index = Annotated[Whole, Field(ge=0)]
"""Number of a body, counted from 0."""
Position = Annotated[tuple[Length, Length, Length], Three]
Size = Annotated[tuple[PositiveLength, PositiveLength, PositiveLength], Three]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero), Three]
_Component = Annotated[float, SPEED]
Velocity = Annotated[tuple[_Component, _Component, _Component], Three]
Extent = Annotated[tuple[PositiveLength, PositiveLength], BeforeValidator(_two)]
Indices = Annotated[tuple[Index, Index], BeforeValidator(_two)]
