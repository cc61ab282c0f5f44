"""View frames: orthographic views along the lattice axes and along any direction."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .layers import DepthLayers, peel


def unit_vector(direction: object, what: str = "direction") -> Float[np.ndarray, "3"]:
    """`direction` scaled to length one.

    Raises:
        InputError: if it is not three finite numbers or has no length.
    """
    try:
        vector = np.asarray(direction, float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    length = np.linalg.norm(vector) if vector.shape == (3,) else 0.0
    if not np.isfinite(length) or length == 0.0:
        raise InputError(
            f"{what} {direction!r}: give three finite numbers, not all zero"
        )
    return vector / length


def view_frame(direction: object) -> Float[np.ndarray, "3 3"]:
    """Rows: right, down and forward axes of a view along `direction` (orthonormal)."""
    forward = unit_vector(direction)
    helper = np.eye(3)[int(np.argmin(np.abs(forward)))]
    right = unit_vector(np.cross(forward, helper))
    return np.stack([right, np.cross(forward, right), forward])


@dataclass(frozen=True)
class OrthographicView:
    """Parallel rays along `frame[2]` through a pixel grid of spacing `pitch` [m]."""

    frame: Float[np.ndarray, "3 3"]
    corner: Float[np.ndarray, "3"]
    """World point [m] in view axes that maps to column 0, row 0, depth 0."""
    pitch: float
    width: int
    height: int

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World points [m] as (column, row, depth in pixels)."""
        return (points @ self.frame.T - self.corner) / self.pitch

    def peel(self, triangles: Float[np.ndarray, "f 3 3"]) -> DepthLayers:
        """Depth layers of world triangles [m] in this view."""
        return peel(self.project(triangles), self.width, self.height)


def orthographic_view(
    points: Float[np.ndarray, "*n 3"], direction: object, pitch: float
) -> OrthographicView:
    """The view along `direction` that just holds all points, with a pixel to spare."""
    frame = view_frame(direction)
    seen = points.reshape(-1, 3) @ frame.T
    low, high = seen.min(0), seen.max(0)
    size = np.maximum(np.ceil((high - low)[:2] / pitch).astype(int), 1) + 2
    corner = (low + high) / 2 - np.append(size, 0) * pitch / 2
    corner[2] = low[2]
    return OrthographicView(frame, corner, pitch, int(size[0]), int(size[1]))


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
