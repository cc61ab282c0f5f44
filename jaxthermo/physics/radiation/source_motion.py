"""Motion of sources: positions and directions at given times.

The tables are constant before the first and after the last time.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...arrays import Numbers, Points
from ...errors import InputError
from ...geometry.vectors import triple, unit_vector


Triple = tuple[float, float, float]


# Unit vectors with a shorter sum count as opposite: no unique arc connects them.
_OPPOSITE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class PointTable:
    """Points at given times, joined by straight lines at constant speeds.

    Raises:
        InputError: unless the times increase and each has a finite point.
    """

    times: Numbers
    """Times [s], increasing."""
    points: Points
    """World positions [m], one for each time."""

    def __post_init__(self):
        _make_plain(self, "points")

    def __call__(self, time: float) -> Triple:
        """Point at `time` [s]."""
        interval = _interval(self.times, self.points, time)
        t = interval.fraction
        return triple((1 - t) * interval.first + t * interval.second)


@dataclass(frozen=True)
class DirectionTable:
    """Directions at given times, joined by the shorter arcs at constant rates.

    Raises:
        InputError: unless the times increase and each has a direction that is not
            opposite to the previous one.
    """

    times: Numbers
    """Times [s], increasing."""
    directions: Points
    """Directions of any length, one for each time."""
    snapshots: Numbers | None = None
    """Times at which shadows are recomputed [s]; None for 64 equidistant ones."""

    def __post_init__(self):
        _make_plain(self, "directions")
        if self.snapshots is not None:
            plain = tuple(np.asarray(self.snapshots, float).reshape(-1).tolist())
            if not np.isfinite(plain).all():
                raise InputError("DirectionTable(snapshots=): give finite times")
            object.__setattr__(self, "snapshots", plain)
        units = [unit_vector(d, "DirectionTable(directions=)") for d in self.directions]
        for i, (a, b) in enumerate(pairwise(units), 1):
            if np.linalg.norm(a + b) < _OPPOSITE_TOLERANCE:
                raise InputError(
                    f"DirectionTable: direction {i} is opposite to the one before; "
                    "give one between them"
                )

    def __call__(self, time: float) -> Triple:
        """Unit vector at `time` [s]."""
        interval = _interval(self.times, self.directions, time)
        first = unit_vector(interval.first)
        second = unit_vector(interval.second)
        t = interval.fraction
        across = float(np.linalg.norm(np.cross(first, second)))
        angle = math.atan2(across, float(first @ second))
        if angle == 0:
            return triple(first)
        # Spherical interpolation: the angular velocity is constant.
        turned = math.sin((1 - t) * angle) * first
        return triple(unit_vector(turned + math.sin(t * angle) * second))


class _Interval(NamedTuple):
    """Rows of a table at both ends of the interval around a time."""

    first: Float[np.ndarray, "3"]
    second: Float[np.ndarray, "3"]
    fraction: float
    """Fraction of the interval that has passed [-]."""


def _interval(times: Any, rows: Any, time: float) -> _Interval:
    last = len(times) - 1
    position = float(np.interp(time, times, np.arange(last + 1.0)))
    index = int(position)
    return _Interval(
        first=np.asarray(rows[index]),
        second=np.asarray(rows[min(index + 1, last)]),
        fraction=position - index,
    )


def _make_plain(table: Any, field: str) -> None:
    """Convert the fields to tuples, which can be compared and hashed."""
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
