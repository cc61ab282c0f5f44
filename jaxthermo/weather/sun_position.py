"""Direction of the sun at a place and time, by the library pvlib (an extra)."""

import importlib.util
import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, final

import lazy_loader
import numpy as np

from ..errors import InputError
from ..physics.radiation.source_motion import DirectionTable


# An extra, which the rest of the package must not need.
_pvlib: Any = lazy_loader.load("pvlib")

_REFRACTION_AT_HORIZON = 0.5667  # [deg]
_MEAN_TEMPERATURE = 12.0  # [degC], of the air that refracts
_LONGEST_PATH = 366 * 86400.0  # [s]


@final
@dataclass(frozen=True)
class Place:
    """A place on the earth, and how the scene lies there; z of the scene is up.

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


def directions_of_rays(place: Place, times: list[datetime]) -> np.ndarray:
    """Unit vectors [x, y, z] in which sunlight travels, one for each time.

    Refraction by the air is included. Below the horizon the vectors point upward.

    Raises:
        InputError: without the package pvlib, or for a time without a zone.
    """
    if importlib.util.find_spec("pvlib") is None:
        raise InputError(
            "the position of the sun needs the package pvlib: install it, as with "
            "`pip install 'jaxthermo[weather]'`"
        )
    for time in times:
        if time.utcoffset() is None:
            raise InputError(
                f"time {time.isoformat()} has no zone: write it as "
                f"{time.isoformat()}+01:00, or with Z for UTC"
            )
    seconds = np.array([time.timestamp() for time in times])
    # Barometric formula of the standard atmosphere [hPa].
    pressure = 1013.25 * (1 - 2.25577e-5 * place.altitude) ** 5.25588
    zenith, _, _, _, azimuth, _ = _pvlib.spa.solar_position(
        seconds,
        place.latitude,
        place.longitude,
        place.altitude,
        pressure,
        _MEAN_TEMPERATURE,
        _pvlib.spa.calculate_deltat(times[0].year, times[0].month),
        _REFRACTION_AT_HORIZON,
    )
    zenith, azimuth = np.radians(zenith), np.radians(azimuth)
    north = np.asarray(place.north) / math.hypot(*place.north)
    east = np.array([north[1], -north[0]])
    level = np.cos(azimuth)[:, None] * north + np.sin(azimuth)[:, None] * east
    return -np.column_stack([np.sin(zenith)[:, None] * level, np.cos(zenith)])


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
        InputError: without the package pvlib, for a start without a zone, or a
            duration or interval that is not positive.
    """
    if not (0 < every < math.inf and 0 < duration <= _LONGEST_PATH):
        raise InputError(
            f"sun_path: duration {duration} s and interval {every} s: give positive "
            "ones, of a year at most"
        )
    times = np.linspace(0.0, duration, math.ceil(duration / every) + 1)
    instants = [start + timedelta(seconds=float(time)) for time in times]
    return DirectionTable(times, directions_of_rays(place, instants))
