"""How large and how bent a film polynomial gets, for the balance at the surface.

Between `LOWEST` and `HIGHEST` it is smooth; at those film temperatures it has a kink,
whose curvature has no bound.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from ..term import Reach
from ..time_varying import largest, smallest
from .film_polynomial import HALF, HIGHEST, LOWEST, MIDDLE, SHIFT


SAMPLES = 33
MISSED = 1.05
"""The samples may miss the top by this much."""


class FilmReach(NamedTuple):
    """Temperatures of air and of film that a run can get to."""

    air: tuple[float, float]
    """The coldest and the warmest [K]."""
    gap: float
    """The largest difference to a surface [K]."""
    film: Float[np.ndarray, " f"]
    """Samples of the film temperature [K]."""
    smooth: bool
    """Whether all of them are inside the interpolation."""


def film_reach(temperature: Any, reach: Reach) -> FilmReach:
    """Of air at a temperature [K], which may change with time."""
    air = (
        float(smallest(temperature, reach.end)),
        float(largest(temperature, reach.end)),
    )
    low, high = (air[0] + reach.coldest) / 2, (air[1] + reach.hottest) / 2
    return FilmReach(
        air=air,
        gap=max(reach.hottest - air[0], air[1] - reach.coldest, 0.0),
        film=np.clip(np.linspace(low, high, SAMPLES), LOWEST, HIGHEST),
        smooth=low > LOWEST and high < HIGHEST,
    )


def film_derivatives(
    rows: Float[np.ndarray, "n *g"], film: Float[np.ndarray, " f"]
) -> tuple[Float[np.ndarray, "*g f"], ...]:
    """A film polynomial and its first and second derivative by T_s.

    Args:
        rows: its coefficients, the powers on the first axis.
        film: temperatures T_f [K].
    """
    inverse = 1 / (film + SHIFT)
    x, slope = (MIDDLE - inverse) / HALF, inverse**2 / (2 * HALF)
    bend = -slope * inverse
    once, twice = polynomial.polyder(rows), polynomial.polyder(rows, 2)
    by_x = polynomial.polyval(x, once)
    return (
        polynomial.polyval(x, rows),
        by_x * slope,
        polynomial.polyval(x, twice) * slope**2 + by_x * bend,
    )
