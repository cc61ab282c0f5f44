"""Doubts about the weather of a run: where it contradicts its place or itself."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..constants import STEFAN_BOLTZMANN
from .sky import SkyModel
from .sun_position import Place, sun_position
from .weather import Weather


_FAR = 1.0
"""Difference of latitude or longitude that is another weather [deg]."""
_FAR_IN_ZONES = 4.0
"""Difference between a zone and the time of the sun [h]; in China there are 3 h."""
_HALF_HOUR = 1800.0
_SURELY_DOWN = -0.02
"""Sine of the elevation below which the sun sheds no light."""
_SURELY_UP = 0.17
"""Sine of the elevation above which the sun sheds light through all clouds."""
_DIRECT = 20.0
"""Direct light of a sun that is up [W/m^2]."""
_SKY_EMISSIVITY = (0.4, 1.3)
"""Radiation of a sky relative to that of a black body as warm as the air [-]."""
_SPIKE = 8.0
"""Deviation of one row from both of its neighbours that is no weather [K]."""
_UNEVEN = 1.5
"""Interval relative to the usual one above which rows may be missing [-]."""


class Span(NamedTuple):
    """The time of a run, since 1970-01-01 UTC [s]."""

    start: float
    end: float


def place_doubts(weather: Weather, place: Place) -> list[str]:
    """Doubts about the place of a file that states one, where a scene is elsewhere."""
    stated = weather.place
    if stated is None:
        return []
    doubts = []
    latitude_change = abs(stated.latitude - place.latitude)
    turn = abs(stated.longitude - place.longitude) % 360
    longitude_change = min(turn, 360 - turn)
    distance = max(latitude_change, longitude_change)
    if distance > _FAR - 1e-9:
        doubts.append(
            f"{weather.source}: is of latitude {stated.latitude:g}, longitude "
            f"{stated.longitude:g}, {distance:.3g} degrees from the place of the "
            "scene: the sun is that of the scene, air and radiation are those of the "
            "file"
        )
    # A zone with summer time has no offset without a date.
    offset = weather.zone.utcoffset(None)
    if offset is None:
        return doubts
    hours = offset.total_seconds() / 3600
    from_sun = (hours - stated.longitude / 15 + 12) % 24 - 12
    if abs(from_sun) > _FAR_IN_ZONES:
        doubts.append(
            f"{weather.source}: its time zone {hours:g} h is {abs(from_sun):.2g} h "
            f"from the time of the sun at its longitude {stated.longitude:g}: check "
            "line 1"
        )
    return doubts


def daylight_doubts(weather: Weather, place: Place, span: Span) -> list[str]:
    """Doubts about daylight that is there at night, or not there by day."""
    direct = weather.within("direct_normal", span.start, span.end)
    diffuse = weather.within("diffuse", span.start, span.end)
    times = direct.times
    around = np.stack([times - _HALF_HOUR, times, times + _HALF_HOUR])
    height = sun_position(place, around.reshape(-1)).height.reshape(around.shape)
    light = direct.values + np.interp(times, diffuse.times, diffuse.values)
    night = (height.max(axis=0) < _SURELY_DOWN) & (direct.values > _DIRECT)
    dark = (height.min(axis=0) > _SURELY_UP) & (light <= 0)
    remedy = "check the place, the time zone and the hours of the file"
    return [
        *_doubt(weather, times, night, f"the sun shines while it is down; {remedy}"),
        *_doubt(weather, times, dark, f"there is no light by day; {remedy}"),
    ]


def air_doubts(weather: Weather, span: Span) -> list[str]:
    """Doubts about a temperature of the air that differs from all around it."""
    air = weather.within("air", span.start, span.end)
    doubts = _gap_doubts(weather, air.times)
    before = air.values[1:-1] - air.values[:-2]
    after = air.values[1:-1] - air.values[2:]
    smaller = np.minimum(np.abs(before), np.abs(after))
    is_spike = np.append(False, (before * after > 0) & (smaller > _SPIKE))
    text = f"the air differs by more than {_SPIKE:g} K from the rows around"
    return [*doubts, *_doubt(weather, air.times[:-1], is_spike, text)]


def sky_doubts(
    weather: Weather, sky: SkyModel, is_chosen: bool, span: Span
) -> list[str]:
    """Assumptions for the sky, and doubts about its radiation.

    Args:
        weather: of the run.
        sky: model of the sky.
        is_chosen: False if the model follows from the data.
        span: of the run.
    """
    if sky == "cloud_cover" and not is_chosen:
        return [
            f"{weather.source}: has no infrared radiation of the sky: its temperature "
            "follows from the dew point and the cloud cover (Walton 1983)"
        ]
    if sky == "diffuse_share" and not is_chosen:
        return [
            f"{weather.source}: has neither infrared radiation of the sky nor its "
            "cloud cover: the clouds follow from the diffuse share of the daylight; "
            "give `sky: berdahl_martin` if there are none"
        ]
    if sky == "swinbank" and not is_chosen:
        return [
            f"{weather.source}: has neither infrared radiation of the sky nor a dew "
            "point: the sky is taken as cloudless; give `sky: swinbank` if it is"
        ]
    if sky != "infrared":
        return []
    infrared = weather.within("infrared", span.start, span.end)
    air = weather.within("air", span.start, span.end)
    kelvin = np.interp(infrared.times, air.times, air.values)
    emissivity = infrared.values / (STEFAN_BOLTZMANN * kelvin**4)
    lowest, highest = _SKY_EMISSIVITY
    is_odd = (emissivity < lowest) | (emissivity > highest)
    text = (
        "the infrared radiation of the sky does not go with the temperature of the air"
    )
    return _doubt(weather, infrared.times, is_odd, text)


def _gap_doubts(weather: Weather, times: Float[np.ndarray, " t"]) -> list[str]:
    # The run may begin and end between rows.
    steps = np.diff(times[1:-1])
    if len(steps) < 3:
        return []
    is_wide = np.concatenate([[False], steps > _UNEVEN * np.median(steps), [False]])
    text = "rows are missing; values are linear between those that are there"
    return _doubt(weather, times[:-1], is_wide, text)


def _doubt(
    weather: Weather,
    times: Float[np.ndarray, " t"],
    is_doubtful: Bool[np.ndarray, " t"],
    text: str,
) -> list[str]:
    rows = np.flatnonzero(is_doubtful)
    if not len(rows):
        return []
    more = f" and {len(rows) - 1} more times" if len(rows) > 1 else ""
    return [f"{weather.source}: at {weather.stamp(float(times[rows[0]]))}{more} {text}"]
