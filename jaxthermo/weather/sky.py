"""Temperatures of sky and ground by the weather, and heat transfer in wind."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from ..constants import STEFAN_BOLTZMANN, ZERO_CELSIUS
from ..physics.convection.linear_wind import wind_coefficient


SkyModel = Literal[
    "infrared", "cloud_cover", "diffuse_share", "berdahl_martin", "swinbank"
]
GroundModel = Literal["air", "sol_air"]
_Series = Float[np.ndarray, " t"]

_GROUND_EMISSIVITY = 0.95
_DAYLIGHT = 20.0
"""Irradiance above which the diffuse share tells of clouds [W/m^2]."""


def sky_temperature(infrared: _Series) -> _Series:
    """Temperature of a black sky (E / sigma)^(1/4) [K] with an irradiance [W/m^2]."""
    return (infrared / STEFAN_BOLTZMANN) ** 0.25


def swinbank_sky_temperature(air: _Series) -> _Series:
    """Temperature of a cloudless sky 0.0552 T_air^1.5 [K], where no humidity is known.

    Source: Swinbank, Quarterly Journal of the Royal Meteorological Society 89 (1963)
    339, in the form of Duffie and Beckman.
    """
    return 0.0552 * air**1.5


def clear_sky_temperature(
    air: _Series, dew_point: _Series, solar_hour: _Series
) -> _Series:
    """Temperature of a cloudless sky eps^(1/4) T_air [K].

    eps = 0.711 + 0.56 d + 0.73 d^2 + 0.013 cos(2 pi h / 24), with the dew point d in
    units of 100 degC and the hour h of the sun's time.

    Source: Berdahl and Martin, Solar Energy 32 (1984) 663.

    Args:
        air: temperature of the air [K].
        dew_point: dew point of the air [K].
        solar_hour: hour of the sun's time [h].
    """
    dew = (dew_point - ZERO_CELSIUS) / 100
    daily = 0.013 * np.cos(2 * np.pi * solar_hour / 24)
    return (0.711 + 0.56 * dew + 0.73 * dew**2 + daily) ** 0.25 * air


def cloudy_sky_temperature(clear_sky: _Series, air: _Series, cover: _Series) -> _Series:
    """Temperature of a sky with clouds [K], not above that of the air.

    eps = eps_0 (1 + 0.0224 N - 0.0035 N^2 + 0.00028 N^3), with the emissivity eps_0 =
    (T_clear / T_air)^4 of the cloudless sky and the cover N in tenths.

    Source: Walton, Thermal Analysis Research Program Reference Manual, NBSIR 83-2655
    (1983), as in EnergyPlus, where N is the opaque cover.

    Args:
        clear_sky: temperature of the cloudless sky [K].
        air: temperature of the air [K].
        cover: fraction of the sky that clouds cover [-].
    """
    tenths = 10 * cover
    clouds = 1 + 0.0224 * tenths - 0.0035 * tenths**2 + 0.00028 * tenths**3
    return np.minimum(clouds**0.25 * clear_sky, np.maximum(air, clear_sky))


def diffuse_cloud_cover(diffuse: _Series, whole: _Series) -> _Series:
    """Cover of the sky by clouds N [-] from the diffuse share of the daylight.

    D / G = 0.3 + 0.7 N^2. At night, where the sky sheds less than 20 W/m^2, the cover
    is interpolated between the evening and the morning; it is 0 without any day.

    Source: Kasten and Czeplak, Solar Energy 24 (1980) 177.

    Args:
        diffuse: D, on the horizontal [W/m^2].
        whole: G, direct and diffuse, on the horizontal [W/m^2].
    """
    is_day = whole > _DAYLIGHT
    if not is_day.any():
        return np.zeros_like(whole)
    share = np.clip(diffuse[is_day] / whole[is_day], 0.3, 1.0)
    rows = np.arange(len(whole))
    return np.interp(rows, rows[is_day], np.sqrt((share - 0.3) / 0.7))


def overcast_sky_temperature(
    clear_sky: _Series, air: _Series, cover: _Series
) -> _Series:
    """Temperature of a sky with clouds [K], not above that of the air.

    eps = eps_0 (1 + 0.2232 N^2.75), with the emissivity eps_0 = (T_clear / T_air)^4 of
    the cloudless sky and the cover N [-].

    Source: Maykut and Church, Journal of Applied Meteorology 12 (1973) 620.
    """
    clouds = 1 + 0.2232 * cover**2.75
    return np.minimum(clouds**0.25 * clear_sky, np.maximum(air, clear_sky))


def sol_air_temperature(
    air: _Series, sky: _Series, speed: _Series, absorbed: _Series
) -> _Series:
    """Temperature of dry ground in balance with sun, sky and air [K].

    Solves a E + eps sigma (T_sky^4 - T^4) + h (T_air - T) = 0, for ground that stores
    no heat and has no water to evaporate. The temperature of real ground varies less.

    Args:
        air: temperature of the air [K].
        sky: temperature of the sky [K].
        speed: of the wind [m/s].
        absorbed: short-wave radiation a E [W/m^2].
    """
    h = wind_coefficient(speed)
    ground = air
    # Newton's method: the balance falls with the temperature, and is concave.
    for _ in range(8):
        net = _GROUND_EMISSIVITY * STEFAN_BOLTZMANN * (sky**4 - ground**4)
        slope = 4 * _GROUND_EMISSIVITY * STEFAN_BOLTZMANN * ground**3 + h
        ground = ground + (absorbed + net + h * (air - ground)) / slope
    return ground
