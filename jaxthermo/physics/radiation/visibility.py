"""Shadow maps: which part of each fragment a source sees.

The scene's first depth layer as the source sees it, at half a voxel a pixel or finer. A
fragment is sampled at four points of its own square and at each is lit if nothing lies
in front of it. Samples are lifted off the surface along its normal by 3/4 of a pixel:
the depth of a plane varies by less than that across a pixel at any angle, so a surface
never shades itself, and a shadow is displaced by less than half a voxel as the source
sees it. In perspective the same holds with a pixel's size at the fragment's depth.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...memory import require_memory
from ...raster.directions import (
    OrthographicView,
    half_sphere_directions,
    orthographic_view,
    view_frame,
)
from ...raster.fragments import SMALLEST, shared_room
from ...raster.layers import depth_range
from ...raster.perspective import PerspectiveView, perspective_views


SAMPLE_RADIUS = 0.3
"""Distance of the four samples from the fragment's middle, in voxels."""

LIFT = 0.75
"""Along the normal, in pixels of the map; sqrt(1/2) would just do."""


def _tangents(normal: Float[np.ndarray, "s 3"]) -> tuple[np.ndarray, np.ndarray]:
    helper = np.eye(3)[np.abs(normal).argmin(1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first)


def _check_map(view: OrthographicView | PerspectiveView) -> None:
    require_memory(view.width * view.height * 16, "a shadow map", "use a coarser pitch")


def _lit_samples(
    view: OrthographicView | PerspectiveView,
    nearest: Float[np.ndarray, "h w"],
    raised: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of the samples around lifted points with nothing in front of them."""
    lit = np.zeros(len(raised))
    first, second = (t * SAMPLE_RADIUS * pitch for t in _tangents(normal))
    for offset in (first, -first, second, -second):
        sample = view.project(raised + offset)
        column = np.clip(sample[:, 0].astype(int), 0, view.width - 1)
        row = np.clip(sample[:, 1].astype(int), 0, view.height - 1)
        lit += 0.25 * (sample[:, 2] <= nearest[row, column])
    return lit


def lit_share(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    direction: object,
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of each surface point's square that parallel rays reach, 0 to 1.

    Args:
        triangles: everything that casts shadows, world [m].
        position: the points [m].
        normal: outward at them.
        direction: the way the rays travel.
        pitch: edge of the squares [m]; the map has half of it a pixel.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(normal @ view_frame(direction)[2] < 0)
    if not len(facing):
        return lit
    # Only as large as what may be lit: a vast ground beyond it costs nothing.
    view = orthographic_view(position[facing], direction, pitch / 2)
    _check_map(view)
    nearest, _ = depth_range(view.project(triangles), view.width, view.height)
    raised = position[facing] + normal[facing] * LIFT * view.pitch
    lit[facing] = _lit_samples(view, nearest, raised, normal[facing], pitch)
    return lit


def lit_share_from(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    eye: Float[np.ndarray, "3"],
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of each surface point's square that rays from one point reach, 0 to 1.

    Args:
        triangles: everything that casts shadows, world [m].
        position: the points [m].
        normal: outward at them.
        eye: where the rays come from [m].
        pitch: edge of the squares [m]; a pixel is half of it or less at each of them.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(np.einsum("ij,ij->i", normal, eye - position) > 0)
    if not len(facing):
        return lit
    for view, chosen in perspective_views(eye, position[facing], pitch / 2):
        _check_map(view)
        nearest = view.nearest(triangles)
        seen = facing[chosen]
        size = view.pixel * view.project(position[seen])[:, 2]
        raised = position[seen] + normal[seen] * (LIFT * size)[:, None]
        lit[seen] = _lit_samples(view, nearest, raised, normal[seen], pitch)
    return lit


# Ambient occlusion: how much of the surroundings each piece of surface sees.
#
# F = 1/pi integral of v(w) max(0, n . w) dw over all directions w, with v = 1 where
# nothing stands in the way: the view factor to the surroundings, in two parts, the sky
# above the horizon and the ground below it. Without obstacles F_sky = (1 + n_z) / 2 and
# F_ground = (1 - n_z) / 2; what obstacles leave of either is sampled in the same
# directions everywhere, so that free surfaces have exactly this.
#
# A view along a direction tells who sees that way by its first depth layer, and who
# sees the opposite way by its last: one map for two directions.


DIRECTIONS = 128
"""How many, by default; half as many maps."""

FEWEST = 8

PIXEL = 1.0
"""Of a map, in voxels."""


SLACK = 0.1
"""Of depths, in pixels, for surfaces that are not quite flat."""

FARTHEST = 6.0
"""How much deeper or nearer than a point its ray may be looked at, in pixels: more is
needed only of rays that make an angle of less than 7 degrees with the surface."""


class SkyView(NamedTuple):
    """View factors to the sky and to the ground; 1 in sum where nothing is near."""

    sky: Float[np.ndarray, " s"]
    ground: Float[np.ndarray, " s"]


def open_view(normal: Float[np.ndarray, "s 3"]) -> SkyView:
    """Of surfaces that nothing stands before: (1 + n_z) / 2 and (1 - n_z) / 2."""
    up = np.clip(normal[:, 2], -1.0, 1.0)
    return SkyView((1 + up) / 2, (1 - up) / 2)


def check_directions(directions: int) -> None:
    """Refuse too few to make a picture of.

    Raises:
        InputError: below 8, or for what is no whole number.
    """
    if not isinstance(directions, int) or directions < FEWEST:
        raise InputError(
            f"occlusion={directions!r}: give {FEWEST} directions or more, "
            f"such as {DIRECTIONS}"
        )


def sky_view(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: float,
    directions: int = DIRECTIONS,
) -> SkyView:
    """View factors of surface points to sky and ground past all triangles.

    Args:
        triangles: everything that may stand in the way, world [m].
        position: the points [m].
        normal: outward at them.
        pitch: edge of a voxel [m], and of a pixel.
        directions: how many, over the whole sphere; an odd one counts as one more.

    Raises:
        InputError: for fewer than 8 directions.
    """
    check_directions(directions)
    seen, all_of = np.zeros((2, len(position))), np.zeros((2, len(position)))
    sizes, each = (SMALLEST, SMALLEST), np.arange(len(position))
    # Upward all of them: the sky is half 0, their opposites are half 1, the ground.
    for upward in half_sphere_directions((directions + 1) // 2):
        view = orthographic_view(position, upward, PIXEL * pitch)
        require_memory(view.width * view.height * 16, "a map", "use a coarser pitch")
        corners = view.project(triangles)
        sizes = shared_room(corners, view.width, view.height, sizes)
        ends = depth_range(corners, view.width, view.height, sizes)
        cosine = normal @ upward
        free, known = _sees_out(view, ends, position, normal)
        half = (cosine <= 0).astype(int)
        weight = np.abs(cosine) * known
        seen[half, each] += weight * free
        all_of[half, each] += weight
    return _scaled(seen, all_of, open_view(normal))


def _sees_out(
    view: OrthographicView,
    ends: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
) -> tuple[np.ndarray, np.ndarray]:
    """Whether points see out, along the view or against it, and whether it is known.

    The ray through a pixel's middle meets a point's own plane beside the point, the
    farther the more it grazes the plane. Too far from it nothing is told.
    """
    at, tilt = view.project(position), normal @ view.frame.T
    column = np.clip(at[:, 0].astype(int), 0, view.width - 1)
    row = np.clip(at[:, 1].astype(int), 0, view.height - 1)
    nearest, farthest = (end[row, column] for end in ends)
    beside = np.stack([column, row], axis=1) + 0.5 - at[:, :2]
    steep = np.where(np.abs(tilt[:, 2]) > 1e-9, tilt[:, 2], 1e-9)
    deeper = -np.einsum("ij,ij->i", beside, tilt[:, :2]) / steep
    depth = at[:, 2] + deeper
    free = np.where(tilt[:, 2] > 0, depth + SLACK >= farthest, depth - SLACK <= nearest)
    return free, np.abs(deeper) <= FARTHEST


def _scaled(seen: np.ndarray, all_of: np.ndarray, free: SkyView) -> SkyView:
    """What is left of the free view, by half; of a sliver without samples as of all."""
    whole = seen.sum(0) / np.maximum(all_of.sum(0), 1e-30)
    sampled = all_of > 0
    share = np.where(sampled, seen / np.where(sampled, all_of, 1.0), whole)
    return SkyView(free.sky * share[0], free.ground * share[1])
