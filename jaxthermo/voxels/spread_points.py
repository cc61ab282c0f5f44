"""Points in the voxels and pieces of surface that the border of a selection divides."""

import numpy as np
from jaxtyping import Float


_SAMPLES = 512
"""Number of points."""


def spread_points(dimensions: int) -> Float[np.ndarray, "p d"]:
    """Points that fill a unit cube evenly, also as seen along its edges.

    A sequence of low discrepancy: of a half space across an edge they tell the fraction
    to about 1 / 512. Source: Roberts (2018), "The unreasonable effectiveness of
    quasirandom sequences".
    """
    # The root of x^(d+1) = x + 1.
    root = 2.0
    for _ in range(50):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return (0.5 + np.arange(1, _SAMPLES + 1)[:, None] * steps) % 1
