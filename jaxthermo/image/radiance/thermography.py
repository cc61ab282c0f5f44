"""Temperatures of objects from what a thermal camera measures, and the reverse.

A camera at the end of an air path of transmissivity tau measures, in a band or over all
wavelengths,

    L = tau [eps L_b(T) + (1 - eps) L_b(T_reflected)] + (1 - tau) L_b(T_air).

Counts of FLIR's cameras take the place of L_b: S = R1 / (R2 (exp(B / T) - F)) - O. Both
are smooth, for numbers and arrays of numpy or JAX.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ...arrays import array_namespace, is_traced
from ...errors import InputError
from ...physics.time_varying import check_temperature
from ...temperatures import ALLOW_EXTREME
from .atmosphere import LONG_WAVE_AIR, AirConstants, half_path_transmissivity
from .band import (
    LONG_WAVE,
    MIN_BRIGHTNESS_TEMPERATURE,
    Band,
    apparent_temperature,
    black_radiance,
)


def _array(value: Any) -> Any:
    on_device = isinstance(value, jax.Array)
    return value if on_device else np.asarray(value, float)


def _black_radiance(temperature: Any, band: Band | None) -> Any:
    # Exact, where images on the host look it up in a table.
    kelvin = _array(temperature)
    return black_radiance(kelvin, None) if band is None else band.radiance(kelvin)


def _check_fraction(name: str, value: Any, above: bool = False) -> None:
    if is_traced(value):
        return
    fraction = np.asarray(value, float)
    inside = (fraction > 0 if above else fraction >= 0) & (fraction <= 1)
    if not inside.all():
        lower_bound = "more than 0" if above else "0"
        raise InputError(f"{name}={value!r}: give {lower_bound} to 1")


def _where_above(
    least: float, values: Any, compute: Callable[[Any], Any], refusal: str
) -> Any:
    """Temperatures of the values above the least one; not a number for each other one.

    Raises:
        InputError: with the text `refusal` if none is above it.
    """
    if isinstance(values, jax.Array):
        return compute(values)
    numbers = np.asarray(values)
    valid = numbers > least
    if not valid.any():
        raise InputError(refusal)
    # Any valid number stands in for those that `compute` would refuse.
    with np.errstate(all="ignore"):
        kelvin = compute(np.where(valid, numbers, numbers[valid].flat[0]))
    return np.where(valid, kelvin, np.nan)[()]


def _check_distance(distance: Any) -> None:
    if is_traced(distance):
        return
    metres = np.asarray(distance, float)
    if not (np.isfinite(metres) & (metres >= 0)).all():
        raise InputError(
            f"FlirCalibration: distance={distance!r}: give metres, not < 0"
        )


def _check_temperatures(function: str, **temperatures: Any) -> None:
    for name, value in temperatures.items():
        option = f"{ALLOW_EXTREME}=True"
        check_temperature(value, f"{function}: {name}", option=option)


def measured_radiance(
    temperature: Any,
    emissivity: Any = 1.0,
    reflected_temperature: Any = 293.15,
    transmissivity: Any = 1.0,
    air_temperature: Any = 293.15,
    band: Band | None = LONG_WAVE,
    *,
    allow_extreme_temperatures: bool = False,
) -> Any:
    """Radiance that a camera measures of an object [W/(m^2 sr)].

    Args:
        temperature: of the object [K].
        emissivity: of its surface [-].
        reflected_temperature: of a black body that reflects as its surroundings do [K].
        transmissivity: of the air between them [-].
        air_temperature: of this air [K].
        band: of the detector; None for all wavelengths.
        allow_extreme_temperatures: accept temperatures below 150 K, mostly mistaken
            Celsius, and above 6000 K.

    Raises:
        InputError: for fractions that are not 0 to 1, or extreme temperatures.

    Example:
        >>> import jaxthermo as jt
        >>> round(float(jt.measured_radiance(350.0, 0.9, 293.15, 0.95, 290.0)), 4)
        107.6726
    """
    _check_fraction("measured_radiance: emissivity", emissivity)
    _check_fraction("measured_radiance: transmissivity", transmissivity)
    if not allow_extreme_temperatures:
        _check_temperatures(
            "measured_radiance",
            temperature=temperature,
            reflected_temperature=reflected_temperature,
            air_temperature=air_temperature,
        )
    emitted = _black_radiance(temperature, band)
    around = _black_radiance(reflected_temperature, band)
    air = _black_radiance(air_temperature, band)
    leaving = emissivity * emitted + (1 - emissivity) * around
    return transmissivity * leaving + (1 - transmissivity) * air


def object_temperature(
    radiance: Any,
    emissivity: Any = 1.0,
    reflected_temperature: Any = 293.15,
    transmissivity: Any = 1.0,
    air_temperature: Any = 293.15,
    band: Band | None = LONG_WAVE,
    *,
    allow_extreme_temperatures: bool = False,
) -> Any:
    """Temperature of an object of a measured radiance [K], the inverse of the above.

    The arguments are those of `measured_radiance`. Radiances that are less than what is
    reflected and added on the way have no temperature: not a number.

    Raises:
        InputError: for an emissivity or transmissivity that is not above 0, extreme
            temperatures of surroundings or air, or if no radiance has a temperature.
    """
    _check_fraction("object_temperature: emissivity", emissivity, above=True)
    _check_fraction("object_temperature: transmissivity", transmissivity, above=True)
    if not allow_extreme_temperatures:
        _check_temperatures(
            "object_temperature",
            reflected_temperature=reflected_temperature,
            air_temperature=air_temperature,
        )
    around = _black_radiance(reflected_temperature, band)
    air = _black_radiance(air_temperature, band)
    leaving = (_array(radiance) - (1 - transmissivity) * air) / transmissivity
    emitted = (leaving - (1 - emissivity) * around) / emissivity

    def kelvin(radiance: Any) -> Any:
        if band is None or isinstance(radiance, jax.Array):
            return apparent_temperature(radiance, band)
        return band.temperature(radiance)

    coldest = MIN_BRIGHTNESS_TEMPERATURE
    least = 0.0 if band is None else float(band.radiance(coldest))
    return _where_above(
        least,
        values=emitted,
        compute=kelvin,
        refusal="object_temperature: every radiance is less than what the object "
        "reflects and the air adds: check emissivity, reflected and air temperature",
    )


@dataclass(frozen=True)
class FlirCalibration:
    """Constants between temperatures and raw counts of a FLIR camera.

        S = R1 / (R2 (exp(B / T) - F)) - O,    T = B / ln(R1 / (R2 (S + O)) + F).

    The defaults are those of an SC660 (gtatters/Thermimage); each file of a camera has
    its own.

    Example:
        >>> import jaxthermo as jt
        >>> round(float(jt.FlirCalibration().temperature(18109)) - 273.15, 4)
        23.6243
    """

    r1: float = 21106.77
    """Gain."""
    b: float = 1501.0
    """Effective c2 over the wavelength [K]."""
    f: float = 1.0
    """Offset of the shape."""
    o: float = -7340.0
    """Offset of the counts."""
    r2: float = 0.012545258
    """Scale of R1."""

    def __post_init__(self):
        positive = {"r1": self.r1, "b": self.b, "r2": self.r2}
        for name, value in positive.items():
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"FlirCalibration({name}={value!r}): give more than 0")

    def counts(
        self, temperature: Any, *, allow_extreme_temperatures: bool = False
    ) -> Any:
        """Counts S of a black surface at temperatures [K].

        Raises:
            InputError: for temperatures below 150 K or above 6000 K that are not
                allowed.
        """
        if not allow_extreme_temperatures:
            _check_temperatures("FlirCalibration.counts", temperature=temperature)
        kelvin = _array(temperature)
        exp = array_namespace(kelvin).exp
        return self.r1 / (self.r2 * (exp(self.b / kelvin) - self.f)) - self.o

    def temperature(self, counts: Any) -> Any:
        """Temperature of a black surface with counts S [K].

        Counts of -O and less, such as those of dead pixels, have none: not a number.

        Raises:
            InputError: if no counts have a temperature.
        """

        def kelvin(signal: Any) -> Any:
            log = array_namespace(signal).log
            return self.b / log(self.r1 / (self.r2 * signal) + self.f)

        return _where_above(
            0.0,
            values=_array(counts) + self.o,
            compute=kelvin,
            refusal=f"FlirCalibration: counts of {-self.o:g} and less are no "
            "temperature, and there are no others: check the offset O",
        )

    def object_temperature(
        self,
        counts: Any,
        emissivity: Any = 1.0,
        reflected_temperature: Any = 293.15,
        distance: Any = 0.0,
        air_temperature: Any = 293.15,
        relative_humidity: Any = 0.5,
        window_transmissivity: Any = 1.0,
        window_temperature: Any = 293.15,
        air_constants: AirConstants = LONG_WAVE_AIR,
        *,
        allow_extreme_temperatures: bool = False,
    ) -> Any:
        """Temperature of an object behind air and a window [K].

        The window, which does not reflect, stands half way: S = tau^2 w [eps S(T) +
        (1 - eps) S(T_reflected)] and what both halves of the path and the window add,
        with tau by FLIR's formula for half the distance. Pixels that are colder than
        what is reflected and added on the way have no temperature: not a number.

        Args:
            counts: S.
            emissivity: of the object [-].
            reflected_temperature: of what it reflects [K].
            distance: of the object [m].
            air_temperature: of the air [K].
            relative_humidity: of the air, 0 to 1.
            window_transmissivity: w; 1 without a window [-].
            window_temperature: of the window [K].
            air_constants: of the camera.
            allow_extreme_temperatures: accept those below 150 K and above 6000 K.

        Raises:
            InputError: for fractions that are not above 0, extreme temperatures of
                what is reflected, air or window, or if no counts have a temperature.
        """
        prefix = "FlirCalibration: "
        _check_fraction(f"{prefix}emissivity", emissivity, above=True)
        _check_fraction(f"{prefix}window_transmissivity", window_transmissivity, True)
        _check_fraction(f"{prefix}relative_humidity", relative_humidity)
        if not allow_extreme_temperatures:
            _check_temperatures(
                "FlirCalibration",
                reflected_temperature=reflected_temperature,
                air_temperature=air_temperature,
                window_temperature=window_temperature,
            )
        _check_distance(distance)
        xp = array_namespace((distance, air_temperature, relative_humidity))
        # Constants of a damaged file may be any: their pixels are no numbers.
        with np.errstate(all="ignore"):
            passed = half_path_transmissivity(
                _array(distance),
                temperature=_array(air_temperature),
                relative_humidity=relative_humidity,
                xp=xp,
                constants=air_constants,
            )
            leaving = self._leaving(
                _array(counts),
                passed=passed,
                air_temperature=air_temperature,
                window_transmissivity=window_transmissivity,
                window_temperature=window_temperature,
            )
            around = self._black_counts(reflected_temperature)
            emitted = (leaving - (1 - emissivity) * around) / emissivity
        return self.temperature(emitted)

    def _leaving(
        self,
        counts: Any,
        passed: Any,
        air_temperature: Any,
        window_transmissivity: Any,
        window_temperature: Any,
    ) -> Any:
        """Counts that leave an object, behind air and a window."""
        air = self._black_counts(air_temperature)
        window = self._black_counts(window_temperature)
        signal = (counts - (1 - passed) * air) / passed
        behind = signal - (1 - window_transmissivity) * window
        behind = behind / window_transmissivity
        return (behind - (1 - passed) * air) / passed

    def _black_counts(self, temperature: Any) -> Any:
        return self.counts(temperature, allow_extreme_temperatures=True)
