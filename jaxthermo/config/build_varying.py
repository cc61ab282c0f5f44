"""From a validated config to values that vary: by time, or by temperature."""

from typing import Any

from ..material.property import Property
from ..physics.radiation.moving_source import DirectionTable, PointTable
from ..physics.time_varying import Table, Until
from . import schema_varying as schema


def build_value(value: Any, until: float | None = None) -> Any:
    """A number as it is, a table as a function of time; switched off at `until`."""
    tabled = isinstance(value, schema.Table)
    built = Table(value.times, value.values) if tabled else value
    return built if until is None else Until(built, until)


def build_position(value: Any) -> Any:
    """A point as it is, a table of them as a function of time."""
    tabled = isinstance(value, schema.Table)
    return PointTable(value.times, value.values) if tabled else value


def build_direction(value: Any) -> Any:
    """A direction as it is, a table of them as a function of time."""
    tabled = isinstance(value, schema.Table)
    return DirectionTable(value.times, value.values) if tabled else value


def build_property(value: Any) -> Any:
    """Numbers as they are, a table as a property of temperature."""
    tabled = isinstance(value, schema.PropertyTable)
    return Property(value.temperatures, value.values) if tabled else value
