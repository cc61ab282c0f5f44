"""Colour scale for differences: blue below zero, light grey at zero, red above.

The colour follows asinh(d / d0): linear in the difference d below d0 and logarithmic
above, so that one scale shows a tenth of a kelvin and ten kelvin.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from .sheet import ColourBar


# Ticks closer to zero, on a scale from -1 to 1, would overlap its label.
_MIN_TICK_DISTANCE = 0.1

BACKGROUND = (58, 61, 68)

# sRGB, equally dark at equal distances from zero so that neither sign stands out.
_ANCHORS = (
    (-1.0, 20, 36, 120),
    (-0.75, 32, 92, 190),
    (-0.5, 84, 156, 222),
    (-0.25, 168, 206, 236),
    (0.0, 240, 240, 238),
    (0.25, 246, 192, 160),
    (0.5, 232, 118, 84),
    (0.75, 192, 44, 44),
    (1.0, 108, 8, 32),
)


@dataclass(frozen=True)
class DifferenceScale:
    """Scale from -limit to limit [K]."""

    limit: float
    decades: float = 2.5
    """Decades from the end of the linear part to `limit`."""

    @property
    def linear(self) -> float:
        """Difference d0 up to which the scale is linear [K]."""
        return self.limit / 10**self.decades

    def position(self, kelvin: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Position along the scale, -1 to 1; beyond `limit` it stays at the end."""
        bounded = np.clip(kelvin, -self.limit, self.limit)
        end = np.arcsinh(self.limit / self.linear)
        return np.arcsinh(bounded / self.linear) / end

    def colour(self, position: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n 3"]:
        """The sRGB colours at positions along the scale."""
        table = np.asarray(_ANCHORS, float)
        anchor_position = table[:, 0]
        channels = [
            np.interp(position, anchor_position, anchor_channel)
            for anchor_channel in table[:, 1:].T
        ]
        colours = np.stack(channels, axis=-1)
        return np.rint(colours).astype(np.uint8)

    def picture(
        self, kelvin: Float[np.ndarray, "h w"], body: Bool[np.ndarray, "h w"]
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of differences where the image shows the body; dark elsewhere."""
        colours = self.colour(self.position(kelvin))
        colours[~body] = BACKGROUND
        return colours

    def ticks(self) -> list[float]:
        """Zero, the ends, and tenths and hundredths of the ends away from zero [K]."""
        down = self.limit / np.array([100.0, 10.0, 1.0])
        is_apart = self.position(down) > _MIN_TICK_DISTANCE
        up = [float(value) for value in down[is_apart]]
        negative = [-value for value in reversed(up)]
        return [*negative, 0.0, *up]


def nice_limit(largest: float) -> float:
    """The smallest of 1, 2, 5 x 10^n that is not below the largest difference [K]."""
    exponent = np.floor(np.log10(max(largest, 1e-6)))
    decade = 10.0**exponent
    for factor in (1.0, 2.0, 5.0):
        limit = factor * decade
        # With a tolerance for rounding: 0.3 / 0.1 is above 3.
        if largest <= limit * (1 + 1e-9):
            return float(limit)
    return float(10.0 * decade)


def difference_bar(scale: DifferenceScale, title: str) -> ColourBar:
    """The colour bar of a scale, under a title that names the unit."""
    ticks = np.asarray(scale.ticks())
    positions = (scale.position(ticks) + 1) / 2
    labelled = []
    for position, tick in zip(positions, ticks, strict=True):
        labelled.append((float(position), _signed(tick)))
    along = np.linspace(-1.0, 1.0, 512)
    return ColourBar(
        colours=scale.colour(along),
        ticks=tuple(labelled),
        title=title,
    )


def _signed(value: float) -> str:
    if value == 0:
        sign = ""
    elif value > 0:
        sign = "+"
    else:
        sign = "-"
    return f"{sign}{abs(value):g}"
