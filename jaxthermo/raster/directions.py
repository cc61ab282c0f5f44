"""Directions: orthographic views along one and uniform samples of a cap."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .layers import DepthLayers, peel


def unit_vector(
    direction: object, argument: str = "direction"
) -> Float[np.ndarray, "3"]:
    """Scale `direction` to length one.

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
            f"{argument} {direction!r}: give three finite numbers, not all zero"
        )
    return vector / length


def view_frame(direction: object) -> Float[np.ndarray, "3 3"]:
    """Right, down and forward axes of a view along `direction`, as orthonormal rows."""
    forward = unit_vector(direction)
    # The axis least parallel to the view gives the most accurate cross product.
    helper = np.eye(3)[int(np.argmin(np.abs(forward)))]
    right = unit_vector(np.cross(forward, helper))
    return np.stack([right, np.cross(forward, right), forward])


@dataclass(frozen=True)
class OrthographicView:
    """Parallel rays along `frame[2]` through a pixel grid of spacing `pitch` [m]."""

    frame: Float[np.ndarray, "3 3"]
    corner: Float[np.ndarray, "3"]
    """Point of column 0, row 0, depth 0 in view axes [m]."""
    pitch: float
    width: int
    height: int

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform world points [m] to (column, row, depth) in pixels."""
        return (points @ self.frame.T - self.corner) / self.pitch

    def peel(self, triangles: Float[np.ndarray, "f 3 3"]) -> DepthLayers:
        """Depth layers of world triangles [m] in this view."""
        return peel(self.project(triangles), self.width, self.height)


def orthographic_view(
    points: Float[np.ndarray, "*n 3"], direction: object, pitch: float
) -> OrthographicView:
    """Smallest view along `direction` around all points, with a pixel of margin."""
    frame = view_frame(direction)
    rotated = points.reshape(-1, 3) @ frame.T
    low, high = rotated.min(0), rotated.max(0)
    size = np.maximum(np.ceil((high - low)[:2] / pitch).astype(int), 1) + 2
    corner = (low + high) / 2 - np.append(size, 0) * pitch / 2
    corner[2] = low[2]
    return OrthographicView(frame, corner, pitch, int(size[0]), int(size[1]))


# Successive points of a Fibonacci spiral are rotated by the golden angle [rad].
_GOLDEN_ANGLE = float(np.pi * (3.0 - np.sqrt(5.0)))


def cap_directions(
    axis: object, min_cosine: float, count: int
) -> Float[np.ndarray, "d 3"]:
    """Unit vectors within an angle of `axis`, each for the same solid angle.

    A Fibonacci spiral, the same at every call.

    Args:
        axis: centre of the cap.
        min_cosine: cosine of the angle between the axis and the rim [-].
        count: number of directions.

    Raises:
        InputError: if the axis is no direction.

    Source: Swinbank and Purser, Q. J. R. Meteorol. Soc. 132 (2006) 1769.
    """
    index = np.arange(count)
    # Equal steps in height are equal areas on a sphere (Archimedes).
    height = 1.0 - (1.0 - min_cosine) * (index + 0.5) / count
    radius = np.sqrt(np.maximum(0.0, 1.0 - height * height))
    angle = _GOLDEN_ANGLE * index
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return local @ view_frame(axis)


def half_sphere_directions(count: int) -> Float[np.ndarray, "d 3"]:
    """Unit vectors with z > 0; with their opposites they sample all directions."""
    return cap_directions((0.0, 0.0, 1.0), 0.0, count)
