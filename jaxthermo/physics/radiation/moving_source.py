"""Where a source that travels stands: points and directions by a table of times.

For the `position`, `centre` or `direction` of a source, which takes any function of
time. Before the first and after the last time the source stands still.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...errors import InputError
from ...raster.directions import unit_vector
from .source import Triple, triple


OPPOSITE = 1e-6
"""Directions whose sum is shorter are opposite: there is no one way between them."""


@dataclass(frozen=True)
class PointTable:
    """Points at times, with straight lines between them at constant speeds.

    Raises:
        InputError: unless times increase and there is a finite point for each.
    """

    times: Any
    """[s]"""
    points: Any
    """World [m]."""

    def __post_init__(self):
        _make_plain(self, "points")

    def __call__(self, time: float) -> Triple:
        """The point at `time` [s]."""
        first, second, share = _between(self.times, self.points, time)
        return triple((1 - share) * first + share * second)


@dataclass(frozen=True)
class DirectionTable:
    """Directions at times, turned the short way between them at constant rates.

    Raises:
        InputError: unless times increase and there is a direction for each, none
            opposite to the one before.
    """

    times: Any
    """[s]"""
    directions: Any
    """Of any length."""

    def __post_init__(self):
        _make_plain(self, "directions")
        units = [unit_vector(d, "DirectionTable(directions=)") for d in self.directions]
        for i, (a, b) in enumerate(pairwise(units), 1):
            if np.linalg.norm(a + b) < OPPOSITE:
                raise InputError(
                    f"DirectionTable: direction {i} is opposite to the one before; "
                    "give one between them"
                )

    def __call__(self, time: float) -> Triple:
        """The direction at `time` [s], of length one."""
        *ends, share = _between(self.times, self.directions, time)
        first, second = (unit_vector(end) for end in ends)
        across = float(np.linalg.norm(np.cross(first, second)))
        angle = math.atan2(across, float(first @ second))
        if angle == 0:
            return triple(first)
        turned = math.sin((1 - share) * angle) * first
        return triple(unit_vector(turned + math.sin(share * angle) * second))


def _between(
    times: Any, rows: Any, time: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """The rows before and after `time` [s], and its share of the way between them."""
    last = len(times) - 1
    place = float(np.interp(time, times, np.arange(last + 1.0)))
    before = int(place)
    first, second = rows[before], rows[min(before + 1, last)]
    return np.asarray(first), np.asarray(second), place - before


def _make_plain(table: Any, field: str) -> None:
    """Tuples in place of what was given: they can be compared and hashed."""
    name = type(table).__name__
    try:
        times = np.asarray(table.times, float)
        rows = np.asarray(getattr(table, field), float)
    except (TypeError, ValueError):
        times = rows = np.zeros(0)
    if times.ndim != 1 or not len(times) or rows.shape != (len(times), 3):
        raise InputError(f"{name}: give times, and three numbers for each of them")
    if not (np.isfinite(times).all() and np.isfinite(rows).all()):
        raise InputError(f"{name}: give finite numbers")
    if (np.diff(times) <= 0).any():
        raise InputError(f"{name}: the times must increase")
    object.__setattr__(table, "times", tuple(times.tolist()))
    object.__setattr__(table, field, tuple(triple(row) for row in rows))
