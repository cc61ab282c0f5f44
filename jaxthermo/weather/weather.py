"""Weather over time: named columns of numbers, which may have holes."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo
from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Float

from ..errors import InputError


# A longer interval between rows is a hole, not a coarse series [s].
_MAX_GAP = 3 * 3600.0


class Column(NamedTuple):
    """One quantity at increasing times."""

    times: Float[np.ndarray, " t"]
    """Times since 1970-01-01 UTC [s]; for a mean, the middle of its interval."""
    values: Float[np.ndarray, " t"]
    """Values in SI units; NaN where there is no value."""
    name: str
    """Name in the file."""


@final
@dataclass(frozen=True)
class Weather:
    """Weather at a place.

    Columns are `air` and `dew_point` [K], `direct_normal`, `diffuse` (horizontal) and
    `infrared` (from the sky, horizontal) [W/m^2], `wind_speed` [m/s] and
    `wind_direction`, from which it blows [rad from north towards east].
    """

    source: str
    """Name for messages, such as the path of its file."""
    covers: tuple[float, float]
    """Start and end, since 1970-01-01 UTC [s]."""
    columns: Mapping[str, Column]
    zone: tzinfo = UTC
    """Zone of the times in messages."""

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
        times, values, file_name = self.columns[name]
        first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
        last = min(int(np.searchsorted(times, end)), len(times) - 1)
        rows = slice(first, last + 1)
        times = times[rows]
        values = values[rows]
        self._check_holes(file_name, times, values)
        inside = times[(times > start) & (times < end)]
        at = np.unique(np.concatenate([[start], inside, [end]]))
        return Column(at, np.interp(at, times, values), file_name)

    def check_covers(self, start: float, end: float) -> None:
        """Refuse a run that is not within the time of the weather.

        Raises:
            InputError: with the times of both.
        """
        first, last = self.covers
        if first <= start and end <= last:
            return
        stamp = self._stamp
        raise InputError(
            f"{self.source}: covers {stamp(first)} to {stamp(last)}, and the scene "
            f"runs from {stamp(start)} to {stamp(end)}: give another start, or a "
            "shorter run"
        )

    def _check_holes(self, name: str, times: np.ndarray, values: np.ndarray) -> None:
        holes = np.flatnonzero(~np.isfinite(values))
        if len(holes):
            others_note = f" (and {len(holes) - 1} more)" if len(holes) > 1 else ""
            raise InputError(
                f"{self.source}: column '{name}' has no value at "
                f"{self._stamp(times[holes[0]])}{others_note}: fill it in, or give "
                "another start"
            )
        gaps = np.flatnonzero(np.diff(times) > _MAX_GAP)
        if len(gaps):
            first = self._stamp(times[gaps[0]])
            last = self._stamp(times[gaps[0] + 1])
            raise InputError(
                f"{self.source}: column '{name}' has no rows between {first} "
                f"and {last}: fill them in, or give another start"
            )

    def _stamp(self, seconds: Any) -> str:
        moment = datetime.fromtimestamp(round(float(seconds)), self.zone)
        return moment.isoformat(timespec="minutes")
