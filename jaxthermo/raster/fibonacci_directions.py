"""Directions spread evenly, the same ones every time: a Fibonacci spiral.

The heights are equally spaced, which is uniform on a sphere, and each point is turned
by the golden angle against the one before.
Source: Swinbank and Purser, Q. J. R. Meteorol. Soc. 132 (2006) 1769.
"""

import numpy as np
from jaxtyping import Float

from .directions import view_frame


GOLDEN_ANGLE = float(np.pi * (3.0 - np.sqrt(5.0)))
"""[rad]"""


def cap_directions(
    axis: object, least_cosine: float, count: int
) -> Float[np.ndarray, "d 3"]:
    """Unit vectors within an angle of `axis`, each for the same solid angle.

    Args:
        axis: the middle of the cap.
        least_cosine: of the angle to the axis, at the rim.
        count: how many.

    Raises:
        InputError: if the axis is no direction.
    """
    index = np.arange(count)
    height = 1.0 - (1.0 - least_cosine) * (index + 0.5) / count
    radius = np.sqrt(np.maximum(0.0, 1.0 - height * height))
    turn = GOLDEN_ANGLE * index
    own = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    return own @ view_frame(axis)


def half_sphere_directions(count: int) -> Float[np.ndarray, "d 3"]:
    """Unit vectors with z > 0 that stand, with their opposites, for all directions."""
    return cap_directions((0.0, 0.0, 1.0), 0.0, count)
