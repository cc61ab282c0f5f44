"""Visibility of sources and surroundings from surface points, by depth maps.

Shadows: the first depth layer of the scene as the source sees it, at half a voxel a
pixel or finer. A fragment is sampled at four points of its square, each of which is lit
if nothing is in front of it.

Ambient occlusion: the view factor to the surroundings,

    F = 1/pi integral of v(w) max(0, n . w) dw,

over all directions w, with v = 1 where nothing obstructs the view, in two parts: the
sky above the horizon and the ground below it. Without obstacles F_sky = (1 + n_z) / 2
and F_ground = (1 - n_z) / 2.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...arrays import linear_map
from ...errors import InputError
from ...geometry.vectors import row_dot, tangents
from ...host_memory import require_memory
from ...memo.stored import stored_search
from ...raster.depth_buffer import depth_range
from ...raster.views import (
    OrthographicView,
    PerspectiveView,
    half_sphere_directions,
    orthographic_view,
    perspective_views,
    pixels_at,
    view_frame,
)
from ..surface import BodySurface


# Distance of the four samples from the fragment's centre, over the edge of its square.
_SAMPLE_RADIUS = 0.3

# Pixel of a shadow map, over the edge of the squares: of voxels, and of thin walls.
# Walls are close to each other, and end where those behind them end: there a sample
# that is a pixel off is on the wrong side.
_SHADOW_PIXEL = 0.5
_FINE_SHADOW_PIXEL = 0.125

# Samples are lifted off the surface along its normal by this many pixels. The depth of
# a plane varies by less than sqrt(1/2) across a pixel at any angle, so a surface never
# shades itself, and a shadow is displaced by less than half a voxel as the source sees
# it. In perspective this holds with a pixel's size at the fragment's depth.
_LIFT = 0.75


SquareEdge = float | Float[np.ndarray, " _"]
"""Edge of the square that each point represents [m]: that of a voxel, or, of points on
thin walls, one for each point."""


def edges_of_points(edge: SquareEdge, points: Int[np.ndarray, " m"]) -> SquareEdge:
    """Edges of the squares of some of the points."""
    return edge[points] if isinstance(edge, np.ndarray) else edge


def _shadow_pixel(edge: SquareEdge) -> float:
    """Pixel of a shadow map [m]."""
    if isinstance(edge, np.ndarray):
        return _FINE_SHADOW_PIXEL * float(edge.max())
    return _SHADOW_PIXEL * edge


def _check_map(view: OrthographicView | PerspectiveView, task: str) -> None:
    require_memory(view.width * view.height * 16, task, "use a coarser pitch")


def _lit_samples(
    view: OrthographicView | PerspectiveView,
    nearest: Float[np.ndarray, "h w"],
    raised: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
) -> Float[np.ndarray, " s"]:
    """Fraction of the samples around lifted points with nothing in front of them."""
    lit = np.zeros(len(raised))
    radius = _SAMPLE_RADIUS * np.reshape(pitch, (-1, 1))
    first, second = (t * radius for t in tangents(normal))
    for offset in (first, -first, second, -second):
        sample = view.project(raised + offset)
        lit += 0.25 * (sample[:, 2] <= nearest[pixels_at(view, sample)])
    return lit


@stored_search("shadows")
def lit_fraction(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    direction: object,
    pitch: SquareEdge,
) -> Float[np.ndarray, " s"]:
    """Fraction of each surface point's square that parallel rays hit [-].

    Triangles cast the shadows; points and triangles are in the world [m]. The squares
    have the edge `pitch` [m], and a pixel of the map is half of it, or an eighth of the
    largest one where each point has its own.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(normal @ view_frame(direction)[2] < 0)
    if not len(facing):
        return lit
    # The map covers only surfaces that may be lit: a vast ground costs nothing.
    view = orthographic_view(position[facing], direction, _shadow_pixel(pitch))
    _check_map(view, "a shadow map")
    nearest, _ = depth_range(view.project(triangles), view.width, view.height)
    raised = position[facing] + normal[facing] * _LIFT * view.pitch
    lit[facing] = _lit_samples(
        view,
        nearest=nearest,
        raised=raised,
        normal=normal[facing],
        pitch=edges_of_points(pitch, facing),
    )
    return lit


@stored_search("point_shadows")
def lit_fraction_from_point(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    eye: Float[np.ndarray, "3"],
    pitch: SquareEdge,
) -> Float[np.ndarray, " s"]:
    """Fraction of each surface point's square that rays from `eye` [m] hit [-].

    Arguments and pixels are those of `lit_fraction`; at near points they are smaller.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(row_dot(normal, eye - position) > 0)
    if not len(facing):
        return lit
    pixel = _shadow_pixel(pitch)
    for view, in_view in perspective_views(eye, position[facing], pixel):
        _check_map(view, "a shadow map")
        nearest = view.nearest(triangles)
        seen = facing[in_view]
        size = view.pixel * view.project(position[seen])[:, 2]
        raised = position[seen] + normal[seen] * (_LIFT * size)[:, None]
        lit[seen] = _lit_samples(
            view,
            nearest=nearest,
            raised=raised,
            normal=normal[seen],
            pitch=edges_of_points(pitch, seen),
        )
    return lit


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


@stored_search("sky_view", (_SkyView,))
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
    seen = np.zeros((2, len(position)))
    sampled = np.zeros((2, len(position)))
    points = np.arange(len(position))
    # All directions point upward: the sky is half 0, the opposite directions half 1,
    # the ground. The first depth layer of a map shows the points that are visible from
    # one side, the last layer those from the other: one map for two directions.
    for upward in half_sphere_directions((directions + 1) // 2):
        view = orthographic_view(position, upward, _PIXEL * float(np.max(pitch)))
        _check_map(view, "a map")
        corners = view.project(triangles)
        ends = depth_range(corners, view.width, view.height)
        cosine = normal @ upward
        visible, certain = _sees_out(view, ends=ends, position=position, normal=normal)
        half = (cosine <= 0).astype(int)
        weight = np.abs(cosine) * certain
        seen[half, points] += weight * visible
        sampled[half, points] += weight
    return _scaled(seen, sampled, unobstructed_view(normal))


def sky_view_of(body: BodySurface, directions: int | None) -> _SkyView:
    """View factors of a body's fragments to sky and ground, computed once.

    Obstacles are detected in a number of directions; None is for none.
    """
    if directions is None:
        return unobstructed_view(body.normal)
    return body.searched(
        sky_view,
        by=("sky_view", directions),
        task="view of sky and ground from",
        directions=directions,
    )


def _sees_out(
    view: OrthographicView,
    ends: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
) -> tuple[np.ndarray, np.ndarray]:
    """Masks: the point is visible along or against the view; the answer is certain."""
    # The ray through a pixel's middle meets the plane of a point at a distance from the
    # point that grows as it grazes the plane. Too far away the depths say nothing.
    at = view.project(position)
    tilt = linear_map(normal, view.frame.T)
    row, column = pixels_at(view, at)
    nearest, farthest = (end[row, column] for end in ends)
    to_middle = np.stack([column, row], axis=1) + 0.5 - at[:, :2]
    steep = np.where(np.abs(tilt[:, 2]) > 1e-9, tilt[:, 2], 1e-9)
    deeper = -row_dot(to_middle, tilt[:, :2]) / steep
    depth = at[:, 2] + deeper
    visible = np.where(
        tilt[:, 2] > 0,
        depth + _DEPTH_TOLERANCE >= farthest,
        depth - _DEPTH_TOLERANCE <= nearest,
    )
    return visible, np.abs(deeper) <= _MAX_DEPTH_CORRECTION


def _scaled(seen: np.ndarray, sampled: np.ndarray, unobstructed: _SkyView) -> _SkyView:
    """Unobstructed view times the visible fraction of sky and ground."""
    # Only the visible fraction is sampled, in the same directions everywhere, so that
    # unobstructed surfaces have exactly the factors of the closed form. A sliver of sky
    # or ground without samples takes the fraction of both together.
    mean = seen.sum(0) / np.maximum(sampled.sum(0), 1e-30)
    has_samples = sampled > 0
    visible = np.where(has_samples, seen / np.where(has_samples, sampled, 1.0), mean)
    return _SkyView(unobstructed.sky * visible[0], unobstructed.ground * visible[1])
