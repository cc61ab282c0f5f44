"""Temperatures that are hardly meant, and units that may have been meant instead.

Below 150 K a number is most likely in degrees Celsius, above 6000 K in another unit.
One option accepts such temperatures, wherever they are given.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .constants import MAX_TEMPERATURE, MIN_TEMPERATURE, ZERO_CELSIUS
from .errors import InputError


ALLOW_EXTREME = "allow_extreme_temperatures"
"""Name of the option, in files as in Python."""
KELVIN_NAMES = ("K", "kelvin")
CELSIUS_NAMES = ("degC", "°C", "celsius")

_ROOM_TEMPERATURE = 300.0
_SHOWN_PIXELS = 3


class Limits(NamedTuple):
    """Least and largest plausible value of temperatures, or of what follows them."""

    low: float = MIN_TEMPERATURE
    """[K]"""
    high: float = MAX_TEMPERATURE
    """[K]"""

    def exceeded(self, values: Float[np.ndarray, "..."]) -> Bool[np.ndarray, "..."]:
        """True where a value is outside; NaN is not."""
        return np.asarray((values < self.low) | (values > self.high))


def temperature_limits(allow_extreme_temperatures: bool) -> Limits:
    """Limits of temperatures [K]: 150 to 6000, or 0 and more where all are allowed."""
    return Limits(0.0, math.inf) if allow_extreme_temperatures else Limits()


def extreme_fault(kelvin: float) -> str:
    """Say which limit a temperature [K] exceeds; empty if it is within both."""
    if kelvin < MIN_TEMPERATURE:
        return f"{kelvin:g} K is below {MIN_TEMPERATURE:g} K"
    if kelvin > MAX_TEMPERATURE:
        return f"{kelvin:g} K is above {MAX_TEMPERATURE:g} K"
    return ""


def extreme_refusal(
    argument: str, kelvin: float, option: str, pixels: str = ""
) -> InputError:
    """The error for a temperature [K] outside of the limits.

    Args:
        argument: that gives it.
        kelvin: the temperature [K].
        option: that lifts the limits.
        pixels: the count and the places of all such temperatures, if they are pixels.
    """
    hint = ""
    if kelvin < MIN_TEMPERATURE:
        hint = f" ({kelvin:g} degC are {kelvin + ZERO_CELSIUS:g} K)"
    return InputError(
        f"{argument}: {extreme_fault(kelvin)}{pixels}: give kelvin{hint}; if it is "
        f"meant, {option}"
    )


def check_numbers_of_kelvin(
    owner: str, allow_extreme_temperatures: bool, **temperatures: float | int
) -> None:
    """Refuse plain temperatures of a class that are none, or outside of the limits.

    Args:
        owner: name of the class.
        allow_extreme_temperatures: accept all that are finite and above 0 K.
        temperatures: by the names of its fields [K].

    Raises:
        InputError: naming the field.
    """
    for name, number in temperatures.items():
        kelvin = float(number)
        argument = f"{owner}({name}={number!r})"
        if not (math.isfinite(kelvin) and kelvin > 0):
            raise InputError(f"{argument}: give kelvin, finite and more than 0")
        if not allow_extreme_temperatures and extreme_fault(kelvin):
            raise extreme_refusal(argument, kelvin, option=f"{ALLOW_EXTREME}=True")


class LinearUnit(NamedTuple):
    """Unit of numbers N, whose temperatures are T = scale N + offset."""

    scale: float = 1.0
    """[K]"""
    offset: float = 0.0
    """[K]"""

    def kelvin(self, numbers: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Temperatures of numbers [K]."""
        return numbers * self.scale + self.offset

    def numbers(self, kelvin: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Numbers of temperatures [K]."""
        return (kelvin - self.offset) / self.scale


KELVIN = LinearUnit()
CENTIKELVIN = LinearUnit(scale=0.01)
"""Unit of cameras with a linear output of temperature, in 16 bits."""
_CELSIUS = LinearUnit(offset=ZERO_CELSIUS)
UNITS = {
    **dict.fromkeys(KELVIN_NAMES, KELVIN),
    "centikelvin": CENTIKELVIN,
    **dict.fromkeys(CELSIUS_NAMES, _CELSIUS),
}
"""Units of temperatures in files by their names."""
_UNITS_OF_CAMERAS = {
    "kelvin": KELVIN,
    "celsius": _CELSIUS,
    "centikelvin": CENTIKELVIN,
    "{scale: 0.04 K}": LinearUnit(scale=0.04),
    "{scale: 0.1 K}": LinearUnit(scale=0.1),
}


def likely_unit(numbers: Float[np.ndarray, " n"]) -> str:
    """Unit in which most numbers are near room temperature; empty if there is none."""
    middle = np.median(numbers, keepdims=True)
    distances = {
        name: abs(math.log(float(unit.kelvin(middle)[0]) / _ROOM_TEMPERATURE))
        for name, unit in _UNITS_OF_CAMERAS.items()
        if not Limits().exceeded(unit.kelvin(middle)).any()
    }
    return min(distances, key=lambda name: distances[name], default="")


class CheckedValues(NamedTuple):
    """Values of the pixels of one frame or several, and words for them."""

    values: Float[np.ndarray, "*t h w"]
    """NaN for each pixel that is not checked."""
    symbol: str = "K"
    """Unit of the values."""
    noun: str = "pixels"
    times: tuple[float, ...] = ()
    """Time of each frame [s]."""

    def listed(self, wrong: Bool[np.ndarray, "*t h w"]) -> str:
        """The first wrong pixels, as a text of their values and places."""
        places = np.argwhere(wrong)
        texts = []
        for place in places[:_SHOWN_PIXELS].tolist():
            number = f"{self.values[tuple(place)]:.6g} {self.symbol}"
            time = f" at {self.times[place[0]]:g} s" if self.times else ""
            texts.append(f"{number} at row {place[-2]}, column {place[-1]}{time}")
        more = len(places) - len(texts)
        return ", ".join(texts) + (f" and {more} more" if more else "")


def pixel_mistake(
    checked: CheckedValues,
    limits: Limits,
    unit: LinearUnit | None = None,
    option: str = "",
) -> str:
    """The message for pixels outside of the limits; empty if there are none.

    Args:
        checked: values of pixels.
        limits: of the values.
        unit: that was taken for the numbers of a file, which may be the mistake.
        option: that lifts the limits, to be named unless they are lifted.
    """
    values = checked.values
    wrong = limits.exceeded(values)
    count = int(wrong.sum())
    if not count:
        return ""
    finite = values[np.isfinite(values)]
    ends = []
    if (finite < limits.low).any():
        ends.append(f"below {limits.low:.6g} {checked.symbol}")
    if (finite > limits.high).any():
        ends.append(f"above {limits.high:.6g} {checked.symbol}")
    remedy = "mask them, or repair the frame"
    if unit is not None and count > finite.size / 2:
        likely = likely_unit(unit.numbers(finite))
        remedy = "give the unit of the file" + (
            f", probably {likely}" if likely else ""
        )
    if option and limits != temperature_limits(allow_extreme_temperatures=True):
        remedy += f"; if they are meant, {option}"
    return (
        f"{count} of {finite.size} {checked.noun} are {' or '.join(ends)}: "
        f"{checked.listed(wrong)}: {remedy}"
    )
