"""Round numbers for a scale, and how to write temperatures and times."""

import math

from ..constants import ZERO_CELSIUS


_MOST_DECIMALS = 6


def nice_step(span: float, at_most: int) -> float:
    """The smallest of 1, 2, 2.5, 5 x 10^n that gives at most `at_most` ticks."""
    exponent = math.floor(math.log10(span / at_most))
    for factor in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0):
        step = factor * 10.0**exponent
        # The worst case is a tick on both ends.
        if math.floor(span / step + 1e-9) + 1 <= at_most:
            return step
    return 50.0 * 10.0**exponent


def nice_ticks(low: float, high: float, at_most: int = 8) -> list[float]:
    """Round numbers in [low, high]: 4 to 8 of them with the usual `at_most`.

    Args:
        low: lower end of the scale, any unit.
        high: upper end, the same unit.
        at_most: how many there is room for, at least 2.

    Returns:
        Multiples of one round step; `[low]` when the ends are equal.
    """
    # Below this the step is lost in the rounding of the ends themselves.
    if high - low <= 1e-12 * max(abs(low), abs(high), 1.0):
        return [low]
    step = nice_step(high - low, max(at_most, 2))
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    # + 0.0 turns a minus zero into zero.
    return [k * step + 0.0 for k in range(first, last + 1)]


def decimals_of(step: float) -> int:
    """How many decimals write a multiple of `step` without loss, at most 6."""
    for decimals in range(_MOST_DECIMALS):
        if abs(step - round(step, decimals)) < 1e-6 * abs(step):
            return decimals
    return _MOST_DECIMALS


def end_decimals(low: float, high: float) -> int:
    """Decimals that show an end of a scale to within 1 % of its span, at least 1."""
    if high <= low:
        return 1
    return min(max(1, math.ceil(-math.log10(high - low)) + 1), _MOST_DECIMALS)


def label(value: float, decimals: int) -> str:
    """A number with a fixed count of decimals; the font has no true minus sign."""
    text = f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text


def to_celsius(temperature: float) -> float:
    """Degrees Celsius of a temperature [K]."""
    return temperature - ZERO_CELSIUS


def time_label(time: float) -> str:
    """A time [s] as people say it: "t = 90 s", "t = 12 min 30 s", "t = 3 h 05 min"."""
    sign = "-" if time < 0 else ""
    size = abs(time)
    if size < 9.9995:
        return f"t = {sign}{size:.4g} s"
    # Rounded before splitting, so that 59.99 s never reads as 60 s of a minute.
    tenths = round(size, 1)
    if tenths < 120.0:
        return f"t = {sign}{tenths:g} s"
    seconds = round(size)
    if seconds < 3600:
        return f"t = {sign}{seconds // 60} min {seconds % 60:02d} s"
    minutes = round(size / 60)
    return f"t = {sign}{minutes // 60} h {minutes % 60:02d} min"
