"""Terms of a scene outdoors: sun, daylight, sky and ground, and wind, by the weather.

Time 0 of the scene is the start. All values are piecewise linear between the times of
the weather. The table of direct sunlight contains sunset and sunrise and is 0 between
them: a scene has no ground that would cast a shadow.
"""

import math
import operator
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import reduce
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float

from ..choices import OutdoorTerm
from ..errors import InputError
from ..geometry.vectors import triple, unit_vector
from ..physics.convection.linear_wind import LinearWind
from ..physics.convection.wind import Wind
from ..physics.radiation.diffuse_sky import DiffuseSky
from ..physics.radiation.emission import Surroundings
from ..physics.radiation.source import Sun
from ..physics.radiation.source_motion import DirectionTable
from ..physics.term import AbstractTerm
from ..physics.time_varying import Table
from ..voxels.elsewhere import Elsewhere
from ..voxels.selection import AbstractSelection
from .clear_sky import ClearSky
from .doubts import Span, air_doubts, daylight_doubts, place_doubts, sky_doubts
from .files import read_weather
from .quantities import longwave as longwave_column
from .sky import (
    GroundModel,
    SkyModel,
    clear_sky_temperature,
    cloudy_sky_temperature,
    diffuse_cloud_cover,
    overcast_sky_temperature,
    sky_temperature,
    sol_air_temperature,
    swinbank_sky_temperature,
)
from .sun_position import Place, instant, rays, sun_position
from .weather import Weather


_TERMS: tuple[OutdoorTerm, ...] = ("sun", "diffuse", "sky", "wind", "convection")
ALL_TERMS: tuple[OutdoorTerm, ...] = ("sun", "diffuse", "sky", "wind")

# Columns that the temperature of the sky follows from, with that of the air.
_SKY_COLUMNS: dict[SkyModel, tuple[str, ...]] = {
    "infrared": ("infrared",),
    "cloud_cover": ("dew_point", "cloud_cover"),
    "diffuse_share": ("dew_point", "direct_normal", "diffuse"),
    "berdahl_martin": ("dew_point",),
    "swinbank": (),
}

# Interval at which sunrise and sunset are searched [s].
_SEARCH = 300.0
_MAX_DURATION = 366 * 86400.0


def outdoors(
    place: Place | None,
    start: datetime,
    duration: float,
    weather: ClearSky | Weather | str | Path,
    *,
    terms: Sequence[OutdoorTerm] = ALL_TERMS,
    sky: SkyModel | None = None,
    ground: GroundModel | float = "air",
    albedo: float = 0.2,
    occlusion: int | None = None,
    every: float = 1800.0,
    north: tuple[float, float] | None = None,
    longwave: Mapping[str, AbstractSelection] | None = None,
) -> tuple[AbstractTerm, ...]:
    """Terms of a scene at a place, from a start with a zone and for a duration [s].

    Doubts about the weather, and what was assumed for lack of data, are warnings.

    Args:
        place: location of the scene, and its direction of north; None for that of an
            EPW file.
        start: date and time with a zone, time 0 of the scene.
        duration: of the scene [s].
        weather: a file (EPW or CSV), or a cloudless sky.
        terms: which of `sun` (direct), `diffuse` (`DiffuseSky`), `sky` (`Surroundings`
            with sky and ground), and `wind` (of the mean direction, weighted by the
            speed) or `convection` (`LinearWind`, 2.8 + 3.0 v).
        sky: temperature by the file's `infrared` radiation, by the dew point and the
            `cloud_cover` or the `diffuse_share` of the daylight, or for a cloudless sky
            by the dew point (`berdahl_martin`) or the air alone (`swinbank`); None for
            the first that the weather has.
        ground: temperature of the ground [K], `air` for that of the air (as over
            grass), or `sol_air` for dry ground that stores no heat.
        albedo: fraction of sunlight that the ground reflects [-].
        occlusion: number of directions in which obstacles hide sky and ground.
        every: interval at which the sun's shadows are recomputed [s].
        north: direction of north in x and y of the scene, for the place of a file; a
            `Place` has its own.
        longwave: surfaces whose long wave was measured on their own plane, by the
            name in its column, such as `west` for `longwave_west_W_m2`. It takes the
            place of sky and ground there, and contains what obstacles emit.

    Raises:
        InputError: without the extra `[weather]`, for a start without a zone, for
            weather that has holes or does not cover the time, or values out of range.
    """
    _check(terms, duration=duration, albedo=albedo, interval=every)
    if longwave and "sky" not in terms:
        raise InputError("outdoors(longwave=): needs the term 'sky', which it replaces")
    first = instant(start)
    last = first + float(duration)
    if isinstance(weather, ClearSky):
        if place is None:
            raise InputError("outdoors(place=None): a clear sky has none; give a Place")
        weather_data = weather.weather(place, start, float(duration))
        sky = sky or "berdahl_martin"
    elif isinstance(weather, Weather):
        weather_data = weather
    else:
        weather_data = read_weather(Path(weather), start)
    weather_data.check_covers(first, last)
    scene = _Outdoors(
        place=_site(place, weather_data, north),
        first=first,
        last=last,
        weather=weather_data,
        sky=sky or _sky_model(weather_data),
        ground=ground,
        albedo=albedo,
        occlusion=occlusion,
        longwave={} if longwave is None else longwave,
    )
    builders: dict[str, Callable[[], AbstractTerm | None]] = {
        "sun": lambda: scene.sun(float(every)),
        "diffuse": scene.diffuse,
        "sky": scene.surroundings,
        "wind": scene.wind,
        "convection": scene.convection,
    }
    built = [*(builders[name]() for name in terms), *scene.measured_planes()]
    for doubt in scene.doubts(terms, is_sky_chosen=sky is not None):
        warnings.warn(doubt, stacklevel=2)
    return tuple(term for term in built if term is not None)


def _check(terms: Any, duration: float, albedo: float, interval: float) -> None:
    names = _TERMS
    for name in terms:
        if name not in names:
            raise InputError(
                f"outdoors(terms=): {name!r} is none of {', '.join(names)}"
            )
    if {"wind", "convection"} <= set(terms) or len(set(terms)) < len(terms):
        raise InputError(
            "outdoors(terms=): give each once, and one of wind and convection"
        )
    if not 0 < duration <= _MAX_DURATION:
        raise InputError(f"outdoors(duration={duration}): give 0 s to 366 days")
    if not 0 <= albedo <= 1:
        raise InputError(f"outdoors(albedo={albedo}): give a fraction from 0 to 1")
    if not 1 <= interval < math.inf:
        raise InputError(f"outdoors(every={interval}): give 1 s or more")


def _site(
    place: Place | None, weather: Weather, north: tuple[float, float] | None
) -> Place:
    """The place of the scene: the given one, or that of the weather."""
    if place is None:
        if weather.place is None:
            raise InputError(
                f"outdoors(place=None): {weather.source} states no place; give a Place"
            )
        return weather.place if north is None else replace(weather.place, north=north)
    if north is not None:
        raise InputError(
            f"outdoors(north={north}): is for the place of a file; give it to the Place"
        )
    return place


def _sky_model(weather: Weather) -> SkyModel:
    """The model of the sky that needs the most of what the weather has."""
    if weather.has("infrared"):
        return "infrared"
    if not weather.has("dew_point"):
        return "swinbank"
    return "cloud_cover" if weather.has("cloud_cover") else "diffuse_share"


@final
@dataclass(frozen=True)
class _Outdoors:
    """The weather during one run, and the terms that follow from it."""

    place: Place
    first: float
    """Start since 1970-01-01 UTC [s]."""
    last: float
    """End since 1970-01-01 UTC [s]."""
    weather: Weather
    sky: SkyModel
    ground: GroundModel | float
    albedo: float
    occlusion: int | None
    longwave: Mapping[str, AbstractSelection]
    """Surfaces by the name of the plane on which their long wave was measured."""

    def doubts(self, terms: Sequence[str], is_sky_chosen: bool) -> list[str]:
        """Warnings about the weather, as far as the terms depend on it."""
        weather = self.weather
        span = Span(self.first, self.last)
        doubts = weather.remarks_within(span.start, span.end)
        doubts += place_doubts(weather, self.place)
        if {"sky", "wind", "convection"} & {*terms}:
            doubts += air_doubts(weather, span)
        if {"sun", "diffuse"} <= {*terms}:
            doubts += daylight_doubts(weather, self.place, span)
        if "sky" in terms:
            doubts += sky_doubts(weather, self.sky, is_sky_chosen, span)
        return doubts

    def sun(self, interval: float) -> Sun | None:
        """Direct sunlight; None if the sun stays down."""
        searched = _grid(self.first, self.last, _SEARCH)
        up, crossings = _day_and_night(self.place, searched)
        if not up.any():
            return None
        column = self.weather.within("direct_normal", self.first, self.last)
        shines = np.interp(column.times, searched, up) > 0.5
        irradiance = np.where(shines, column.values, 0.0)
        by_time = dict(zip(column.times, irradiance, strict=True))
        by_time |= dict.fromkeys(crossings, 0.0)
        times = np.array(sorted(by_time))
        steps = _grid(self.first, self.last, interval)
        recomputed = steps[np.interp(steps, searched, up) > 0.5]
        path_times, directions = self._directions(searched[up], crossings)
        snapshots = np.union1d(recomputed, crossings) - self.first
        path = DirectionTable(
            path_times, directions, snapshots=tuple(snapshots.tolist())
        )
        values = np.array([by_time[time] for time in times])
        return Sun(path, Table(times - self.first, values))

    def _directions(self, by_day: np.ndarray, crossings: np.ndarray) -> Any:
        """Times [s] and directions of rays by day, and one direction for each night."""
        times = np.union1d(by_day, crossings)
        by_sun = rays(self.place, times)
        # At night nothing is lit. The direction is straight down then: the arcs from
        # sunset and to sunrise are right angles, where half a turn would be ambiguous.
        gaps = np.flatnonzero(np.diff(times) > 1.5 * _SEARCH)
        middle = (times[gaps] + times[gaps + 1]) / 2
        down = np.tile([0.0, 0.0, -1.0], (len(gaps), 1))
        all_times = np.concatenate([times, middle])
        order = np.argsort(all_times)
        directions = np.concatenate([by_sun, down])
        return all_times[order] - self.first, directions[order]

    def diffuse(self) -> DiffuseSky:
        """Daylight from sky and ground."""
        times = self._times(["direct_normal", "diffuse"])
        diffuse = self._at("diffuse", times)
        reflected = self.albedo * self._global(times, diffuse)
        return DiffuseSky(
            self._table(times, diffuse),
            self._table(times, reflected),
            occlusion=self.occlusion,
        )

    def surroundings(self) -> Surroundings:
        """Sky and ground by their temperatures."""
        names = ["air", *_SKY_COLUMNS[self.sky]]
        if self.ground == "sol_air":
            names += ["direct_normal", "diffuse", "wind_speed"]
        times = self._times(names)
        air = self._at("air", times)
        if self.sky == "infrared":
            sky = sky_temperature(self._at("infrared", times))
        elif self.sky == "swinbank":
            sky = swinbank_sky_temperature(air)
        else:
            hour = times / 3600 + self.place.longitude / 15
            sky = clear_sky_temperature(air, self._at("dew_point", times), hour)
        if self.sky == "cloud_cover":
            sky = cloudy_sky_temperature(sky, air, self._at("cloud_cover", times))
        if self.sky == "diffuse_share":
            diffuse = self._at("diffuse", times)
            cover = diffuse_cloud_cover(diffuse, self._global(times, diffuse))
            sky = overcast_sky_temperature(sky, air, cover)
        ground = self._ground(times, air=air, sky=sky)
        if isinstance(ground, np.ndarray):
            ground = self._table(times, ground)
        measured = tuple(self.longwave.values())
        return Surroundings(
            self._table(times, sky),
            ground=ground,
            occlusion=self.occlusion,
            on=Elsewhere(reduce(operator.or_, measured)) if measured else None,
        )

    def measured_planes(self) -> tuple[Surroundings, ...]:
        """Surroundings of the surfaces whose long wave was measured."""
        names = {plane: longwave_column(plane) for plane in self.longwave}
        times = {plane: self._times([name]) for plane, name in names.items()}
        return tuple(
            Surroundings(
                self._table(
                    times[plane], sky_temperature(self._at(name, times[plane]))
                ),
                on=self.longwave[plane],
            )
            for plane, name in names.items()
        )

    def _ground(self, times: np.ndarray, air: np.ndarray, sky: np.ndarray) -> Any:
        if self.ground == "air":
            return air
        if self.ground != "sol_air":
            return float(self.ground)
        light = self._global(times, self._at("diffuse", times))
        wind = self._at("wind_speed", times)
        return sol_air_temperature(
            air, sky=sky, speed=wind, absorbed=(1 - self.albedo) * light
        )

    def wind(self) -> Wind:
        """Wind of the mean direction; its speed and the air vary."""
        times = self._times(["air", "wind_speed"])
        speed = self._at("wind_speed", times)
        # Angle from north towards east of the direction from which the wind blows.
        angle = self._at("wind_direction", times)[:, None]
        north, east = self.place.axes
        origin = np.cos(angle) * north + np.sin(angle) * east
        velocity = -np.mean(speed[:, None] * origin, axis=0)
        # In a calm any direction is as good.
        if np.linalg.norm(velocity) <= 1e-9:
            velocity = -north
        return Wind(
            velocity=triple(unit_vector(velocity)),
            temperature=self._table(times, self._at("air", times)),
            speed=self._table(times, speed),
        )

    def convection(self) -> LinearWind:
        """Wind over flat surfaces, without a direction."""
        times = self._times(["air", "wind_speed"])
        return LinearWind(
            speed=self._table(times, self._at("wind_speed", times)),
            temperature=self._table(times, self._at("air", times)),
        )

    def _global(self, times: np.ndarray, diffuse: np.ndarray) -> np.ndarray:
        """Irradiance of a horizontal surface [W/m^2]."""
        height = np.maximum(sun_position(self.place, times).height, 0)
        return self._at("direct_normal", times) * height + diffuse

    def _table(self, times: np.ndarray, values: np.ndarray) -> Table:
        """Values by the time of the scene."""
        return Table(times - self.first, values)

    def _times(self, names: Sequence[str]) -> Float[np.ndarray, " t"]:
        columns = (self.weather.within(n, self.first, self.last) for n in names)
        return np.unique(np.concatenate([column.times for column in columns]))

    def _at(self, name: str, times: np.ndarray) -> Float[np.ndarray, " t"]:
        column = self.weather.within(name, self.first, self.last)
        return np.interp(times, column.times, column.values)


def _grid(first: float, last: float, step: float) -> Float[np.ndarray, " t"]:
    """Times from first to last at equal steps, both ends included [s]."""
    times = np.arange(first, last, step)
    return np.append(times, last) if last - times[-1] > 1e-6 * step else times


def _day_and_night(site: Place, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flags of the times at which the sun is up; times of sunrise and sunset [s]."""
    height = sun_position(site, times).height
    up = height > 0
    changes = np.flatnonzero(up[1:] != up[:-1])
    # Linear between the two times around a crossing of the horizon.
    height_before = height[changes]
    height_after = height[changes + 1]
    fraction = height_before / (height_before - height_after)
    step = times[changes + 1] - times[changes]
    return up, times[changes] + step * fraction
