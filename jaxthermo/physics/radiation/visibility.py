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

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ...arrays import linear_map
from ...errors import InputError
from ...geometry.vectors import row_dot, tangents, unit_vector
from ...host_memory import require_memory
from ...memo.found import found
from ...memo.stored import stored_search
from ...raster.bounding_spheres import BoundingSpheres
from ...raster.depth_buffer import depth_range, nearest_depth
from ...raster.views import (
    OrthographicView,
    fitted_view,
    half_sphere_directions,
    orthographic_view,
    perspective_views,
    pixels_at,
)
from ..surface import BodySurface
from .free_lines import Sight, free_lines


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


_MARGIN = 2.0
"""Voxels, or pixels, up to which an occluder beside lines of sight may block them."""


def edges_of_points(edge: SquareEdge, points: Int[np.ndarray, " m"]) -> SquareEdge:
    """Edges of the squares of some of the points."""
    return edge[points] if isinstance(edge, np.ndarray) else edge


def _shadow_pixel(edge: SquareEdge) -> float:
    """Pixel of a shadow map [m]."""
    if isinstance(edge, np.ndarray):
        return _FINE_SHADOW_PIXEL * float(edge.max())
    return _SHADOW_PIXEL * edge


_LARGE_MAP = 16_000_000
"""Size of a map from which the free memory is looked up, for each map [bytes]."""


def _check_map(width: int, height: int, task: str) -> None:
    size = width * height * 16
    if size > _LARGE_MAP:
        require_memory(size, task, "use a coarser pitch")


class _Window(NamedTuple):
    """The part of a view in which a point may be behind an occluder."""

    points: Int[np.ndarray, " n"]
    """Numbers of these points."""
    row: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    """Their pixels in the window."""
    corners: Float[np.ndarray, "f 3 3"]
    """Corners of the occluder (column, row, depth)."""
    width: int
    height: int

    def shades(self, depth: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Flag the points, at these depths, that the occluder is in front of."""
        # What begins behind all points shades none of them.
        ahead = self.corners[..., 2].min(axis=1) < depth.max()
        return depth > nearest_depth(
            self.corners[ahead],
            row=self.row,
            column=self.column,
            width=self.width,
            height=self.height,
        )


def _window(
    view: OrthographicView,
    triangles: Float[np.ndarray, "f 3 3"],
    at: Float[np.ndarray, "n 3"],
    is_behind: Callable[[float, float], Bool[np.ndarray, " n"]],
    task: str,
) -> _Window | None:
    """The window of points whose pixels the box around an occluder covers.

    Args:
        view: of all points.
        triangles: of the occluder [m].
        at: points, projected.
        is_behind: flags of the points, from the depths at which the occluder begins
            and ends.
        task: what the window is a part of.
    """
    row, column = pixels_at(view, at)
    spaces = view.half_spaces(
        low=np.array([column.min(), row.min()]),
        high=np.array([column.max() + 1, row.max() + 1]),
    )
    over = BoundingSpheres.of(triangles).reaching_into(spaces)
    if not len(over):
        return None
    corners = view.project(triangles[over])
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    points = np.flatnonzero(
        (column + 1 >= low[0])
        & (column <= high[0])
        & (row + 1 >= low[1])
        & (row <= high[1])
        & is_behind(low[2], high[2])
    )
    if not len(points):
        return None
    row = row[points]
    column = column[points]
    first = np.array([column.min(), row.min(), 0])
    width = int(column.max() - first[0]) + 1
    height = int(row.max() - first[1]) + 1
    _check_map(width, height, task)
    return _Window(
        points=points,
        row=row - first[1],
        column=column - first[0],
        # Whole pixels: the rays through the window are those of the view.
        corners=corners - first,
        width=width,
        height=height,
    )


_LIT = np.array([number.bit_count() / 4 for number in range(16)])
"""Lit fraction of four samples, by their bits [-]."""


def lit_fractions(sight: Sight) -> Float[np.ndarray, "*n s"]:
    """Fraction of the four samples of each point that are lit [-]."""
    return _LIT[sight]


def _samples(
    raised: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
) -> Float[np.ndarray, "n 3"]:
    """The first samples around all lifted points, then the second ones, of four."""
    radius = _SAMPLE_RADIUS * np.reshape(pitch, (-1, 1))
    first, second = (t * radius for t in tangents(normal))
    offsets = np.stack([first, -first, second, -second])
    return (raised + offsets).reshape(-1, 3)


def _lit_bits(is_lit: Bool[np.ndarray, " n"]) -> Sight:
    """Samples of each point, one a bit, from those in the order of `_samples`."""
    first, second, third, fourth = is_lit.reshape(4, -1).view(np.uint8)
    return first | second << 1 | third << 2 | fourth << 3


@stored_search("shadows")
def sunlit_samples(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    direction: object,
    pitch: SquareEdge,
) -> Sight:
    """Samples of each surface point's square that parallel rays hit, one a bit.

    Triangles cast the shadows; points and triangles are in the world [m]. The squares
    have the edge `pitch` [m], and a pixel of the map is half of it, or an eighth of the
    largest one where each point has its own.
    """
    lit = np.zeros(len(position), np.uint8)
    ahead = unit_vector(direction)
    facing = np.flatnonzero(normal @ ahead < 0)
    if not len(facing):
        return lit
    margin = _MARGIN * float(np.max(pitch))
    spheres = BoundingSpheres.of(triangles)
    if not spheres.meet(position[facing], ahead[None], margin):
        lit[facing] = len(_LIT) - 1
        return lit
    # The map covers only surfaces that may be lit: a vast ground costs nothing.
    view = orthographic_view(position[facing], direction, _shadow_pixel(pitch))
    raised = position[facing] + normal[facing] * _LIFT * view.pitch
    edge = edges_of_points(pitch, facing)
    at = view.project(_samples(raised, normal[facing], edge))
    is_lit = np.ones(len(at), bool)
    window = _window(
        view,
        triangles=triangles,
        at=at,
        is_behind=lambda nearest, _: at[:, 2] > nearest,
        task="a shadow map",
    )
    if window is not None:
        is_lit[window.points] = ~window.shades(at[window.points, 2])
    lit[facing] = _lit_bits(is_lit)
    return lit


@stored_search("point_shadows")
def lit_samples_from_point(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    eye: Float[np.ndarray, "3"],
    pitch: SquareEdge,
) -> Sight:
    """Samples of each surface point's square that rays from `eye` [m] hit, one a bit.

    Arguments and pixels are those of `sunlit_samples`; at near points they are smaller.
    """
    lit = np.zeros(len(position), np.uint8)
    facing = np.flatnonzero(row_dot(normal, eye - position) > 0)
    if not len(facing):
        return lit
    pixel = _shadow_pixel(pitch)
    for view, in_view in perspective_views(eye, position[facing], pixel):
        _check_map(view.width, view.height, "a shadow map")
        seen = facing[in_view]
        size = view.pixel * view.project(position[seen])[:, 2]
        raised = position[seen] + normal[seen] * (_LIFT * size)[:, None]
        edge = edges_of_points(pitch, seen)
        at = view.project(_samples(raised, normal[seen], edge))
        row, column = pixels_at(view, at)
        lit[seen] = _lit_bits(at[:, 2] <= view.nearest(triangles, row, column))
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
        view, at = fitted_view(position, upward[number], pixel)
        return _sees_out(view, at, triangles, normal)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for number, is_free_along in zip(
            numbers, pool.map(sees_out, numbers), strict=True
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
        deeper = _deeper(*fitted_view(position, upward, pixel), normal)
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
    free = free_lines(
        body,
        lines_to_surroundings,
        by=("sky_view", directions),
        task="view of sky and ground from",
        is_distant=True,
        directions=directions,
    )
    edge = body.grid.fragment_edge
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
    window = _window(
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
