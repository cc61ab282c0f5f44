"""Position of the sun at a place and time, computed by pvlib (an extra)."""

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple, final

import lazy_loader
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..extras import require_extra
from ..physics.radiation.source_motion import DirectionTable


# pvlib is an extra: the package must be importable without it.
_pvlib: Any = lazy_loader.load("pvlib")

_REFRACTION_AT_HORIZON = 0.5667  # [deg]
_MEAN_TEMPERATURE = 12.0  # [degC], of the air that refracts
_LONGEST_PATH = 366 * 86400.0  # [s]


@final
@dataclass(frozen=True)
class Place:
    """A place on the earth and the direction of north in the scene, whose z points up.

    Raises:
        InputError: for a latitude, longitude or altitude that does not exist.
    """

    latitude: float
    """Degrees north of the equator."""
    longitude: float
    """Degrees east of Greenwich."""
    altitude: float = 0.0
    """Height above the sea [m]."""
    north: tuple[float, float] = (0.0, 1.0)
    """Direction of north in x and y of the scene."""

    def __post_init__(self):
        for name, lowest, highest, unit in (
            ("latitude", -90, 90, "degrees"),
            ("longitude", -180, 180, "degrees"),
            ("altitude", -500, 9000, "m"),
        ):
            value = getattr(self, name)
            if not lowest <= value <= highest:
                raise InputError(
                    f"Place({name}=): {value} is not between {lowest} and {highest} "
                    f"{unit}; give one that is"
                )
        length = math.hypot(*self.north)
        if not (math.isfinite(length) and length > 0):
            raise InputError(
                f"Place(north=): {self.north} has no direction; give x and y of north"
            )

    @property
    def pressure(self) -> float:
        """Mean pressure of the air by the standard atmosphere [hPa]."""
        return 1013.25 * (1 - 2.25577e-5 * self.altitude) ** 5.25588

    @property
    def axes(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Unit vectors to north and east in the scene."""
        x, y = np.asarray(self.north, float) / math.hypot(*self.north)
        return np.array([x, y, 0.0]), np.array([y, -x, 0.0])


def _require_pvlib(purpose: str) -> None:
    """Check that pvlib is installed.

    Raises:
        InputError: if it is not, with the purpose and the remedy.
    """
    require_extra(f"{purpose} needs", package="pvlib", extra="weather")


class _SunPosition(NamedTuple):
    """Position of the sun at several times, refraction by the air included."""

    zenith: Float[np.ndarray, " t"]
    """Angle from the vertical [rad]."""
    azimuth: Float[np.ndarray, " t"]
    """Angle from north towards east [rad]."""

    @property
    def height(self) -> Float[np.ndarray, " t"]:
        """Sine of the elevation, negative while the sun is down [-]."""
        return np.cos(self.zenith)


def sun_position(place: Place, seconds: Float[np.ndarray, " t"]) -> _SunPosition:
    """Position of the sun at times since 1970-01-01 UTC [s].

    Source: Reda and Andreas, Solar Energy 76 (2004) 577, as in pvlib.

    Raises:
        InputError: without the package pvlib.
    """
    _require_pvlib("the position of the sun")
    date = datetime.fromtimestamp(float(seconds[0]), UTC)
    zenith, _, _, _, azimuth, _ = _pvlib.spa.solar_position(
        np.asarray(seconds, float),
        place.latitude,
        place.longitude,
        place.altitude,
        place.pressure,
        _MEAN_TEMPERATURE,
        _pvlib.spa.calculate_deltat(date.year, date.month),
        _REFRACTION_AT_HORIZON,
    )
    return _SunPosition(np.radians(zenith), np.radians(azimuth))


def rays(place: Place, seconds: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 3"]:
    """Unit vectors along which sunlight travels; upward while the sun is down.

    Times are as in `sun_position`.
    """
    sun = sun_position(place, seconds)
    north, east = place.axes
    level = np.cos(sun.azimuth)[:, None] * north + np.sin(sun.azimuth)[:, None] * east
    up = np.array([0.0, 0.0, 1.0])
    return -(np.sin(sun.zenith)[:, None] * level + sun.height[:, None] * up)


def instant(time: datetime) -> float:
    """Seconds from 1970-01-01 UTC to a date and time with a time zone [s].

    Raises:
        InputError: for a time without a zone.
    """
    if time.utcoffset() is None:
        raise InputError(
            f"time {time.isoformat()} has no zone: write it as "
            f"{time.isoformat()}+01:00, or with Z for UTC"
        )
    return time.timestamp()


def sun_path(
    place: Place, start: datetime, duration: float, every: float = 900.0
) -> DirectionTable:
    """Moving direction of a `Sun`: time 0 of the scene is `start`.

    A scene has no ground: the irradiance must be zero while the sun is down.

    Args:
        place: where the scene is.
        start: date and time with a zone.
        duration: of the scene [s].
        every: interval of the table [s].

    Raises:
        InputError: without the package pvlib, for a start without a time zone, and
            for a duration or an interval that is not positive.
    """
    if not (0 < every < math.inf and 0 < duration <= _LONGEST_PATH):
        raise InputError(
            f"sun_path: duration {duration} s and interval {every} s: give positive "
            "ones, of a year at most"
        )
    times = np.linspace(0.0, duration, math.ceil(duration / every) + 1)
    return DirectionTable(times, rays(place, instant(start) + times))
