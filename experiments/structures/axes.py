"""Logarithmic axes, and colours that stay with their structure in every chart."""

import math
from collections.abc import Sequence
from typing import Any

import altair as alt


COLOURS = (
    "#20242c", "#7a808c", "#c1272d", "#e8833a", "#d4b106", "#7ea534", "#1b8a5a",
    "#17a2b8", "#2166ac", "#6a51a3", "#b5539c", "#8c5a2b", "#5b7f95", "#e377c2",
    "#7b1e3a", "#a3a000", "#004d61", "#ff6f61", "#3b7d23", "#9c88d6", "#c08a5a",
)  # fmt: skip

MARGIN = 0.08
"""Of an axis, beyond what is shown."""


class LogAxis:
    """Holds all values, with ticks at 1, 2 and 5 or at powers of ten."""

    def __init__(self, values: Sequence[float | int], title: str):
        """Values above 0."""
        low, high = math.log10(min(values)), math.log10(max(values))
        margin = MARGIN * max(high - low, 0.5)
        self.low, self.high = low - margin, high + margin
        self.title = title

    @property
    def ticks(self) -> list[float]:
        """Round numbers on the axis."""
        factors = (1, 2, 5) if self.high - self.low < 3.2 else (1,)
        exponents = range(math.floor(self.low) - 1, math.ceil(self.high) + 1)
        every = (float(f"{f}e{n}") for n in exponents for f in factors)
        return [v for v in every if self.low <= math.log10(v) <= self.high]

    def pixels(self, value: float, length: float) -> float:
        """Where a value stands on an axis of that length [px]."""
        return (math.log10(value) - self.low) / (self.high - self.low) * length

    def value(self, pixels: float, length: float) -> float:
        """What stands there."""
        return 10 ** (self.low + pixels / length * (self.high - self.low))

    def of(self, field: str) -> dict[str, Any]:
        """Arguments of `alt.X` or `alt.Y` for a field of the data."""
        ends = [10**self.low, 10**self.high]
        return {
            "shorthand": field,
            "type": "quantitative",
            "title": self.title,
            "scale": alt.Scale(type="log", domain=ends, nice=False),
            "axis": alt.Axis(values=self.ticks, format=".4~r"),
        }


def colour(shown: list[str], everyone: list[str], **how: Any) -> alt.Color:
    """The colour of each label: the same wherever it is shown among others."""
    number = {label: i for i, label in enumerate(dict.fromkeys(everyone))}
    colours = [COLOURS[number[label] % len(COLOURS)] for label in shown]
    scale = alt.Scale(domain=shown, range=colours)
    return alt.Color("label", type="nominal", scale=scale, sort=None, **how)
