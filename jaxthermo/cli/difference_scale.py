"""A colour scale for differences: cold, nothing, hot; fine near zero, wide at its ends.

Colour goes with asinh(d / d0): in proportion to the difference below d0, and with its
logarithm above, so that one scale shows a tenth of a kelvin and ten.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from .sheet import ColourBar


DECADES = 2.5
"""Between d0 and the end of the scale, if not given."""
CLEAR = 0.1
"""Of the scale, between a tick and zero."""

BACKGROUND = (58, 61, 68)

# Blue to red through a light grey, sRGB; equally dark at equal distances from zero.
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
    """Symmetric about zero, with its ends at `limit` [K]."""

    limit: float
    decades: float = DECADES

    @property
    def linear(self) -> float:
        """d0 [K]."""
        return self.limit / 10**self.decades

    def place(self, kelvin: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Along the scale: -1 to 1; differences beyond the ends take the end's."""
        bounded = np.clip(kelvin, -self.limit, self.limit)
        whole = np.arcsinh(self.limit / self.linear)
        return np.arcsinh(bounded / self.linear) / whole

    def colour(self, place: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n 3"]:
        """The colours of places along the scale."""
        table = np.asarray(_ANCHORS, float)
        channels = [np.interp(place, table[:, 0], c) for c in table[:, 1:].T]
        return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)

    def picture(
        self, kelvin: Float[np.ndarray, "h w"], body: Bool[np.ndarray, "h w"]
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Differences in colour where the body is; dark elsewhere."""
        colours = self.colour(self.place(kelvin))
        colours[~body] = BACKGROUND
        return colours

    def ticks(self) -> list[float]:
        """Zero, the ends, and tenths and hundredths of them that are clear of it."""
        down = self.limit / np.array([100.0, 10.0, 1.0])
        up = [float(value) for value in down[self.place(down) > CLEAR]]
        return [*(-value for value in up[::-1]), 0.0, *up]


def nice_limit(largest: float) -> float:
    """The next of 1, 2, 5 x 10^n that holds the largest difference [K]."""
    exponent = np.floor(np.log10(max(largest, 1e-6)))
    for factor in (1.0, 2.0, 5.0, 10.0):
        if largest <= factor * 10.0**exponent * (1 + 1e-9):
            return float(factor * 10.0**exponent)
    return float(10.0 ** (exponent + 1))


def difference_bar(scale: DifferenceScale, title: str) -> ColourBar:
    """The bar of a scale, with its ticks.

    Args:
        scale: of the pictures above.
        title: with the unit.
    """
    ticks = np.asarray(scale.ticks())
    places = (scale.place(ticks) + 1) / 2
    return ColourBar(
        colours=scale.colour(np.linspace(-1.0, 1.0, 512)),
        ticks=tuple((float(p), _signed(t)) for p, t in zip(places, ticks, strict=True)),
        title=title,
    )


def _signed(value: float) -> str:
    sign = "" if value == 0 else "+" if value > 0 else "-"
    return f"{sign}{abs(value):g}"
