"""Values that vary in time, and the times at which a run ends and saves."""

from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Tag

from .fields import (
    HeatFlux,
    HeatTransferCoefficient,
    Irradiance,
    NotEmpty,
    PositiveTime,
    Temperature,
    Time,
)
from .model import Mistake, Model


_MOST_SAVES = 100_000


class Table(Model):
    """A piecewise linear function of time [s]."""

    times: Annotated[tuple[Time, ...], NotEmpty]
    values: tuple[float, ...]

    def mistakes(self) -> list[Mistake]:
        """Times that do not increase; lengths that differ."""
        found = not_increasing(self.times, "times")
        if len(self.times) != len(self.values):
            lengths = f"{len(self.values)} values for {len(self.times)} times"
            found.append((("values",), f"there are {lengths}"))
        return found


class TemperatureTable(Table):
    """A temperature [K] that varies in time."""

    values: tuple[Temperature, ...]


class IrradianceTable(Table):
    """An irradiance [W/m^2] that varies in time."""

    values: tuple[Irradiance, ...]


class HeatFluxTable(Table):
    """A heat flux [W/m^2] that varies in time."""

    values: tuple[HeatFlux, ...]


class CoefficientTable(Table):
    """A heat transfer coefficient [W/(m^2 K)] that varies in time."""

    values: tuple[HeatTransferCoefficient, ...]


def _number_or_table(value: Any) -> str:
    return "<table>" if isinstance(value, dict | Table) else "<number>"


_NUMBER = Tag("<number>")
_TABLE = Tag("<table>")
_EITHER = Discriminator(_number_or_table)
TimeTemperature = Annotated[
    Annotated[Temperature, _NUMBER] | Annotated[TemperatureTable, _TABLE], _EITHER
]
TimeIrradiance = Annotated[
    Annotated[Irradiance, _NUMBER] | Annotated[IrradianceTable, _TABLE], _EITHER
]
TimeHeatFlux = Annotated[
    Annotated[HeatFlux, _NUMBER] | Annotated[HeatFluxTable, _TABLE], _EITHER
]
TimeCoefficient = Annotated[
    Annotated[HeatTransferCoefficient, _NUMBER] | Annotated[CoefficientTable, _TABLE],
    _EITHER,
]


class TimeConfig(Model):
    """When the run ends, and at which times its state is kept."""

    end: PositiveTime
    save_at: Annotated[tuple[PositiveTime, ...], NotEmpty] | None = None
    save_every: PositiveTime | None = None

    exactly_one: ClassVar = (("save_at", "save_every"),)

    def mistakes(self) -> list[Mistake]:
        """Saved times that do not increase, or lie after the end."""
        found = not_increasing(self.save_at or (), "save_at")
        for i, time in enumerate(self.save_at or ()):
            if time > self.end:
                message = f"{time:g} s is after the end, {self.end:g} s"
                found.append((("save_at", i), message))
        if self.save_every is not None:
            if self.save_every > self.end:
                message = f"{self.save_every:g} s is after the end, {self.end:g} s"
                found.append((("save_every",), message))
            if self.end / self.save_every > _MOST_SAVES:
                message = f"would save more than {_MOST_SAVES} times"
                found.append((("save_every",), message))
        return found

    @property
    def save_times(self) -> tuple[float, ...]:
        """The times at which the state is kept [s]; the end is one of `save_every`."""
        if self.save_every is None:
            return self.save_at or ()
        whole = round(self.end / self.save_every * (1.0 - 1e-9) - 0.5)
        return (*(self.save_every * (i + 1) for i in range(whole)), self.end)


def not_increasing(times: tuple[float, ...], key: str) -> list[Mistake]:
    """One mistake for each time that is not after the one before it."""
    return [
        ((key, i), f"{times[i]:g} s is not after {times[i - 1]:g} s: times increase")
        for i in range(1, len(times))
        if times[i] <= times[i - 1]
    ]
