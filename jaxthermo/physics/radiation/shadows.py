"""Shadows: which part of each square of a surface a source lights, by depth maps.

The first depth layer of the scene as the source sees it, at half a voxel a pixel or
finer. A fragment is sampled at four points of its square, each of which is lit if
nothing is in front of it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...geometry.vectors import row_dot, tangents
from ...memo.stored import stored_search
from ...parallel.threads import in_threads
from ...raster.views import (
    fitted_view,
    perspective_views,
    pixels_at,
    view_frame,
)
from .free_lines import Sight
from .window import check_map, window_of


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


class Squares(NamedTuple):
    """Squares that a surface consists of, about."""

    position: Float[np.ndarray, "s 3"]
    """Their centres [m]."""
    normal: Float[np.ndarray, "s 3"]
    """Outward unit normals."""
    edge: SquareEdge


def edges_of_points(edge: SquareEdge, points: Int[np.ndarray, " m"]) -> SquareEdge:
    """Edges of the squares of some of the points."""
    return edge[points] if isinstance(edge, np.ndarray) else edge


def _shadow_pixel(edge: SquareEdge) -> float:
    """Pixel of a shadow map [m]."""
    if isinstance(edge, np.ndarray):
        return _FINE_SHADOW_PIXEL * float(edge.max())
    return _SHADOW_PIXEL * edge


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
    surfaces: Sequence[Squares],
    direction: object,
) -> list[Sight]:
    """Samples of the squares of each surface that parallel rays hit, one a bit.

    Triangles cast the shadows, in the world [m], as the squares. A pixel of the map of
    a surface is half the edge of its squares, or an eighth of the largest one where
    each square has its own.
    """
    frame = view_frame(direction)

    def lit_of(squares: Squares) -> Sight:
        return _sunlit(triangles, *squares, frame=frame)

    return list(in_threads(lit_of, surfaces))


def _sunlit(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: SquareEdge,
    frame: Float[np.ndarray, "3 3"],
) -> Sight:
    """Samples of the squares of one surface that rays along a view hit, one a bit."""
    lit = np.zeros(len(position), np.uint8)
    facing = np.flatnonzero(normal @ frame[2] < 0)
    if not len(facing):
        return lit
    # The map covers only surfaces that may be lit: a vast ground costs nothing.
    view, _ = fitted_view(position[facing], frame, _shadow_pixel(pitch))
    raised = position[facing] + normal[facing] * _LIFT * view.pitch
    edge = edges_of_points(pitch, facing)
    at = view.project(_samples(raised, normal[facing], edge))
    is_lit = np.ones(len(at), bool)
    window = window_of(
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
        check_map(view.width, view.height, "a shadow map")
        seen = facing[in_view]
        size = view.pixel * view.project(position[seen])[:, 2]
        raised = position[seen] + normal[seen] * (_LIFT * size)[:, None]
        edge = edges_of_points(pitch, seen)
        at = view.project(_samples(raised, normal[seen], edge))
        row, column = pixels_at(view, at)
        lit[seen] = _lit_bits(at[:, 2] <= view.nearest(triangles, row, column))
    return lit
