"""View factors between patches of several bodies, by global lines through the scene.

Along every line of a view, surfaces follow each other in the order of their depth
layers. Where the line leaves one surface and enters the next, the two see each other
along it, in both directions, and its first and last surface see the surroundings. So

    A_i F_ij = integral over directions of dw/pi, over the lines of dA, of [i sees j],

with as many views as directions, no lines of its own for any patch, symmetric by
construction, and obstacles are found by the same sort that orders the layers. Source:
the global lines of Sbert, Comput. Graph. Forum 12(3) (1993).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...geometry.mesh import Pose
from ...raster.fragments import (
    MIN_CAPACITY,
    DepthLayers,
    peel,
    shared_capacities,
)
from ...raster.views import (
    OrthographicView,
    cap_directions,
    half_sphere_directions,
    orthographic_view,
)
from .patches import Patches


class PatchedBody(NamedTuple):
    """Body with the patches of its surface."""

    triangles: Float[np.ndarray, "f 3 3"]
    """World [m], counter-clockwise seen from outside."""
    patches: Patches
    pose: Pose = Pose()


class _Scene(NamedTuple):
    triangles: Float[np.ndarray, "f 3 3"]
    normal: Float[np.ndarray, "f 3"]
    body: Int[np.ndarray, " f"]
    first: Int[np.ndarray, " b"]
    """Index of each body's first patch among all patches."""
    count: int


def _concatenated(bodies: tuple[PatchedBody, ...]) -> _Scene:
    triangles = np.concatenate([body.triangles for body in bodies])
    a, b, c = np.moveaxis(triangles, 1, 0)
    counts = [body.patches.count for body in bodies]
    return _Scene(
        triangles,
        np.cross(b - a, c - a),
        np.repeat(np.arange(len(bodies)), [len(body.triangles) for body in bodies]),
        np.cumsum([0, *counts[:-1]]),
        sum(counts),
    )


# Steps of a low-discrepancy sequence in the unit square: 1/g, 1/g^2 with g^3 = g + 1.
_SEQUENCE_STEP = np.array([0.7548776662466927, 0.5698402909980532])


def _views(
    points: Float[np.ndarray, "*n 3"],
    directions: Float[np.ndarray, "d 3"],
    pixel: float,
) -> Iterator[OrthographicView]:
    """View along each direction, displaced by a fraction of a pixel."""
    # A view centred on the scene would count half a pixel too much on average.
    for index, direction in enumerate(directions):
        view = orthographic_view(points, direction, pixel)
        shift = np.append((index * _SEQUENCE_STEP) % 1.0 - 0.5, 0.0) * pixel
        yield replace(view, corner=view.corner + shift)


def _hits(bodies, scene: _Scene, view: OrthographicView, layers: DepthLayers):
    """Patch of each fragment of the view."""
    row, column = np.divmod(layers.pixel, view.width)
    seen = np.stack([column + 0.5, row + 0.5, layers.depth], axis=1)
    point = (seen * view.pitch + view.corner) @ view.frame
    body = scene.body[layers.triangle]
    patch = np.zeros(len(point), int)
    for number, patched in enumerate(bodies):
        hits = np.flatnonzero(body == number)
        normal = scene.normal[layers.triangle[hits]]
        local = patched.pose.to_body(point[hits]), patched.pose.rotate_back(normal)
        patch[hits] = scene.first[number] + patched.patches.patch_of(*local)
    return patch


def _count_lines(
    bodies, scene: _Scene, view: OrthographicView, room: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Lines between each pair of patches and to the surroundings; array capacities."""
    corners = view.project(scene.triangles)
    room = shared_capacities(corners, view.width, view.height, room)
    with jax.ensure_compile_time_eval():
        layers = peel(corners, view.width, view.height, room)
    patch = _hits(bodies, scene, view, layers)
    same = layers.pixel[1:] == layers.pixel[:-1]
    enters = layers.entering
    # Consecutive fragments of a line face each other across empty space where the first
    # is left and the second entered.
    open_gap: Bool[np.ndarray, " g"] = same & ~enters[:-1] & enters[1:]
    first, last = np.append(True, ~same), np.append(~same, True)
    numbers = patch[:-1][open_gap] * scene.count + patch[1:][open_gap]
    pairs = np.bincount(numbers, minlength=scene.count**2)
    ends = np.concatenate([patch[first & enters], patch[last & ~enters]])
    pairs = pairs.reshape(scene.count, scene.count)
    return pairs, np.bincount(ends, minlength=scene.count), room


def _sample_all_directions(
    bodies: tuple[PatchedBody, ...], directions: int, pixel: float
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """A_i F_ij between patches and to the surroundings [m^2], from all directions."""
    # A line counts both ways: half of the directions, of an odd number one more.
    scene = _concatenated(bodies)
    between, outside = np.zeros((scene.count, scene.count)), np.zeros(scene.count)
    room, half = (MIN_CAPACITY, MIN_CAPACITY), (directions + 1) // 2
    weight = 2 / half * pixel * pixel
    for view in _views(scene.triangles, half_sphere_directions(half), pixel):
        pairs, ends, room = _count_lines(bodies, scene, view, room)
        between += weight * pairs
        outside += weight * ends
    return between + between.T, outside


def _cone(
    first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"], pose: Pose
) -> tuple[np.ndarray, float]:
    """Axis and smallest cosine of the cone of directions from one box to another."""
    # The boxes are aligned with the axes of `pose`.
    ends = [pose.rotate_back(points) for points in (first, second)]
    low, high = ends[1].min(0) - ends[0].max(0), ends[1].max(0) - ends[0].min(0)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T == 1, high, low)
    axis = (low + high) / 2
    length = np.linalg.norm(corners, axis=1) * np.linalg.norm(axis)
    cosines = corners @ axis / np.where(length > 0, length, 1.0)
    return pose.rotate(axis), float(cosines.min())


def _sample_pair(
    bodies: tuple[PatchedBody, ...], pair: tuple[int, int], directions: int, lines: int
) -> Float[np.ndarray, "p p"] | None:
    """Exchange areas of two bodies, from the cone of directions between them.

    All lines go from one body to the other, however far apart they are; `lines` of them
    across the smaller one. None if no pair of boxes around the bodies, along the
    world's axes or those of either body, is separate.
    """
    first, second = (bodies[number].triangles.reshape(-1, 3) for number in pair)
    poses = [Pose(), *(bodies[number].pose for number in pair)]
    cones = [_cone(first, second, pose) for pose in poses]
    axis, min_cosine = max(cones, key=lambda cone: cone[1])
    if min_cosine <= 0:
        return None
    scene = _concatenated(bodies)
    extent = lambda points: float(np.ptp(points, axis=0).max())
    small = min(first, second, key=extent)
    pixel = extent(small) / lines
    between = np.zeros((scene.count, scene.count))
    room = (MIN_CAPACITY, MIN_CAPACITY)
    weight = 2 * (1 - min_cosine) / directions * pixel * pixel
    spans = [
        slice(scene.first[n], scene.first[n] + bodies[n].patches.count) for n in pair
    ]
    for view in _views(small, cap_directions(axis, min_cosine, directions), pixel):
        pairs, _, room = _count_lines(bodies, scene, view, room)
        between += weight * pairs
    only = np.zeros_like(between)
    only[spans[0], spans[1]] = between[spans[0], spans[1]]
    return only + only.T


DEFAULT_DIRECTIONS = 128
"""Views of the scene from all directions, and as many between each pair of bodies."""

DEFAULT_LINES = 64
"""Lines across the largest extent of the scene, or of the smaller body of a pair."""

_MAX_SCALINGS = 200


class ViewFactors(NamedTuple):
    """View factors of the patches of all bodies, concatenated."""

    area: Float[np.ndarray, " p"]
    """[m^2]"""
    between: Float[np.ndarray, "p p"]
    """A_i F_ij, symmetric [m^2]."""
    outside: Float[np.ndarray, " p"]
    """A_i F_i,surroundings [m^2]."""

    @property
    def factor(self) -> Float[np.ndarray, "p p"]:
        """View factor F_ij [-]: fraction of emission of patch i that hits patch j."""
        return self.between / self.area[:, None]

    @property
    def to_surroundings(self) -> Float[np.ndarray, " p"]:
        """View factor of each patch to the surroundings [-]."""
        return self.outside / self.area


def view_factors(
    bodies: tuple[PatchedBody, ...],
    directions: int = DEFAULT_DIRECTIONS,
    lines: int = DEFAULT_LINES,
) -> ViewFactors:
    """View factors between the patches of any number of bodies of any shape.

    `directions` views of the scene, and of each pair of bodies, have `lines` lines
    across the largest extent of the scene or the smaller body. All bodies are
    obstacles.

    Raises:
        InputError: for fewer than 8 directions or lines.
    """
    if directions < 8 or lines < 8:
        raise InputError(
            f"view factors: directions={directions}, lines={lines}; "
            "give 8 or more of both"
        )
    extent = max(float(np.ptp(b.triangles.reshape(-1, 3), 0).max()) for b in bodies)
    area = np.concatenate([body.patches.area for body in bodies])
    found = _balance(*_sample_all_directions(bodies, directions, extent / lines), area)
    for first in range(len(bodies)):
        for second in range(first + 1, len(bodies)):
            seen = _sample_pair(bodies, (first, second), directions, lines)
            if seen is not None:
                found = _replaced(found, seen, bodies, (first, second))
    return found


def _replaced(found: ViewFactors, seen, bodies, pair: tuple[int, int]) -> ViewFactors:
    """View factors with better samples of one pair of bodies."""
    counts = [body.patches.count for body in bodies]
    number = np.repeat(np.arange(len(bodies)), counts)
    a, b = number == pair[0], number == pair[1]
    between = np.where((a[:, None] & b) | (b[:, None] & a), seen, found.between)
    # The surroundings take the difference, so that the rows keep their sums.
    outside = found.outside + (found.between - between).sum(1)
    return _balance(between, np.maximum(outside, 0.0), found.area)


def _balance(
    between: Float[np.ndarray, "p p"],
    outside: Float[np.ndarray, " p"],
    area: Float[np.ndarray, " p"],
) -> ViewFactors:
    """View factors from sampled areas A_i F_ij, scaled to the patches [m^2]."""
    # The scaling A_i F_ij -> d_i A_i F_ij d_j is symmetric: an F_ij of zero stays zero,
    # and a closed cavity stays closed. The remaining rounding error goes to the patch's
    # own F_ii, which exchanges nothing.
    # A patch that no line has hit sees the surroundings.
    outside = np.where(between.sum(1) + outside > 0, outside, area)
    scale = np.ones(len(area))
    for _ in range(_MAX_SCALINGS):
        row = scale * (between @ scale + outside)
        # The square root keeps the two ends of a pair from overcorrecting each other.
        scale = scale * np.sqrt(area / row)
        if np.abs(row - area).max() <= 1e-13 * area.max():
            break
    between = between * np.outer(scale, scale)
    outside = scale * outside
    between[np.diag_indices(len(area))] += area - between.sum(1) - outside
    return ViewFactors(area, between, outside)
