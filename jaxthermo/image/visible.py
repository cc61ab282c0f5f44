"""Points of surfaces that a camera sees."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..errors import InputError
from ..geometry.mesh import winding_number
from ..raster.fragments import peel
from .camera import AbstractCamera


class VisiblePoints(NamedTuple):
    """The nearest point of a surface on the ray of each pixel that shows a body."""

    pixel: Int[np.ndarray, " p"]
    """Index of each pixel, rows first."""
    body: Int[np.ndarray, " p"]
    """Number of the body."""
    face: Int[np.ndarray, " p"]
    """Number of the triangle in its body."""
    position: Float[np.ndarray, "p 3"]
    """World [m]."""
    depth: Float[np.ndarray, " p"]
    """Depth along the optical axis [m]."""


def visible_points(
    bodies: tuple[Float[np.ndarray, "_ 3 3"], ...], camera: AbstractCamera
) -> VisiblePoints:
    """Find what the camera sees of bodies, each given by its triangles [m].

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    for index, triangles in enumerate(bodies):
        if abs(winding_number(triangles, np.asarray(camera.position, float))) > 0.5:
            raise InputError(
                f"camera: position {camera.position} is inside body {index}; "
                "move it out, or omit the camera for an automatic view"
            )
    corners, parent = camera.to_raster(np.concatenate(bodies))
    on_image = np.flatnonzero(_overlaps(corners, camera))
    layers = peel(corners[on_image], *camera.size)
    front = layers.layer == 0
    pixel, key = layers.pixel[front], layers.depth[front]
    if not len(pixel):
        raise InputError(
            f"camera: at {camera.position} it sees no body; "
            "turn it, or omit the camera for an automatic view"
        )
    hit = parent[on_image][layers.triangle[front]]
    first = np.cumsum([0, *(len(triangles) for triangles in bodies)])
    body = np.searchsorted(first, hit, side="right") - 1
    position, depth = camera.points(pixel, key)
    return VisiblePoints(pixel, body, hit - first[body], position, depth)


# Triangles whose bounding box overlaps the image: the others would cost rays.
def _overlaps(corners: np.ndarray, camera: AbstractCamera) -> Bool[np.ndarray, " k"]:
    inside = np.ones(len(corners), bool)
    # Corner by corner: numpy is slow at the minimum along an axis of length three.
    for axis, size in enumerate(camera.size):
        a, b, c = corners[..., axis].T
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        inside &= (high > 0) & (low < size)
    return inside
