"""Weather over time: named columns of numbers, which may have holes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, tzinfo
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .sun_position import Place


class Column(NamedTuple):
    """One quantity at increasing times."""

    times: Float[np.ndarray, " t"]
    """Times since 1970-01-01 UTC [s]; for a mean, the middle of its interval."""
    values: Float[np.ndarray, " t"]
    """Values in SI units; NaN where there is no value."""
    name: str
    """Name in the file."""
    limits: str = ""
    """Valid range in words, in the unit of the file."""


class Remark(NamedTuple):
    """A change that a reader made, or a doubt, which concerns some of the time."""

    start: float
    """Start since 1970-01-01 UTC [s]."""
    end: float
    """End since 1970-01-01 UTC [s]."""
    text: str


@final
@dataclass(frozen=True)
class Weather:
    """Weather at a place.

    Columns are `air` and `dew_point` [K], `direct_normal`, `diffuse` (horizontal) and
    `infrared` (from the sky, horizontal) [W/m^2], `wind_speed` [m/s],
    `wind_direction`, from which it blows [rad from north towards east],
    `cloud_cover`, the fraction of the sky [-], and `longwave ...`, from sky and ground
    on surfaces of a plane of that name [W/m^2].
    """

    source: str
    """Name for messages, such as the path of its file."""
    covers: tuple[float, float]
    """Start and end, since 1970-01-01 UTC [s]."""
    columns: Mapping[str, Column]
    zone: tzinfo = UTC
    """Zone of the times in messages."""
    longest_gap: float = math.inf
    """A longer interval between rows is a hole [s]."""
    place: Place | None = None
    """Place of the measurements, if the file states it."""
    remarks: tuple[Remark, ...] = ()
    """Changes and doubts of its reader."""

    def has(self, name: str) -> bool:
        """True if there is a column with at least one value."""
        column = self.columns.get(name)
        return column is not None and bool(np.isfinite(column.values).any())

    def within(self, name: str, start: float, end: float) -> Column:
        """The part of a column from `start` to `end` [s], both included.

        Raises:
            InputError: for a column that is missing or has holes there.
        """
        if name not in self.columns:
            raise InputError(
                f"{self.source}: there is no {name.replace('_', ' ')}; the weather has "
                f"{', '.join(self.columns)}"
            )
        column = self.columns[name]
        times = column.times
        values = column.values
        first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
        last = min(int(np.searchsorted(times, end)), len(times) - 1)
        rows = slice(first, last + 1)
        times = times[rows]
        values = values[rows]
        self._check_holes(column, times=times, values=values)
        inside = times[(times > start) & (times < end)]
        with_ends = np.unique(np.concatenate([[start], inside, [end]]))
        return column._replace(
            times=with_ends, values=np.interp(with_ends, times, values)
        )

    def remarks_within(self, start: float, end: float) -> list[str]:
        """Remarks of its reader on the time from `start` to `end` [s]."""
        texts = [
            remark.text
            for remark in self.remarks
            if remark.start < end and start < remark.end
        ]
        return [f"{self.source}: {text}" for text in texts]

    def check_covers(self, start: float, end: float) -> None:
        """Refuse a run that is not within the time of the weather.

        Raises:
            InputError: with the times of both.
        """
        first, last = self.covers
        if first <= start and end <= last:
            return
        stamp = self.stamp
        raise InputError(
            f"{self.source}: covers {stamp(first)} to {stamp(last)}, and the scene "
            f"runs from {stamp(start)} to {stamp(end)}: give another start, or a "
            "shorter run"
        )

    def stamp(self, seconds: float) -> str:
        """A time since 1970-01-01 UTC [s] as date and time in the zone."""
        moment = datetime.fromtimestamp(round(seconds), self.zone)
        return moment.isoformat(timespec="minutes")

    def _check_holes(
        self,
        column: Column,
        times: Float[np.ndarray, " t"],
        values: Float[np.ndarray, " t"],
    ) -> None:
        holes = np.flatnonzero(~np.isfinite(values))
        if len(holes):
            first = self.stamp(float(times[holes[0]]))
            others_note = f" (and {len(holes) - 1} more)" if len(holes) > 1 else ""
            limits = f" {column.limits}" if column.limits else ""
            raise InputError(
                f"{self.source}: column '{column.name}' has no value{limits} at {first}"
                f"{others_note}: fill it in, or give another start"
            )
        gaps = np.flatnonzero(np.diff(times) > self.longest_gap)
        if len(gaps):
            first = self.stamp(float(times[gaps[0]]))
            last = self.stamp(float(times[gaps[0] + 1]))
            raise InputError(
                f"{self.source}: column '{column.name}' has no rows between {first} "
                f"and {last}: fill them in, or give another start"
            )


def with_directions(weather: Weather) -> Weather:
    """The weather with directions of the wind that may be interpolated.

    A calm has no direction, and files have any number for it: it gets that of the wind
    around it. Between 350 and 10 degrees lies 0.
    """
    direction = weather.columns["wind_direction"]
    speed = weather.columns["wind_speed"].values
    blows = np.isfinite(direction.values) & (speed != 0)
    values = np.where(speed == 0, 0.0, np.nan)
    if blows.any():
        turned = np.unwrap(direction.values[blows])
        around = np.interp(direction.times, direction.times[blows], turned)
        values = np.where(blows | (speed == 0), around, np.nan)
    columns = {
        **weather.columns,
        "wind_direction": direction._replace(values=values),
    }
    return replace(weather, columns=columns)
