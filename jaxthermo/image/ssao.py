"""Ambient occlusion from the depths of an image: fast, and blind to what is not in it.

Through each pixel a few slices are laid that hold the line of sight. In a slice the
surface's hemisphere is cut off on both sides by the highest thing that the depths show
there. At the angles h_1 < 0 < h_2 from the way to the eye, there remains

    a = 1/4 sum_i [cos g - cos(2 h_i - g) + 2 h_i sin g]

of the cosine-weighted slice, g being the angle of the normal's part in the slice. What
a slice counts for is the length of that part. Source: Jimenez et al., Practical
real-time strategies for accurate indirect occlusion, SIGGRAPH courses (2016).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .camera import AbstractCamera


SLICES = 8
STEPS = 12
"""On either side of a slice, closer together near the pixel."""


class _Sight(NamedTuple):
    """What the camera makes of its pixels."""

    point: Float[np.ndarray, "h w 3"]
    """What is seen [m]; NaN where nothing is."""
    back: Float[np.ndarray, "h w 3"]
    """Unit vectors to the eye."""
    axes: Float[np.ndarray, "2 3"]
    """Unit vectors to the right and down."""
    pixel: Float[np.ndarray, "h w"]
    """Size of a pixel at the depth of what it shows [m]."""


def screen_space_occlusion(
    depth: Float[np.ndarray, "h w"],
    normal: Float[np.ndarray, "h w 3"],
    camera: AbstractCamera,
    radius: float,
    *,
    slices: int = SLICES,
    steps: int = STEPS,
) -> Float[np.ndarray, "h w"]:
    """Share of the cosine-weighted hemisphere that is open; 1 in the background.

    Args:
        depth: along the optical axis, infinite where nothing is [m].
        normal: world, outward.
        camera: that the image was taken with.
        radius: how far away something may be to count [m].
        slices: through each pixel.
        steps: along either side of each.

    Raises:
        InputError: if the radius is not positive, or the image not the camera's.
    """
    if depth.shape != camera.size[::-1]:
        raise InputError(
            f"screen_space_occlusion: the image is {depth.shape[1]} x "
            f"{depth.shape[0]} pixels and the camera's {camera.size}: give its own"
        )
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"screen_space_occlusion(radius={radius!r}): give metres")
    seen = np.isfinite(depth)
    sight = _sight(depth, camera)
    middle = float(np.median(sight.pixel[seen])) if seen.any() else 1.0
    # In pixels, the same ones for all: what is then too far is left out one by one.
    reach = radius / middle * (np.arange(1, steps + 1) / steps) ** 1.5
    open_part, whole = np.zeros(depth.shape), np.zeros(depth.shape)
    for turn in np.pi * (np.arange(slices) + 0.5) / slices:
        way = np.array([np.cos(turn), np.sin(turn)])
        side = _across(way @ sight.axes, sight.back)
        length, angle = _tilt(normal, sight.back, side)
        flat = np.cos(angle)[..., None] * side - np.sin(angle)[..., None] * sight.back
        upright = normal / np.maximum(length, 1e-9)[..., None]
        for sign in (-1, 1):
            shifts = np.unique(np.rint(sign * reach[:, None] * way).astype(int), axis=0)
            rise = _horizon(sight.point, shifts, upright, sign * flat, radius)
            open_part += length * _arc(angle + sign * (np.pi / 2 - rise), angle)
        whole += length * (np.cos(angle) + angle * np.sin(angle))
    share = open_part / np.where(whole > 0, whole, 1.0)
    return np.where(seen, np.clip(share, 0.0, 1.0), 1.0)


def _sight(depth: np.ndarray, camera: AbstractCamera) -> _Sight:
    height, width = depth.shape
    number = np.arange(height * width)
    # Two points of each ray tell it, whatever the key means to this camera.
    a, at_a = camera.points(number, np.full(number.size, -1.0))
    b, at_b = camera.points(number, np.full(number.size, -0.5))
    way = (b - a) / (at_b - at_a)[:, None]
    ahead = np.where(np.isfinite(depth), depth, np.nan).reshape(-1, 1) - at_a[:, None]
    back = -way / np.linalg.norm(way, axis=1, keepdims=True)
    axes, size = _axes(camera)
    return _Sight(
        point=(a + way * ahead).reshape(height, width, 3),
        back=back.reshape(height, width, 3),
        axes=axes,
        pixel=size(depth),
    )


def _axes(camera: AbstractCamera):
    """Unit vectors to the right and down, and the size of a pixel at a depth [m]."""
    # Twice as many pixels, lest there be only one.
    fine = camera.finer(2)
    corner = np.array([0, 1, fine.size[0]])
    spans, depths = [], []
    for key in (-1.0, -0.5):
        point, depth = fine.points(corner, np.full(3, key))
        spans.append(2 * (point[1:] - point[0]))
        depths.append(depth[0])
    near, far = (float(np.linalg.norm(span[0])) for span in spans)
    grows = (far - near) / (depths[1] - depths[0])
    axes = spans[0] / np.linalg.norm(spans[0], axis=1, keepdims=True)
    return axes, lambda depth: near + grows * (depth - depths[0])


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("hwi,hwi->hw", a, b)


def _across(along: np.ndarray, back: np.ndarray) -> np.ndarray:
    """The unit vector in the slice that is square to the way back."""
    side = along - (back @ along)[..., None] * back
    return side / np.linalg.norm(side, axis=-1, keepdims=True)


def _tilt(normal: np.ndarray, back: np.ndarray, side: np.ndarray):
    """Length of the normal's part in the slice, and its angle from the way back."""
    ahead, beside = _dot(normal, back), _dot(normal, side)
    return np.hypot(ahead, beside), np.arctan2(beside, np.maximum(ahead, 0.0))


def _horizon(
    point: np.ndarray,
    shifts: np.ndarray,
    upright: np.ndarray,
    flat: np.ndarray,
    radius: float,
) -> np.ndarray:
    """Angle above the surface's own plane of the highest thing at these shifts.

    Measured along the slice: pixels a little beside it on the same plane have angle 0.
    """
    height, width = point.shape[:2]
    lowest = np.ones((height, width))
    for right, down in shifts[shifts.any(1)].tolist():
        here, there = _overlap(height, down), _overlap(width, right)
        own, other = (here[0], there[0]), (here[1], there[1])
        gap = point[other] - point[own]
        far = _dot(gap, gap)
        rise, run = _dot(gap, upright[own]), _dot(gap, flat[own])
        stands = (far <= radius * radius) & (rise > 0)
        cosine = run / np.sqrt(np.where(stands, run * run + rise * rise, 1.0))
        lowest[own] = np.minimum(lowest[own], np.where(stands, cosine, 1.0))
    return np.arccos(np.clip(lowest, -1.0, 1.0))


def _overlap(size: int, shift: int) -> tuple[slice, slice]:
    """Where an axis and the same one shifted overlap."""
    low, high = max(0, -shift), max(0, min(size, size - shift))
    low = min(low, high)
    return slice(low, high), slice(low + shift, high + shift)


def _arc(end: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return (np.cos(angle) - np.cos(2 * end - angle) + 2 * end * np.sin(angle)) / 4
