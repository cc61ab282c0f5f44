"""Outlines in an image: where a surface ends, or one behind it begins."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt

from .view import View


# Depth between neighbours beyond the planes through both, over the distance between
# their rays: a step of a surface, not its slope.
_MAX_STEP = 3.0
# Cosine between ray and normal below which a surface is seen edge-on.
_MIN_COSINE = 0.15


def outline_distance(view: View) -> Float[np.ndarray, "h w"]:
    """Distance of each pixel to the nearest at an outline [pixels]; 0 without a body.

    Near an outline another pose of the camera shows another surface, or none.
    """
    width, height = view.camera.size
    shape = (height, width)
    origin, step = view.camera.rays()
    body = np.full(height * width, -1)
    depth, normal = np.full(height * width, np.inf), np.zeros((height * width, 3))
    body[view.pixel], depth[view.pixel] = view.body, view.depth
    normal[view.pixel] = view.normal
    facing = np.abs(np.einsum("pi,pi->p", normal, step))
    facing /= np.linalg.norm(step, axis=1)
    outline = ((body < 0) | (facing < _MIN_COSINE)).reshape(shape)
    given = body, depth, normal, origin, step
    fields = [each.reshape(*shape, *each.shape[1:]) for each in given]
    for axis in (0, 1):
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        one, other = (tuple(part) for part in (low, high))
        edge = _is_edge([f[one] for f in fields], [f[other] for f in fields])
        outline[one] |= edge
        outline[other] |= edge
    return np.asarray(distance_transform_edt(~outline))


def _is_edge(one: list[np.ndarray], other: list[np.ndarray]) -> Bool[np.ndarray, "_ _"]:
    """Neighbours of which neither lies near the other's plane, or one shows no body."""
    with np.errstate(invalid="ignore", divide="ignore"):
        away = _off_plane(one, other), _off_plane(other, one)
    # Without a body there is no plane, and nothing compares.
    near = np.logical_or(*(each <= _MAX_STEP for each in away))
    return (one[0] != other[0]) | ~near


def _off_plane(one: list[np.ndarray], other: list[np.ndarray]) -> np.ndarray:
    """Depth of the other point beyond the plane of the first, over their distance."""
    _, depth, normal, origin, step = one
    _, there, _, start, ahead = other
    point = origin + depth[..., None] * step
    dot = lambda a, b: np.einsum("...i,...i->...", a, b)
    expected = dot(normal, point - start) / dot(normal, ahead)
    between = np.linalg.norm(start + depth[..., None] * ahead - point, axis=-1)
    return np.abs(there - expected) / between
