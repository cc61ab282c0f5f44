"""The long wave of the sky, measured on the horizontal, and laws from the literature.

Clouds are known by the diffuse share of the daylight alone: the cover N follows from
the sums of diffuse and global irradiance in a window of some hours, D / G = 0.3 +
0.7 N^2 (Kasten and Czeplak, Solar Energy 24, 1980, 177).
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jaxthermo.constants import STEFAN_BOLTZMANN, ZERO_CELSIUS
from jaxthermo.weather.sky import (
    clear_sky_temperature,
    cloudy_sky_temperature,
    diffuse_cloud_cover,
    overcast_sky_temperature,
    swinbank_sky_temperature,
)

from .data import Columns, kelvin


_ROWS_AN_HOUR = 6
_DAY = 24 * _ROWS_AN_HOUR
"""Rows of a day."""

WINDOWS = (1.0, 3.0, 6.0, 12.0, 24.0)
"""Windows of light that are compared [h]."""

_Series = Float[np.ndarray, " t"]


def _vapour_pressure(columns: Columns) -> _Series:
    """Pressure of the water vapour [hPa] (Magnus, with the numbers of Sonntag 1990)."""
    air = columns["air_degC"]
    saturated = 6.112 * np.exp(17.62 * air / (243.12 + air))
    return np.maximum(columns["relative_humidity_percent"], 1.0) / 100 * saturated


def _dew_point(columns: Columns) -> _Series:
    """Dew point [K]."""
    logarithm = np.log(_vapour_pressure(columns) / 6.112)
    return 243.12 * logarithm / (17.62 - logarithm) + ZERO_CELSIUS


def _cover(columns: Columns, window: float) -> _Series:
    """Cover of the sky by clouds [-], from the light within half a window [h] around.

    At night it is interpolated between the evening and the morning.
    """
    half = max(round(window / 2 * _ROWS_AN_HOUR), 1)
    ones = np.ones(2 * half + 1)
    diffuse = np.convolve(columns["diffuse_horizontal_W_m2"], ones, mode="same")
    whole = np.convolve(columns["global_horizontal_W_m2"], ones, mode="same")
    return diffuse_cloud_cover(diffuse / len(ones), whole / len(ones))


def _brutsaert(columns: Columns) -> _Series:
    air = kelvin(columns["air_degC"])
    return 1.24 * (_vapour_pressure(columns) / air) ** (1 / 7)


def _prata(columns: Columns) -> _Series:
    water = 46.5 * _vapour_pressure(columns) / kelvin(columns["air_degC"])
    return 1 - (1 + water) * np.exp(-np.sqrt(1.2 + 3.0 * water))


def _emissivity(sky: _Series, columns: Columns) -> _Series:
    return (sky / kelvin(columns["air_degC"])) ** 4


def _berdahl_martin(columns: Columns) -> _Series:
    hour = columns["time_s"] / 3600 % 24
    air = kelvin(columns["air_degC"])
    return _emissivity(clear_sky_temperature(air, _dew_point(columns), hour), columns)


def _swinbank(columns: Columns) -> _Series:
    return _emissivity(swinbank_sky_temperature(kelvin(columns["air_degC"])), columns)


def _walton(clear: _Series, cover: _Series) -> _Series:
    one = np.ones_like(clear)
    return cloudy_sky_temperature(clear**0.25, one, cover) ** 4


def _unsworth_monteith(clear: _Series, cover: _Series) -> _Series:
    return (1 - 0.84 * cover) * clear + 0.84 * cover


def _black_clouds(clear: _Series, cover: _Series) -> _Series:
    return clear + (1 - clear) * cover


def _maykut_church(clear: _Series, cover: _Series) -> _Series:
    one = np.ones_like(clear)
    return overcast_sky_temperature(clear**0.25, one, cover) ** 4


def _without_clouds(clear: _Series, cover: _Series) -> _Series:
    del cover
    return clear


CLEAR: dict[str, Callable[[Columns], _Series]] = {
    "Swinbank 1963": _swinbank,
    "Brutsaert 1975": _brutsaert,
    "Berdahl and Martin 1984": _berdahl_martin,
    "Prata 1996": _prata,
}
"""Emissivity of a cloudless sky [-]."""

CLOUDS: dict[str, Callable[[_Series, _Series], _Series]] = {
    "none": _without_clouds,
    "Unsworth and Monteith 1975": _unsworth_monteith,
    "Maykut and Church 1973": _maykut_church,
    "Walton 1983": _walton,
    "Crawford and Duchon 1999": _black_clouds,
}
"""Emissivity of a sky with clouds, from that of a cloudless one and the cover [-]."""


def errors(columns: Columns) -> dict[tuple[str, str, float], _Series]:
    """Computed less measured long wave [W/m^2] of pairs of laws, with each window."""
    covers = {window: _cover(columns, window) for window in WINDOWS}
    black = STEFAN_BOLTZMANN * kelvin(columns["air_degC"]) ** 4
    measured = columns["longwave_horizontal_W_m2"]
    return {
        (clear, clouds, window): with_clouds(emissivity(columns), covered) * black
        - measured
        for clear, emissivity in CLEAR.items()
        for clouds, with_clouds in CLOUDS.items()
        for window, covered in covers.items()
    }


def on_the_wall(columns: Columns, horizontal: _Series) -> _Series:
    """Computed less measured long wave on the wall [W/m^2], from the horizontal one.

    The wall sees as much of the sky as of a black ground, which is as warm as the air.
    """
    ground = STEFAN_BOLTZMANN * kelvin(columns["air_degC"]) ** 4
    return (horizontal + ground) / 2 - columns["longwave_west_W_m2"]


def is_chosen_by(columns: Columns) -> np.ndarray:
    """True in the days by which the law is chosen, every second one."""
    return np.arange(len(columns["air_degC"])) // _DAY % 2 == 0
