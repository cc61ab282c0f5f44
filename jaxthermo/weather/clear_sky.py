"""Weather of cloudless days, for scenes without a weather file."""

import math
from dataclasses import dataclass
from datetime import datetime
from typing import Any, final

import lazy_loader
import numpy as np

from ..errors import InputError
from .sun_position import Place, sun_position
from .weather import Column, Weather


_pvlib: Any = lazy_loader.load("pvlib")

_STEP = 900.0  # [s]
_DAY = 86400.0  # [s]
_WARMEST = 15 * 3600.0  # [s] after midnight


@final
@dataclass(frozen=True)
class ClearSky:
    """Cloudless days: air by a sine over the day, warmest at 15 h of the start's zone.

    The sun is that of Ineichen and Perez with the given turbidity of the air.

    Raises:
        InputError: for values out of range.
    """

    air: tuple[float, float]
    """Lowest and highest temperature of the day [K]."""
    relative_humidity: float = 0.5
    """Humidity at the mean temperature of the air [-]; the dew point is constant."""
    wind_speed: float = 2.0
    """Speed of the wind [m/s]."""
    wind_direction: float = 270.0
    """Direction from which the wind blows, from north towards east [degrees]."""
    turbidity: float = 3.0
    """Linke turbidity [-]: 2 for very clean, 3 for clean, 5 for hazy air."""

    def __post_init__(self):
        low, high = self.air
        for name, value, lowest, highest in (
            ("air", low, 150.0, 350.0),
            ("air", high, low, 350.0),
            ("relative_humidity", self.relative_humidity, 0.01, 1.0),
            ("wind_speed", self.wind_speed, 0.0, 100.0),
            ("wind_direction", self.wind_direction, 0.0, 360.0),
            ("turbidity", self.turbidity, 1.0, 10.0),
        ):
            if not lowest <= value <= highest:
                raise InputError(
                    f"ClearSky({name}=): {value:g} is not between {lowest:g} and "
                    f"{highest:g}; give one that is"
                )

    def weather(self, place: Place, start: datetime, duration: float) -> Weather:
        """The weather at a place from a start with a zone, for a duration [s]."""
        first = start.timestamp()
        steps = max(math.ceil(duration / _STEP), 1)
        times = first + np.arange(steps + 1) * _STEP
        midnight = start.replace(hour=0, minute=0, second=0, microsecond=0).timestamp()
        phase = 2 * np.pi * (times - midnight - _WARMEST) / _DAY
        low, high = self.air
        mean = (low + high) / 2
        direct, diffuse = self._irradiance(place, times)
        even = np.ones(len(times))
        columns = {
            "air": mean + (high - low) / 2 * np.cos(phase),
            "dew_point": _dew_point(mean, self.relative_humidity) * even,
            "direct_normal": direct,
            "diffuse": diffuse,
            "wind_speed": self.wind_speed * even,
            "wind_direction": math.radians(self.wind_direction) * even,
        }
        return Weather(
            source="clear sky",
            covers=(float(times[0]), float(times[-1])),
            columns={
                name: Column(times, values, name) for name, values in columns.items()
            },
            zone=start.tzinfo or Weather.zone,
        )

    def _irradiance(self, site: Place, times: np.ndarray) -> tuple[Any, Any]:
        """Direct normal and diffuse horizontal irradiance [W/m^2]."""
        zenith = np.degrees(sun_position(site, times).zenith)
        relative = _pvlib.atmosphere.get_relative_airmass(zenith)
        airmass = _pvlib.atmosphere.get_absolute_airmass(relative, site.pressure * 100)
        day = datetime.fromtimestamp(float(times[0])).timetuple().tm_yday
        # At the horizon and below the model divides by 0; nothing shines there.
        with np.errstate(divide="ignore", invalid="ignore"):
            irradiance = _pvlib.clearsky.ineichen(
                zenith,
                airmass,
                self.turbidity,
                altitude=site.altitude,
                dni_extra=_pvlib.irradiance.get_extra_radiation(day),
            )
        return np.nan_to_num(irradiance["dni"]), np.nan_to_num(irradiance["dhi"])


def _dew_point(air: float, humidity: float) -> float:
    """Temperature at which the air is saturated [K]."""
    celsius = _pvlib.atmosphere.tdew_from_rh(air - 273.15, 100 * humidity)
    return float(celsius) + 273.15
