"""Outlines in an image: where a surface ends or another one begins behind it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from ...geometry.vectors import row_dot
from ..surface.view import View


_MAX_STEP = 3.0
"""Largest depth of a pixel off its neighbour's plane, over the distance of their rays.

Beyond it the surface has a step between the pixels, and not only a slope.
"""
_MIN_COSINE = 0.15
"""Cosine between ray and normal below which a surface is seen edge-on."""


def outline_distance(view: View) -> Float[np.ndarray, "h w"]:
    """Distance from each pixel to the nearest outline [pixels]; 0 where no body is.

    A pixel near an outline shows another surface, or none, once the camera moves.
    """
    geometry = view.geometry_frames(float)
    origin, step = (rays.reshape(geometry.normal.shape) for rays in view.camera.rays())
    facing = np.abs(row_dot(geometry.normal, step))
    facing /= np.linalg.norm(step, axis=-1)
    outline = (geometry.object_id < 0) | (facing < _MIN_COSINE)
    image = _Planes(
        body=geometry.object_id,
        depth=geometry.depth,
        normal=geometry.normal,
        origin=origin,
        step=step,
    )
    for axis in (0, 1):
        low = [slice(None)] * 2
        high = [slice(None)] * 2
        low[axis] = slice(None, -1)
        high[axis] = slice(1, None)
        edge = _is_edge(image.at(tuple(low)), image.at(tuple(high)))
        outline[tuple(low)] |= edge
        outline[tuple(high)] |= edge
    return np.asarray(distance_transform_edt(~outline))


class _Planes(NamedTuple):
    """Surface points of pixels, and the rays that see them."""

    body: Int[np.ndarray, "_ _"]
    depth: Float[np.ndarray, "_ _"]
    normal: Float[np.ndarray, "_ _ 3"]
    origin: Float[np.ndarray, "_ _ 3"]
    """Points of the rays at depth 0 [m]."""
    step: Float[np.ndarray, "_ _ 3"]
    """Steps of the rays per metre of depth."""

    def at(self, window: tuple[slice, ...]) -> "_Planes":
        """Select the pixels in a window of rows and columns."""
        return _Planes(*(values[window] for values in self))


def _is_edge(first: _Planes, second: _Planes) -> Bool[np.ndarray, "_ _"]:
    """True for pairs that show two bodies, or a step in the surface of one."""
    with np.errstate(invalid="ignore", divide="ignore"):
        # A pixel without a body has no plane: its NaN is near nothing.
        near_first = _off_plane(first, second) <= _MAX_STEP
        near_second = _off_plane(second, first) <= _MAX_STEP
    return (first.body != second.body) | ~(near_first | near_second)


def _off_plane(pixels: _Planes, neighbours: _Planes) -> Float[np.ndarray, "_ _"]:
    """Depth of neighbours off the planes of pixels, over the distance of their rays."""
    depth = pixels.depth[..., None]
    point = pixels.origin + depth * pixels.step
    along_normal = row_dot(pixels.normal, point - neighbours.origin)
    expected = along_normal / row_dot(pixels.normal, neighbours.step)
    same_depth = neighbours.origin + depth * neighbours.step
    between = np.linalg.norm(same_depth - point, axis=-1)
    return np.abs(neighbours.depth - expected) / between
