"""Terms, receipts and summaries of runs as plain values, as a file stores them.

Numbers are stored as they are, tables with all their points, and other functions of
time by their values at given times.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from ...errors import InputError, shortened
from ...physics.boundary import Convection
from ...physics.radiation.area_source import AreaSource
from ...physics.radiation.diffuse_sky import DiffuseSky
from ...physics.radiation.emission import Surroundings
from ...physics.radiation.source import AbstractSource, PointSource, Sun
from ...physics.radiation.source_motion import DirectionTable, PointTable
from ...physics.time_varying import Table, Until, value_at
from ...scene.receipt_model import Omission, Part, Receipt
from ..solver_statistics import SolverStatistics
from .run_summary import RunSummary


_CLASS = "class"
_STORED = {
    stored.__name__: stored
    for stored in (
        Sun,
        PointSource,
        AreaSource,
        DiffuseSky,
        Surroundings,
        Convection,
        Table,
        Until,
        PointTable,
        DirectionTable,
        Receipt,
        Part,
        Omission,
        RunSummary,
        SolverStatistics,
    )
}


def plain_value(value: Any, times: Sequence[Any] = ()) -> Any:
    """A value as plain ones; functions of time by their values at times [s]."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, tuple | list):
        return [plain_value(entry, times) for entry in value]
    if is_dataclass(value) and type(value).__name__ in _STORED:
        if isinstance(value, AbstractSource):
            value = _with_table(value, times)
        plain = {
            field.name: plain_value(getattr(value, field.name), times)
            for field in fields(value)
        }
        return {_CLASS: type(value).__name__, **plain}
    if callable(value):
        return plain_value(_sampled(value, times), times)
    return np.asarray(value).tolist()


def _sampled(value: Callable, times: Sequence[Any]) -> Table:
    values = [float(value_at(value, time)) for time in times]
    return Table([float(time) for time in times], values)


def _with_table(source: AbstractSource, times: Sequence[Any]) -> AbstractSource:
    """The source with a table where its position or direction is another function."""
    field = source.location_field
    location = getattr(source, field)
    if not source.moves or isinstance(location, PointTable | DirectionTable):
        return source
    saved = [float(time) for time in times]
    table = DirectionTable if isinstance(source, Sun) else PointTable
    return replace(source, **{field: table(saved, [location(time) for time in saved])})


def built_value(plain: Any, name: str) -> Any:
    """A value from its plain ones; `name` is that of the array, for messages.

    Raises:
        InputError: for values that belong to no class.
    """
    if isinstance(plain, list):
        return tuple(built_value(entry, name) for entry in plain)
    if not isinstance(plain, dict):
        return plain
    values = {
        key: built_value(value, name) for key, value in plain.items() if key != _CLASS
    }
    try:
        return _STORED[plain[_CLASS]](**values)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{name} has {shortened(plain)}, which fits no class"
        ) from error
