"""View of sky and ground from surface points behind obstacles, by depth maps.

Ambient occlusion: the view factor to the surroundings,

    F = 1/pi integral of v(w) max(0, n . w) dw,

over all directions w, with v = 1 where nothing obstructs the view, in two parts: the
sky above the horizon and the ground below it. Without obstacles F_sky = (1 + n_z) / 2
and F_ground = (1 - n_z) / 2.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ...arrays import linear_map
from ...errors import InputError
from ...geometry.vectors import row_dot
from ...memo.found import found
from ...memo.stored import stored_search
from ...parallel.threads import in_threads
from ...raster.bounding_spheres import BoundingSpheres
from ...raster.depth_buffer import depth_range
from ...raster.views import (
    OrthographicView,
    fitted_view,
    half_sphere_directions,
    pixels_at,
    view_frame,
)
from ..surface import BodySurface
from .free_lines import free_lines
from .shadows import SquareEdge
from .window import window_of


_MARGIN = 2.0
"""Voxels, or pixels, up to which an occluder beside lines of sight may block them."""

DEFAULT_DIRECTIONS = 128
"""Directions over the whole sphere; half as many depth maps."""

_MIN_DIRECTIONS = 8

# Pixel of a depth map, in voxels.
_PIXEL = 1.0

# Tolerance of depths for surfaces that are not quite flat, in pixels.
_DEPTH_TOLERANCE = 0.1

# Largest correction of a point's depth to the middle of its pixel, in pixels. Only rays
# within 7 degrees of the surface need more; they count as unknown.
_MAX_DEPTH_CORRECTION = 6.0


class _SkyView(NamedTuple):
    """View factors to sky and ground [-]; their sum is 1 without obstacles."""

    sky: Float[np.ndarray, " s"]
    ground: Float[np.ndarray, " s"]


def unobstructed_view(normal: Float[np.ndarray, "s 3"]) -> _SkyView:
    """View factors without obstacles: (1 + n_z) / 2 and (1 - n_z) / 2."""
    up = np.clip(normal[:, 2], -1.0, 1.0)
    return _SkyView((1 + up) / 2, (1 - up) / 2)


def check_directions(directions: int) -> None:
    """Raise an InputError unless this is a whole number of at least 8."""
    if not isinstance(directions, int) or directions < _MIN_DIRECTIONS:
        raise InputError(
            f"occlusion={directions!r}: give {_MIN_DIRECTIONS} directions or more, "
            f"such as {DEFAULT_DIRECTIONS}"
        )


@stored_search("sky_view")
def lines_to_surroundings(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
    directions: int = DEFAULT_DIRECTIONS,
) -> UInt8[np.ndarray, "d s"]:
    """Directions in which nothing hides sky or ground from surface points, one a bit.

    Arguments are those of `sky_view`.
    """
    upward = half_sphere_directions((directions + 1) // 2)
    is_free = np.ones((len(upward), len(position)), bool)
    pixel = _PIXEL * float(np.max(pitch))
    # All directions point upward: the sky is half 0, the opposite directions half 1,
    # the ground. The first depth layer of a map shows the points that are visible from
    # one side, the last layer those from the other: one map for two directions.
    may_meet = BoundingSpheres.of(triangles).meet(position, upward, _MARGIN * pixel)
    numbers = np.flatnonzero(may_meet).tolist()

    def sees_out(number: int) -> Bool[np.ndarray, " s"]:
        view, at = fitted_view(position, view_frame(upward[number]), pixel)
        return _sees_out(view, at, triangles, normal)

    for number, is_free_along in zip(
        numbers, in_threads(sees_out, numbers), strict=True
    ):
        is_free[number] = is_free_along
    return np.packbits(is_free, axis=0)


def certain_lines(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
    directions: int,
) -> UInt8[np.ndarray, "d s"]:
    """Lines of `lines_to_surroundings` about which depth maps are certain, as bits."""
    pixel = _PIXEL * float(np.max(pitch))
    is_certain = []
    for upward in half_sphere_directions((directions + 1) // 2):
        deeper = _deeper(*fitted_view(position, view_frame(upward), pixel), normal)
        is_certain.append(np.abs(deeper) <= _MAX_DEPTH_CORRECTION)
    return np.packbits(is_certain, axis=0)


def sky_view_along(
    free: UInt8[np.ndarray, "d s"],
    certain: UInt8[np.ndarray, "d s"],
    normal: Float[np.ndarray, "s 3"],
    directions: int,
) -> _SkyView:
    """View factors from the lines of `lines_to_surroundings` and `certain_lines`."""
    seen = np.zeros((2, len(normal)))
    sampled = np.zeros((2, len(normal)))
    points = np.arange(len(normal))
    for number, upward in enumerate(half_sphere_directions((directions + 1) // 2)):
        bit = 7 - number % 8
        cosine = normal @ upward
        half = (cosine <= 0).astype(int)
        weight = np.abs(cosine) * (certain[number // 8] >> bit & 1)
        seen[half, points] += weight * (free[number // 8] >> bit & 1)
        sampled[half, points] += weight
    return _scaled(seen, sampled, unobstructed_view(normal))


def sky_view(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
    directions: int = DEFAULT_DIRECTIONS,
) -> _SkyView:
    """View factors of surface points to sky and ground behind obstacles.

    Triangles and points are in the world [m]; `pitch` is the edge of a voxel and of a
    pixel [m], or one for each point, whose largest is that of a pixel. An odd number of
    directions over the whole sphere counts as one more.

    Raises:
        InputError: for fewer than 8 directions.
    """
    check_directions(directions)
    free = lines_to_surroundings(triangles, position, normal, pitch, directions)
    certain = certain_lines(position, normal, pitch, directions)
    return sky_view_along(free, certain, normal, directions)


def sky_view_of(body: BodySurface, directions: int | None) -> _SkyView:
    """View factors of a body's fragments to sky and ground, computed once.

    Obstacles are detected in a number of directions; None is for none.
    """
    if directions is None:
        return unobstructed_view(body.normal)
    check_directions(directions)
    edge = body.grid.fragment_edge

    def search(triangles, _):
        return [
            lines_to_surroundings(
                triangles, body.position, body.normal, edge, directions
            )
        ]

    (free,) = free_lines(
        [body],
        search,
        by=("sky_view", directions),
        task="view of sky and ground from",
        is_distant=True,
    )
    certain = found(
        (body.grid, body.normal),
        by=("certain lines", directions),
        find=lambda: certain_lines(body.position, body.normal, edge, directions),
    )
    return found(
        (free, certain, body.normal),
        by=("sky_view", directions),
        find=lambda: sky_view_along(free, certain, body.normal, directions),
    )


def _deeper(
    view: OrthographicView,
    at: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
) -> Float[np.ndarray, " s"]:
    """Depths of the planes of points in the middles of pixels, over theirs."""
    # They grow as rays graze the planes. Too far away they say nothing.
    tilt = linear_map(normal, view.frame.T)
    row, column = pixels_at(view, at)
    to_middle = np.stack([column, row], axis=1) + 0.5 - at[:, :2]
    steep = np.where(np.abs(tilt[:, 2]) > 1e-9, tilt[:, 2], 1e-9)
    return -row_dot(to_middle, tilt[:, :2]) / steep


def _sees_out(
    view: OrthographicView,
    at: Float[np.ndarray, "s 3"],
    triangles: Float[np.ndarray, "f 3 3"],
    normal: Float[np.ndarray, "s 3"],
) -> Bool[np.ndarray, " s"]:
    """Flag the points that triangles do not hide along a view, or against it."""
    deeper = _deeper(view, at, normal)
    is_ahead = normal @ view.frame[2] > 0
    above = at[:, 2] + deeper + _DEPTH_TOLERANCE
    below = at[:, 2] + deeper - _DEPTH_TOLERANCE
    is_free = np.ones(len(at), bool)
    window = window_of(
        view,
        triangles=triangles,
        at=at,
        is_behind=lambda low, high: np.where(is_ahead, above < high, below > low),
        task="a map",
    )
    if window is not None:
        points = window.points
        nearest, farthest = depth_range(
            window.corners,
            row=window.row,
            column=window.column,
            width=window.width,
            height=window.height,
        )
        is_free[points] = np.where(
            is_ahead[points], above[points] >= farthest, below[points] <= nearest
        )
    return is_free


def _scaled(seen: np.ndarray, sampled: np.ndarray, unobstructed: _SkyView) -> _SkyView:
    """Unobstructed view times the visible fraction of sky and ground."""
    # Only the visible fraction is sampled, in the same directions everywhere, so that
    # unobstructed surfaces have exactly the factors of the closed form. A sliver of sky
    # or ground without samples takes the fraction of both together.
    mean = seen.sum(0) / np.maximum(sampled.sum(0), 1e-30)
    has_samples = sampled > 0
    visible = np.where(has_samples, seen / np.where(has_samples, sampled, 1.0), mean)
    return _SkyView(unobstructed.sky * visible[0], unobstructed.ground * visible[1])
