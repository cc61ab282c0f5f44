"""Field types of the config models: each validates to a plain SI number."""

import math
from typing import Annotated, Any, Protocol, runtime_checkable

from pydantic import AfterValidator, BeforeValidator, Field, Strict
from pydantic_core import PydanticCustomError

from ..errors import InputError
from . import units
from .messages import MISTAKE
from .show import show
from .units import Dimension, to_si


ALLOW_EXTREME = "allow_extreme_temperatures"
_COLDEST = 150.0


@runtime_checkable
class Info(Protocol):
    """What pydantic hands to a validator; its own protocol is not checkable."""

    @property
    def context(self) -> Any:
        """As given to `model_validate`."""


def refuse(message: str) -> PydanticCustomError:
    """The error for one value; pydantic adds where it stands."""
    return PydanticCustomError(MISTAKE, "{message}", {"message": message})


def _quantity(dimension: Dimension) -> BeforeValidator:
    def read(value: Any) -> float:
        try:
            return to_si(value, dimension)
        except InputError as error:
            raise refuse(str(error)) from error

    return BeforeValidator(read)


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


Number = Annotated[float, _quantity(units.NUMBER)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Length = Annotated[float, _quantity(units.LENGTH)]
PositiveLength = Annotated[Length, Field(gt=0)]
Time = Annotated[float, _quantity(units.TIME)]
PositiveTime = Annotated[Time, Field(gt=0)]
Temperature = Annotated[float, _quantity(units.TEMPERATURE), AfterValidator(_plausible)]
Angle = Annotated[float, _quantity(units.ANGLE)]
Irradiance = Annotated[float, _quantity(units.IRRADIANCE), Field(ge=0)]
HeatFlux = Annotated[float, _quantity(units.HEAT_FLUX)]
HeatTransferCoefficient = Annotated[
    float, _quantity(units.HEAT_TRANSFER_COEFFICIENT), Field(ge=0)
]
ContactConductance = Annotated[float, _quantity(units.CONTACT_CONDUCTANCE), Field(ge=0)]
HeatRateDensity = Annotated[float, _quantity(units.HEAT_RATE_DENSITY)]
RadiantIntensity = Annotated[float, _quantity(units.RADIANT_INTENSITY), Field(ge=0)]
Radiance = Annotated[float, _quantity(units.RADIANCE), Field(ge=0)]
Speed = Annotated[float, _quantity(units.SPEED), Field(ge=0)]
Conductivity = Annotated[float, _quantity(units.CONDUCTIVITY), Field(gt=0)]
Density = Annotated[float, _quantity(units.DENSITY), Field(gt=0)]
SpecificHeat = Annotated[float, _quantity(units.SPECIFIC_HEAT), Field(gt=0)]
Flag = Annotated[bool, Strict()]
Whole = Annotated[int, Strict()]
Index = Annotated[Whole, Field(ge=0)]
"""Of a body, counted from 0."""


def _auto(value: Any) -> Any:
    return None if value == "auto" else value


Auto = BeforeValidator(_auto)
"""Marks a field in which "auto" stands for None: found from the scene."""


def _not_empty(value: Any) -> Any:
    if isinstance(value, list) and not value:
        raise refuse("must not be empty")
    return value


# Field(min_length=1) would also count entries out that are wrong by themselves.
NotEmpty = BeforeValidator(_not_empty)
"""Marks a list that needs an entry."""


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise refuse(f"expected three numbers [x, y, z], got {show(value)}")
    return value


def _two(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refuse(f"expected two values, got {show(value)}")
    return value


def _not_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*value) == 0.0:
        raise refuse("must not be [0, 0, 0]: it has to point somewhere")
    return value


Three = BeforeValidator(_three)
Position = Annotated[tuple[Length, Length, Length], Three]
Size = Annotated[tuple[PositiveLength, PositiveLength, PositiveLength], Three]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero), Three]
_Component = Annotated[float, _quantity(units.SPEED)]
Velocity = Annotated[tuple[_Component, _Component, _Component], Three]
Extent = Annotated[tuple[PositiveLength, PositiveLength], BeforeValidator(_two)]
Indices = Annotated[tuple[Index, Index], BeforeValidator(_two)]
