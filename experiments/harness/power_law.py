"""Powers of a size that a quantity grows with, by straight lines through logarithms."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Power(NamedTuple):
    """Power of a size that a quantity grows with."""

    power: float
    error: float
    """Standard error of the power."""

    @property
    def text(self) -> str:
        """The power with its standard error."""
        return f"{self.power:.2f} ± {self.error:.2f}"


def power(sizes: ArrayLike, values: ArrayLike) -> float:
    """Power that values grow with, of two sizes or more."""
    slope, _ = np.polyfit(np.log(sizes), np.log(values), 1)
    return float(slope)


def fitted_power(sizes: ArrayLike, values: ArrayLike) -> Power:
    """Power that values grow with and its error, of four sizes or more."""
    line, covariance = np.polyfit(np.log(sizes), np.log(values), 1, cov=True)
    variance = covariance[0, 0]
    return Power(float(line[0]), float(np.sqrt(variance)))
