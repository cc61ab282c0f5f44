"""Terms of a scene as its camera sees them: sky, ground, air and sources.

A file stores them as plain values: numbers as they are, tables with all their points,
and other functions of time by their values at the saved times.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from ...errors import InputError, shortened
from ...physics.boundary import Convection
from ...physics.convection.free_convection import FreeConvection
from ...physics.convection.wind import Wind
from ...physics.radiation.area_source import AreaSource
from ...physics.radiation.diffuse_sky import DiffuseSky
from ...physics.radiation.emission import AbstractSurroundings, Surroundings
from ...physics.radiation.source import AbstractSource, PointSource, Sun
from ...physics.radiation.source_motion import DirectionTable, PointTable
from ...physics.term import AbstractTerm
from ...physics.time_varying import Table, Until, value_at


_CLASS = "class"
_SEEN = (Sun, PointSource, AreaSource, DiffuseSky)
_STORED = {
    stored.__name__: stored
    for stored in (
        *_SEEN,
        Surroundings,
        Convection,
        Table,
        Until,
        PointTable,
        DirectionTable,
    )
}


def seen_terms(terms: Sequence[AbstractTerm]) -> tuple[AbstractTerm, ...]:
    """The terms that a camera sees, with the values that it needs.

    Surroundings have their temperatures alone, and air is a convection without a
    coefficient. A source of another class, which a file cannot have, is a warning.
    """
    seen: list[AbstractTerm] = []
    for term in terms:
        match term:
            case AbstractSurroundings():
                seen.append(Surroundings(term.temperature, term.ground))
            case Convection() | Wind() | FreeConvection() if term.on is None:
                seen.append(Convection(0.0, term.temperature))
            case Sun() | PointSource() | AreaSource() | DiffuseSky():
                seen.append(replace(term, on=None))
            case AbstractSource():
                warnings.warn(
                    f"a file has no {type(term).__name__}: images of the stored run "
                    "are drawn without it",
                    stacklevel=2,
                )
    return tuple(seen)


def plain_terms(terms: Sequence[AbstractTerm], times: Sequence[Any]) -> list[Any]:
    """Terms of `seen_terms` as plain values; functions by their values at times [s]."""
    return [_plain(term, times) for term in terms]


def _plain(value: Any, times: Sequence[Any]) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, tuple | list):
        return [_plain(entry, times) for entry in value]
    if is_dataclass(value) and type(value).__name__ in _STORED:
        if isinstance(value, AbstractSource):
            value = _with_table(value, times)
        plain = {f.name: _plain(getattr(value, f.name), times) for f in fields(value)}
        return {_CLASS: type(value).__name__, **plain}
    if callable(value):
        return _plain(_sampled(value, times), times)
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


def stored_terms(plain: Any) -> tuple[AbstractTerm, ...]:
    """The terms from their plain values.

    Raises:
        InputError: if they are none.
    """
    if not isinstance(plain, list):
        raise InputError("terms is not a list")
    terms = tuple(_built(entry) for entry in plain)
    if not all(isinstance(term, AbstractTerm) for term in terms):
        raise InputError("terms has an entry that is no term")
    return terms


def _built(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(_built(entry) for entry in plain)
    if not isinstance(plain, dict):
        return plain
    built = {name: _built(value) for name, value in plain.items() if name != _CLASS}
    try:
        return _STORED[plain[_CLASS]](**built)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"terms has {shortened(plain)}, which is no term") from error
