"""Numbers for readers: three digits, with unit and spread."""

import math


def significant(value: float | int) -> str:
    """Three significant digits, or all before the point: "0.405", "87,947"."""
    # From 999.5 the format "g" would write 1e+03.
    return f"{value:,.0f}" if abs(value) >= 999.5 else f"{value:.3g}"


def padded(value: float | int) -> str:
    """Three significant digits with final zeros, for columns: "2.80" above "2.75"."""
    if abs(value) >= 999.5:
        return significant(value)
    return f"{value:#.3g}".removesuffix(".")


def seconds(value: float) -> str:
    """A duration [s] with its unit: "13 ms", "1.92 s", "1,085 s"."""
    if value >= 1:
        return f"{significant(value)} s"
    return f"{significant(1e3 * value)} ms"


def seconds_with_range(median: float, fastest: float, slowest: float) -> str:
    """Durations [s] in one unit: "13 (12-15) ms"."""
    scale, unit = (1.0, "s") if median >= 1 else (1e3, "ms")
    spread = with_range(scale * median, low=scale * fastest, high=scale * slowest)
    return f"{spread} {unit}"


# Largest value over the smallest one above which their median says nothing.
_WIDE = 10.0


def with_range(median: float, low: float, high: float) -> str:
    """A median with the range of the values: "8.1 (7.5-9)".

    A range wider than tenfold is there alone: "1.2 to 312".
    """
    if low > 0 and high > _WIDE * low:
        return f"{significant(low)} to {significant(high)}"
    return f"{significant(median)} ({significant(low)}-{significant(high)})"


def count(number: int, noun: str) -> str:
    """A count of things: "1 node", "12,000 nodes"."""
    return f"{number:,} {noun}{'s' * (number != 1)}"


def is_finite(value: float | None) -> bool:
    """True for a finite number."""
    return value is not None and math.isfinite(value)
