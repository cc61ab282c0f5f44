"""Quantities: field types that validate to plain SI numbers, "2 mm" to 0.002.

A field says its unit where it is declared, `Annotated[float, LENGTH]`: validation,
messages, JSON Schemas and the units of fitted parameters all read it there.
"""

import importlib
import math
import re
import sys
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
    Tag,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ...constants import MIN_TEMPERATURE, ZERO_CELSIUS
from ...errors import InputError
from ...temperatures import ALLOW_EXTREME, CELSIUS_NAMES, KELVIN_NAMES, extreme_fault
from ..messages import MISTAKE, quoted


_NUMBER = re.compile(r"\s*([-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(.*)", re.S)
_JSON_LIMITS = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
}
# Common units and their factors, by SI unit. All other units are read by pint.
_FACTORS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "s": {"s": 1.0, "min": 60.0, "h": 3600.0},
    "K": dict.fromkeys(KELVIN_NAMES, 1.0),
    "m/s": {"m/s": 1.0},
    "m^3": {"m^3": 1.0},
    "1/s": {"1/s": 1.0, "1/h": 1 / 3600},
    "deg": {"deg": 1.0},
    "W/m^2": {"W/m^2": 1.0, "kW/m^2": 1000.0},
    "W/(m^2 K)": {"W/(m^2 K)": 1.0, "kW/(m^2 K)": 1000.0},
    "W/(m K)": {"W/(m K)": 1.0},
    "kg/m^3": {"kg/m^3": 1.0},
    "J/(kg K)": {"J/(kg K)": 1.0},
}


@dataclass(frozen=True)
class Unit:
    """The SI unit of a field, and the words with which a message asks for it."""

    symbol: str
    noun: str
    example: str
    only: tuple[str, ...] = ()
    """Allowed units (all if empty): pint cannot tell an angle from a plain ratio."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner = handler(source)
        return core_schema.no_info_before_validator_function(self._read, inner)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
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
TEMPERATURE_DIFFERENCE = Unit("K", "a temperature difference", "50 mK")
HEAT_FLUX = Unit("W/m^2", "a heat flux", "1 kW/m^2")
HEAT_TRANSFER_COEFFICIENT = Unit(
    "W/(m^2 K)", "a heat transfer coefficient", "10 W/(m^2 K)"
)
_CONTACT_CONDUCTANCE = Unit(
    "W/(m^2 K)", "a contact conductance ('bonded' for no resistance)", "1000 W/(m^2 K)"
)
_SPEED = Unit("m/s", "a speed", "3 m/s")
_ANGLES = ("deg", "degree", "degrees", "°", "rad", "radian", "radians", "mrad", "turn")
ANGLE = Unit("rad", "an angle", "30 deg", only=_ANGLES)
NUMBER = Unit("", "a number", "0.9", only=("%", "percent"))


def to_si(value: Any, unit: Unit) -> float:
    """The value in SI units; a bare number is taken as SI already.

    Args:
        value: a number, a number in a string, or a string such as "2 mm".
        unit: SI unit of the result.

    Raises:
        InputError: if the value is no finite number of that dimension.
    """
    if isinstance(value, str):
        number, unit_text = _split(value, unit)
        if unit_text:
            number = _converted(number, unit_text=unit_text, text=value, unit=unit)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        # A whole number beyond the range of floats is not finite either.
        number = float(value) if abs(value) <= sys.float_info.max else math.inf
    else:
        raise InputError(_expected(value, unit))
    if not math.isfinite(number):
        raise InputError(f"must be finite, got {quoted(value)}")
    return number


def _expected(value: Any, unit: Unit) -> str:
    return f"expected {unit.noun} such as '{unit.example}', got {quoted(value)}"


def _split(text: str, unit: Unit) -> tuple[float, str]:
    match = _NUMBER.fullmatch(text)
    if match is not None:
        return float(match[1]), match[2].strip()
    try:
        return float(text), ""
    except ValueError:
        raise InputError(_expected(text, unit)) from None


def _converted(number: float, unit_text: str, text: str, unit: Unit) -> float:
    if unit.only and unit_text not in unit.only:
        raise InputError(_expected(text, unit))
    factor = _FACTORS.get(unit.symbol, {}).get(unit_text)
    if factor is not None:
        return number * factor
    if unit.symbol == "K" and unit_text in CELSIUS_NAMES:
        return number + (ZERO_CELSIUS if unit is TEMPERATURE else 0.0)
    # By name: pint is slow to import, and few configs need it.
    pint_units = importlib.import_module("jaxthermo.config.types.pint_units")
    try:
        # Only a temperature is affine; in W/(m^2 degC) the degree is a difference.
        return pint_units.converted(
            number, unit_text=unit_text, symbol=unit.symbol, affine=unit is TEMPERATURE
        )
    except pint_units.UnknownUnitError as error:
        raise InputError(
            f"{_expected(text, unit)} (unknown unit {quoted(unit_text)})"
        ) from error
    except InputError as error:
        hints = {"C": " (degrees Celsius are 'degC')", "F": " (write 'degF')"}
        hint = hints.get(unit_text, "") if unit is TEMPERATURE else ""
        raise InputError(_expected(text, unit) + hint) from error


# Pydantic's own protocol cannot be checked at run time.
@runtime_checkable
class Info(Protocol):
    """The context of a validation."""

    @property
    def context(self) -> Any:
        """The argument `context` of `model_validate`."""


def refuse(message: str) -> PydanticCustomError:
    """The error for one value; pydantic adds its location."""
    return PydanticCustomError(MISTAKE, "{message}", {"message": message})


def _plausible(value: float, info: Info) -> float:
    if value < 0.0:
        raise refuse(f"{value:g} K is below absolute zero (a bare number is in kelvin)")
    if (info.context or {}).get(ALLOW_EXTREME, False):
        return value
    mistake = extreme_mistake(value)
    if mistake:
        raise refuse(mistake)
    return value


def extreme_mistake(kelvin: float) -> str:
    """The message for a temperature [K] outside of the limits; empty for others."""
    fault = extreme_fault(kelvin)
    if not fault:
        return ""
    hint = ""
    if kelvin < MIN_TEMPERATURE:
        hint = (
            f" (a bare number is in kelvin: for degrees Celsius write '{kelvin:g} "
            "degC')"
        )
    return f"{fault}{hint}; if it is meant, set `{ALLOW_EXTREME}: true`"


@dataclass(frozen=True)
class NoneWord:
    """Marks a field in which a word stands for None."""

    word: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def read(value: object) -> object:
            return None if value == self.word else value

        return core_schema.no_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {"anyOf": [handler(schema), {"const": self.word}]}


def word_or_temperature(*words: str) -> Discriminator:
    """Marker of a field that is one of some words, or a temperature."""

    def tag(value: Any) -> str:
        return "<word>" if value in words else "<temperature>"

    return Discriminator(tag)


# Marks a value that is chosen from the scene if it is "auto" or missing.
Auto = NoneWord("auto")


def _not_empty(value: Any) -> Any:
    if isinstance(value, list | dict) and not value:
        raise refuse("must not be empty")
    return value


# Marks a list that needs an entry: Field(min_length=1) would not count invalid ones.
NotEmpty = BeforeValidator(_not_empty)


def of_length(length: int, expected: str) -> BeforeValidator:
    """Marker of a list with `length` entries, which `expected` describes in words."""

    # Pydantic would report missing and surplus entries one by one.
    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise refuse(f"expected {expected}, got {quoted(value)}")
        return value

    return BeforeValidator(check)


def _not_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*value) == 0.0:
        raise refuse("must not be [0, 0, 0]: it has to point somewhere")
    return value


Three = of_length(3, "three numbers [x, y, z]")
Two = of_length(2, "two values")
Number = Annotated[float, NUMBER]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Length = Annotated[float, LENGTH]
PositiveLength = Annotated[Length, Field(gt=0)]
PositiveVolume = Annotated[float, Unit("m^3", "a volume", "3 m^3"), Field(gt=0)]
AirExchange = Annotated[float, Unit("1/s", "an air exchange", "2 1/h"), Field(ge=0)]
Time = Annotated[float, TIME]
PositiveTime = Annotated[Time, Field(gt=0)]
Temperature = Annotated[float, TEMPERATURE, AfterValidator(_plausible)]
StartTemperature = Annotated[
    Annotated[Literal["steady"], Tag("<word>")]
    | Annotated[Temperature, Tag("<temperature>")],
    word_or_temperature("steady"),
]
Angle = Annotated[float, ANGLE]
Irradiance = Annotated[float, Unit("W/m^2", "an irradiance", "800 W/m^2"), Field(ge=0)]
HeatFlux = Annotated[float, HEAT_FLUX]
HeatTransferCoefficient = Annotated[float, HEAT_TRANSFER_COEFFICIENT, Field(ge=0)]
ContactConductance = Annotated[float, _CONTACT_CONDUCTANCE, Field(ge=0)]
CoefficientBySpeed = Annotated[
    float,
    Unit("J/(m^3 K)", "a coefficient by speed", "3 J/(m^3 K)"),
    Field(ge=0),
]
HeatRate = Annotated[float, Unit("W", "a heat rate", "60 W")]
HeatRateDensity = Annotated[float, Unit("W/m^3", "a heat rate density", "5 kW/m^3")]
RadiantIntensity = Annotated[
    float, Unit("W/sr", "a radiant intensity", "20 W/sr"), Field(ge=0)
]
Radiance = Annotated[
    float, Unit("W/(m^2 sr)", "a radiance", "100 W/(m^2 sr)"), Field(ge=0)
]
Speed = Annotated[float, _SPEED, Field(ge=0)]
Conductivity = Annotated[
    float, Unit("W/(m K)", "a conductivity", "16 W/(m K)"), Field(gt=0)
]
Density = Annotated[float, Unit("kg/m^3", "a density", "8000 kg/m^3"), Field(gt=0)]
SpecificHeat = Annotated[
    float, Unit("J/(kg K)", "a specific heat", "500 J/(kg K)"), Field(gt=0)
]
Flag = Annotated[bool, Strict()]
Whole = Annotated[int, Strict()]
# Number of a body, counted from 0.
Index = Annotated[Whole, Field(ge=0)]
Position = Annotated[tuple[Length, Length, Length], Three]
PlanePosition = Annotated[tuple[Length, Length], Two]
Size = Annotated[tuple[PositiveLength, PositiveLength, PositiveLength], Three]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero), Three]
_Component = Annotated[float, _SPEED]
Velocity = Annotated[tuple[_Component, _Component, _Component], Three]
Extent = Annotated[tuple[PositiveLength, PositiveLength], Two]
Indices = Annotated[tuple[Index, Index], Two]
