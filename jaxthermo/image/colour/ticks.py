"""Ticks of a scale, and text of numbers, temperatures and times."""

import math
from datetime import datetime, timedelta

from ...constants import ZERO_CELSIUS
from ...progress import duration


_MAX_DECIMALS = 6


def _tick_step(span: float, max_ticks: int) -> float:
    """Smallest of 1, 2, 2.5, 5 x 10^n that gives at most `max_ticks` ticks."""
    exponent = math.floor(math.log10(span / max_ticks))
    for factor in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0):
        step = factor * 10.0**exponent
        # The worst case is a tick on both ends.
        if math.floor(span / step + 1e-9) + 1 <= max_ticks:
            return step
    return 50.0 * 10.0**exponent


def nice_ticks(low: float, high: float, max_ticks: int = 8) -> list[float]:
    """Round numbers in [low, high], 4 to 8 of them by default.

    Args:
        low: lower end of the scale, any unit.
        high: upper end, the same unit.
        max_ticks: largest number of ticks, at least 2.

    Returns:
        Multiples of one round step; `[low]` when the ends are equal.
    """
    # Below this the step is lost in the rounding of the ends.
    if high - low <= 1e-12 * max(abs(low), abs(high), 1.0):
        return [low]
    step = _tick_step(high - low, max(max_ticks, 2))
    # Tolerance: an end that is a tick but for rounding counts.
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    # + 0.0 turns a minus zero into zero.
    return [k * step + 0.0 for k in range(first, last + 1)]


def decimals_of(step: float) -> int:
    """Decimals that show a multiple of `step` exactly, at most 6."""
    for decimals in range(_MAX_DECIMALS):
        if abs(step - round(step, decimals)) < 1e-6 * abs(step):
            return decimals
    return _MAX_DECIMALS


def scale_ticks(
    low: float, high: float, max_ticks: int = 8
) -> tuple[tuple[float, str], ...]:
    """Ticks at round values of a scale: position from 0 to 1, and label of each."""
    values = nice_ticks(low, high, max_ticks)
    decimals = decimals_of(values[1] - values[0]) if len(values) > 1 else 1
    span = max(high - low, 1e-9)
    return tuple(((value - low) / span, label(value, decimals)) for value in values)


def end_decimals(low: float, high: float) -> int:
    """Decimals that show an end of a scale to 1 % of its span, at least 1."""
    if high <= low:
        return 1
    return min(max(1, math.ceil(-math.log10(high - low)) + 1), _MAX_DECIMALS)


def label(value: float, decimals: int) -> str:
    """Format a number with fixed decimals and without a negative zero."""
    text = f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text


def to_celsius(temperature: float) -> float:
    """Convert a temperature [K] to degrees Celsius."""
    return temperature - ZERO_CELSIUS


def time_label(time: float, start: datetime | None = None) -> str:
    """Format a time [s]: "t = 90 s", "t = 3 h 05 min".

    With the date and time of the start: "14:05, t = 3 h 05 min".
    """
    label = f"t = {duration(time)}"
    if start is None:
        return label
    # By whole seconds: rounding must not show the second before.
    now = start + timedelta(seconds=round(time))
    return f"{now:%H:%M:%S}, {label}" if now.second else f"{now:%H:%M}, {label}"
