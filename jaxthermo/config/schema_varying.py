"""Values that vary: a number, or a table of it by time or by temperature."""

import math
from itertools import pairwise
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import Discriminator, Tag

from .fields import (
    Conductivity,
    ContactConductance,
    Direction,
    HeatFlux,
    HeatRateDensity,
    HeatTransferCoefficient,
    Irradiance,
    NotEmpty,
    Position,
    Radiance,
    RadiantIntensity,
    SpecificHeat,
    Speed,
    Temperature,
    Three,
    Time,
)
from .model import Mistake, Model


Value = TypeVar("Value")


class Table(Model, Generic[Value]):
    """A piecewise linear function of time [s]."""

    times: Annotated[tuple[Time, ...], NotEmpty]
    values: tuple[Value, ...]

    def mistakes(self) -> list[Mistake]:
        """Times that do not increase; lengths that differ."""
        found = not_increasing(self.times, "times", "s")
        return [*found, *unequal(self.values, "values", self.times, "times")]


class DirectionTable(Table[Direction]):
    """A direction that turns in time."""

    def mistakes(self) -> list[Mistake]:
        """Directions between which there is no one way to turn."""
        unit = [[x / math.hypot(*v) for x in v] for v in self.values]
        opposite: list[Mistake] = [
            (("values", i), "is opposite to the one before: give one between them")
            for i, (a, b) in enumerate(pairwise(unit), 1)
            if math.hypot(*(x + y for x, y in zip(a, b, strict=True))) < 1e-6
        ]
        return [*super().mistakes(), *opposite]


class PropertyTable(Model, Generic[Value]):
    """A piecewise linear function of temperature [K]."""

    temperatures: Annotated[tuple[Temperature, ...], NotEmpty]
    values: tuple[Value, ...]

    def mistakes(self) -> list[Mistake]:
        """Temperatures that do not increase; lengths that differ."""
        kelvin, key = self.temperatures, "temperatures"
        found = not_increasing(kelvin, key, "K")
        return [*found, *unequal(self.values, "values", kelvin, key)]


def not_increasing(values: tuple[float, ...], key: str, unit: str) -> list[Mistake]:
    """One mistake for each value that is not above the one before it."""
    return [
        ((key, i), f"{b:g} {unit} is not after {a:g} {unit}: give them in order")
        for i, (a, b) in enumerate(pairwise(values), 1)
        if b <= a
    ]


def unequal(values: tuple, key: str, places: tuple, other: str) -> list[Mistake]:
    """A mistake if there are not as many values as places for them."""
    if len(values) == len(places):
        return []
    return [((key,), f"there are {len(values)} {key} for {len(places)} {other}")]


def _fixed_or_table(value: Any) -> str:
    return "<table>" if isinstance(value, dict | Model) else "<fixed>"


def _or_bonded(value: Any) -> str:
    return "<bonded>" if value == "bonded" else _fixed_or_table(value)


def _or_three(value: Any) -> str:
    return "<three>" if isinstance(value, list | tuple) else _fixed_or_table(value)


_FIXED = Tag("<fixed>")
_TABLE = Tag("<table>")
_EITHER = Discriminator(_fixed_or_table)

TimeTemperature = Annotated[
    Annotated[Temperature, _FIXED] | Annotated[Table[Temperature], _TABLE], _EITHER
]
TimeIrradiance = Annotated[
    Annotated[Irradiance, _FIXED] | Annotated[Table[Irradiance], _TABLE], _EITHER
]
TimeIntensity = Annotated[
    Annotated[RadiantIntensity, _FIXED] | Annotated[Table[RadiantIntensity], _TABLE],
    _EITHER,
]
TimeRadiance = Annotated[
    Annotated[Radiance, _FIXED] | Annotated[Table[Radiance], _TABLE], _EITHER
]
TimeHeatFlux = Annotated[
    Annotated[HeatFlux, _FIXED] | Annotated[Table[HeatFlux], _TABLE], _EITHER
]
TimeCoefficient = Annotated[
    Annotated[HeatTransferCoefficient, _FIXED]
    | Annotated[Table[HeatTransferCoefficient], _TABLE],
    _EITHER,
]
TimeDensity = Annotated[
    Annotated[HeatRateDensity, _FIXED] | Annotated[Table[HeatRateDensity], _TABLE],
    _EITHER,
]
TimeSpeed = Annotated[
    Annotated[Speed, _FIXED] | Annotated[Table[Speed], _TABLE], _EITHER
]
TimePosition = Annotated[
    Annotated[Position, _FIXED] | Annotated[Table[Position], _TABLE], _EITHER
]
TimeDirection = Annotated[
    Annotated[Direction, _FIXED] | Annotated[DirectionTable, _TABLE], _EITHER
]
TimeConductance = Annotated[
    Annotated[ContactConductance, _FIXED]
    | Annotated[Literal["bonded"], Tag("<bonded>")]
    | Annotated[Table[ContactConductance], _TABLE],
    Discriminator(_or_bonded),
]
AnyConductivity = Annotated[
    Annotated[Conductivity, _FIXED]
    | Annotated[tuple[Conductivity, Conductivity, Conductivity], Three, Tag("<three>")]
    | Annotated[PropertyTable[Conductivity], _TABLE],
    Discriminator(_or_three),
]
AnySpecificHeat = Annotated[
    Annotated[SpecificHeat, _FIXED] | Annotated[PropertyTable[SpecificHeat], _TABLE],
    _EITHER,
]
