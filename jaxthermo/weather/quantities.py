"""Quantities of weather files: their columns, valid ranges and units."""

import re
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..constants import ZERO_CELSIUS


class Quantity(NamedTuple):
    """A quantity, with its column in both formats."""

    name: str
    """Name of the column of `Weather`."""
    csv: str
    """Name of its column in a CSV file."""
    epw: str
    """Name of its column in messages on an EPW file."""
    position: int
    """Position of its column in an EPW file, from 0."""
    lowest: float
    """Smallest valid number, in the unit of the file."""
    highest: float
    """Largest valid number; those that stand for no value in EPW files are larger."""
    to_si: Callable[[np.ndarray], np.ndarray] = lambda values: values
    is_mean: bool = False
    """True if a row of an EPW file has the mean over the hour before."""
    is_optional: bool = False
    """True if a CSV file may leave out the column."""

    @property
    def limits(self) -> str:
        """The valid range in words, in the unit of the file."""
        return f"from {self.lowest:g} to {self.highest:g}"

    def values(self, texts: Iterable[str]) -> Float[np.ndarray, " t"]:
        """Numbers in SI units; NaN for a text that is no number in the valid range."""
        numbers = np.array([_number(text) for text in texts], float)
        is_valid = (numbers >= self.lowest) & (numbers <= self.highest)
        return self.to_si(np.where(is_valid, numbers, np.nan))


def _kelvin(values: np.ndarray) -> np.ndarray:
    return values + ZERO_CELSIUS


def _fraction(tenths: np.ndarray) -> np.ndarray:
    return tenths / 10


def _number(text: str) -> float:
    # Python takes 1_0 for ten, which no weather file means.
    try:
        return float("nan") if "_" in text else float(text)
    except ValueError:
        return float("nan")


_INFRARED = Quantity(
    # Files have 0 for no value.
    name="infrared",
    csv="infrared_W_m2",
    epw="ghi_infrared",
    position=12,
    lowest=1.0,
    highest=1000.0,
    is_mean=True,
    is_optional=True,
)
_LONGWAVE = re.compile(r"longwave_(.+)_W_m2")
CLOUD_COVER = Quantity(
    name="cloud_cover",
    csv="cloud_cover_tenths",
    epw="opaque_sky_cover",
    position=23,
    lowest=0.0,
    highest=10.0,
    to_si=_fraction,
    is_optional=True,
)
TOTAL_COVER = CLOUD_COVER._replace(epw="total_sky_cover", position=22)
"""Clouds that the sky shows through count too."""

QUANTITIES = (
    Quantity(
        name="air",
        csv="air_degC",
        epw="temp_air",
        position=6,
        lowest=-100.0,
        highest=70.0,
        to_si=_kelvin,
    ),
    Quantity(
        name="dew_point",
        csv="dew_point_degC",
        epw="temp_dew",
        position=7,
        lowest=-120.0,
        highest=70.0,
        to_si=_kelvin,
        is_optional=True,
    ),
    Quantity(
        name="direct_normal",
        csv="direct_normal_W_m2",
        epw="dni",
        position=14,
        lowest=0.0,
        highest=1500.0,
        is_mean=True,
    ),
    Quantity(
        name="diffuse",
        csv="diffuse_W_m2",
        epw="dhi",
        position=15,
        lowest=0.0,
        highest=1500.0,
        is_mean=True,
    ),
    _INFRARED,
    Quantity(
        name="wind_speed",
        csv="wind_speed_m_s",
        epw="wind_speed",
        position=21,
        lowest=0.0,
        highest=120.0,
    ),
    Quantity(
        name="wind_direction",
        csv="wind_direction_deg",
        epw="wind_direction",
        position=20,
        lowest=0.0,
        highest=360.0,
        to_si=np.radians,
    ),
    CLOUD_COVER,
)


def longwave(plane: str) -> str:
    """Column of `Weather` with the long wave that reaches surfaces of a plane."""
    return f"longwave {plane}"


def planes_of(names: Iterable[str]) -> tuple[Quantity, ...]:
    """Quantities of columns such as `longwave_west_W_m2`, for planes of any name."""
    matches = [_LONGWAVE.fullmatch(name) for name in names]
    return tuple(
        _INFRARED._replace(name=longwave(match[1]), csv=match[0])
        for match in matches
        if match is not None
    )
