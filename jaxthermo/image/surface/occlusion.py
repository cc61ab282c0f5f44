"""Screen-space ambient occlusion: fast, but only of surfaces in the image.

Each pixel has a few slices, planes that contain the line of sight. In a slice the
hemisphere of the surface is limited on both sides by the highest horizon in the depth
image, at the angles h_1 < 0 < h_2 from the direction to the eye. The visible fraction
of the cosine-weighted slice is

    a = 1/4 sum_i [cos g - cos(2 h_i - g) + 2 h_i sin g]

with g the angle of the normal projected to the slice; the length of the projection is
the weight of the slice. Source: Jimenez et al., Practical real-time strategies for
accurate indirect occlusion, SIGGRAPH courses (2016).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...geometry.vectors import row_dot, unit_vectors
from .abstract_camera import AbstractCamera


_SLICES = 8
# Steps on either side of a slice, denser near the pixel.
_STEPS = 12
# Rows of a block: their data stays in the cache.
_ROWS = 16


class _Sight(NamedTuple):
    """Geometry of the pixels."""

    point: Float[np.ndarray, "h w 3"]
    """Visible point [m]; NaN in the background."""
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
) -> Float[np.ndarray, "h w"]:
    """Visible fraction of the cosine-weighted hemisphere; 1 in the background.

    Args:
        depth: along the optical axis, inf in the background [m].
        normal: outward normal in the world.
        camera: of the image.
        radius: largest distance of occluders [m].

    Raises:
        InputError: if the radius is not positive or the image not the camera's.
    """
    if depth.shape != camera.size[::-1]:
        raise InputError(
            f"screen_space_occlusion: the image is {depth.shape[1]} x "
            f"{depth.shape[0]} pixels and the camera's {camera.size}: give its own"
        )
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"screen_space_occlusion(radius={radius!r}): give metres")
    hit = np.isfinite(depth)
    if not hit.any():
        return np.ones(depth.shape)
    box = _bounds(hit)
    fractions = np.ones(depth.shape)
    hit = hit[box]
    normal = normal[box]
    sight = _sight(depth, camera, box)
    middle = float(np.median(sight.pixel[hit]))
    # The same shifts [pixels] for all pixels, which makes them array operations; points
    # beyond the radius are excluded one by one in `_horizon`.
    shift = radius / middle * (np.arange(1, _STEPS + 1) / _STEPS) ** 1.5
    open_part = np.zeros(hit.shape)
    hemisphere = np.zeros(hit.shape)
    for turn in np.pi * (np.arange(_SLICES) + 0.5) / _SLICES:
        direction = np.array([np.cos(turn), np.sin(turn)])
        side = _across(direction @ sight.axes, sight.back)
        length, angle = _tilt(normal, sight.back, side)
        flat = np.cos(angle)[..., None] * side - np.sin(angle)[..., None] * sight.back
        upright = normal / np.maximum(length, 1e-9)[..., None]
        for sign in (-1, 1):
            shifts = np.rint(sign * shift[:, None] * direction).astype(int)
            shifts = np.unique(shifts, axis=0)
            rise = _horizon(
                sight.point,
                shifts=shifts,
                upright=upright,
                flat=sign * flat,
                radius=radius,
            )
            open_part += length * _arc(angle + sign * (np.pi / 2 - rise), angle)
        hemisphere += length * (np.cos(angle) + angle * np.sin(angle))
    fraction = open_part / np.where(hemisphere > 0, hemisphere, 1.0)
    fractions[box] = np.where(hit, np.clip(fraction, 0.0, 1.0), 1.0)
    return fractions


def _bounds(hit: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns outside of which nothing is hit."""
    rows, columns = (np.flatnonzero(hit.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _sight(
    depth: np.ndarray, camera: AbstractCamera, box: tuple[slice, slice]
) -> _Sight:
    height, width = depth.shape
    origin, direction = camera.rays()
    ahead = np.where(np.isfinite(depth), depth, np.nan).reshape(-1, 1)
    back = -unit_vectors(direction)
    axes, size = _axes(camera)
    return _Sight(
        point=(origin + direction * ahead).reshape(height, width, 3)[box],
        back=back.reshape(height, width, 3)[box],
        axes=axes,
        pixel=size(depth[box]),
    )


def _axes(camera: AbstractCamera):
    # To the right and down. Twice as many pixels, since an image may have only one. In
    # the middle, where a lens distorts least.
    fine = camera.finer(2)
    width, height = fine.size
    middle = width * (height // 2 - 1) + width // 2 - 1
    corner = middle + np.array([0, 1, width])
    spans = []
    depths = []
    for key in (-1.0, -0.5):
        point, depth = fine.points(corner, np.full(3, key))
        spans.append(2 * (point[1:] - point[0]))
        depths.append(depth[0])
    near, far = (float(np.linalg.norm(span[0])) for span in spans)
    grows = (far - near) / (depths[1] - depths[0])
    return unit_vectors(spans[0]), lambda depth: near + grows * (depth - depths[0])


def _across(along: np.ndarray, back: np.ndarray) -> np.ndarray:
    return unit_vectors(along - (back @ along)[..., None] * back)


def _tilt(normal: np.ndarray, back: np.ndarray, side: np.ndarray):
    # The length of the projected normal and its angle to the direction to the eye; a
    # normal that points away is taken for tangential.
    ahead = row_dot(normal, back)
    sideways = row_dot(normal, side)
    return np.hypot(ahead, sideways), np.arctan2(sideways, np.maximum(ahead, 0.0))


def _horizon(
    point: np.ndarray,
    shifts: np.ndarray,
    upright: np.ndarray,
    flat: np.ndarray,
    radius: float,
) -> np.ndarray:
    # Measured along the slice: neighbours on the same plane have angle 0.
    height, width = point.shape[:2]
    # Planes x, y, z, along which memory is contiguous.
    planes = (np.moveaxis(vectors, -1, 0) for vectors in (point, upright, flat))
    point, upright, flat = map(np.ascontiguousarray, planes)
    # Horizons are compared by cosine: one arccos at the end.
    smallest = np.ones((height, width))
    for top in range(0, height, _ROWS):
        for right, down in shifts[shifts.any(1)].tolist():
            rows = _overlap(height, shift=down, start=top, stop=top + _ROWS)
            columns = _overlap(width, shift=right, start=0, stop=width)
            base = (rows[0], columns[0])
            shifted = (rows[1], columns[1])
            x, y, z = (plane[shifted] - plane[base] for plane in point)
            rise, run = (
                a[base] * x + b[base] * y + c[base] * z for a, b, c in (upright, flat)
            )
            stands = (x * x + y * y + z * z <= radius * radius) & (rise > 0)
            cosine = run / np.sqrt(np.where(stands, run * run + rise * rise, 1.0))
            np.minimum(smallest[base], cosine, out=smallest[base], where=stands)
    return np.arccos(np.clip(smallest, -1.0, 1.0))


def _overlap(size: int, shift: int, start: int, stop: int) -> tuple[slice, slice]:
    """Rows or columns from `start` to `stop`, and those that are `shift` farther on."""
    low = max(start, -shift)
    high = min(stop, size, size - shift)
    high = max(low, high)
    return slice(low, high), slice(low + shift, high + shift)


def _arc(end: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return (np.cos(angle) - np.cos(2 * end - angle) + 2 * end * np.sin(angle)) / 4
