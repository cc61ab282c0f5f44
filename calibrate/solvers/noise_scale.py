"""Standard deviations of residuals: after a fit, and for the knee of a robust loss."""

import math

import numpy as np
from jaxtyping import Array, Float


_NORMAL_SD_PER_MEDIAN = 1.4826
"""Standard deviation of normal numbers over the median of their magnitudes."""


def residual_sd(
    residual: Float[np.ndarray, " r"], size: int, noise: float | None
) -> float:
    """Standard deviation of a residual: of the noise, or of the fit's remainder."""
    if noise is not None:
        return noise
    # Each fitted coordinate takes one degree of freedom.
    degrees_of_freedom = max(len(residual) - size, 1)
    return float(np.sqrt((np.asarray(residual, float) ** 2).sum() / degrees_of_freedom))


def noise_scale(residual: Array, known_sd: float | None) -> float:
    """Standard deviation that outliers do not move, for the knee of a robust loss.

    The known one of the noise; without it 1.4826 times the median magnitude of the
    finite residuals that are not 0, which is the standard deviation of normal ones.

    Source: Huber, Robust Statistics (1981), section 5.1.
    """
    if known_sd is not None:
        return known_sd
    magnitudes = np.abs(np.asarray(residual, float))
    # What is not compared has a residual of 0.
    magnitudes = magnitudes[np.isfinite(magnitudes) & (magnitudes > 0)]
    if not magnitudes.size:
        return math.inf
    return _NORMAL_SD_PER_MEDIAN * float(np.median(magnitudes))
