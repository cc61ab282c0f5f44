"""Automatic gain: temperatures to brightness by their histogram, as cameras display.

A camera has more temperatures than a display has levels. With the histogram of a frame
cut off at a plateau, h_k = min(n_k, P n), those that are frequent get more of the
levels, in proportion to sum_{j <= k} h_j, and a large even background not all of them.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...errors import InputError


# Bins of the histogram, many for each of 256 levels.
_BINS = 2048


class Gain(NamedTuple):
    """A monotone curve from temperatures to positions on the scale."""

    kelvin: Float[np.ndarray, " k"]
    """Temperatures, increasing, from the end of the scale to the other [K]."""
    position: Float[np.ndarray, " k"]
    """Positions of the temperatures on the scale, from 0 to 1."""

    def positions(self, kelvin: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Positions of temperatures on the scale; NaN stays, ends are kept."""
        return np.asarray(np.interp(kelvin, self.kelvin, self.position))


def plateau_gain(
    kelvin: Float[np.ndarray, "h w"],
    on_body: Bool[np.ndarray, "h w"],
    low: float,
    high: float,
    plateau: float = 0.002,
) -> Gain:
    """Gain by the histogram of a frame, cut off at a plateau.

    Args:
        kelvin: temperatures of the pixels [K].
        on_body: pixels that count, those of bodies.
        low: temperature at the lower end of the scale [K].
        high: temperature at the upper end [K].
        plateau: P, the largest fraction of the pixels that counts in one of 2048 bins:
            1 for an equalized histogram, towards 0 all occupied bins count alike.

    Raises:
        InputError: for a plateau that is not above 0 and up to 1.
    """
    if not 0 < plateau <= 1:
        raise InputError(f"plateau={plateau!r}: give a fraction above 0, up to 1")
    edges = np.linspace(low, high, _BINS + 1)
    seen = np.clip(kelvin[on_body], low, high)
    if not len(seen) or high <= low:
        return Gain(np.array([low, high]), np.array([0.0, 1.0]))
    count, _ = np.histogram(seen, edges)
    cut = np.minimum(count, plateau * len(seen))
    total = np.concatenate([[0.0], np.cumsum(cut)])
    return Gain(edges, total / total[-1])
