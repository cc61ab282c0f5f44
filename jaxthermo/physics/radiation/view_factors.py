"""Which patches see each other: bundles of parallel lines through the whole scene.

Every ray of a view meets surfaces in the order of their depth layers. Where it leaves
one and enters the next, the two see each other along that line, both ways, and a line's
first and last surface see the surroundings. So

    A_i F_ij = integral over directions of dw/pi, over the rays of dA, of [i sees j],

with as many views as directions. It needs no ray of its own for any patch, is symmetric
by construction, and whatever stands between two patches is found by the same sort that
orders them. Source: the global lines of Sbert, Comput. Graph. Forum 12(3) (1993).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...geometry.pose import Pose
from ...raster.directions import (
    OrthographicView,
    cap_directions,
    half_sphere_directions,
    orthographic_view,
)
from ...raster.fragments import SMALLEST, padded, shared_room
from ...raster.layers import DepthLayers, peel
from .patches import Patches


class PatchedBody(NamedTuple):
    """A body whose surface is in patches."""

    triangles: Float[np.ndarray, "f 3 3"]
    """World [m], wound counter-clockwise seen from outside."""
    patches: Patches
    pose: Pose = Pose()


class Sight(NamedTuple):
    """Areas that patches see of each other, and of the surroundings [m^2]."""

    between: Float[np.ndarray, "p p"]
    """A_i F_ij = A_j F_ji, all bodies' patches one after the other."""
    outside: Float[np.ndarray, " p"]
    """A_i times the view factor to the surroundings."""


class _Scene(NamedTuple):
    triangles: Float[np.ndarray, "f 3 3"]
    normal: Float[np.ndarray, "f 3"]
    body: Int[np.ndarray, " f"]
    first: Int[np.ndarray, " b"]
    """Number of each body's first patch among all."""
    count: int


def _joined(bodies: tuple[PatchedBody, ...]) -> _Scene:
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


PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of an even sequence in the unit square: 1/g and 1/g^2 with g^3 = g + 1."""


def _views(
    points: Float[np.ndarray, "*n 3"],
    directions: Float[np.ndarray, "d 3"],
    pixel: float,
) -> Iterator[OrthographicView]:
    """A view each, its pixels displaced by a part of one.

    Centred on what it holds, a view would count half a pixel too much on average.
    """
    for index, direction in enumerate(directions):
        view = orthographic_view(points, direction, pixel)
        shift = np.append((index * PLASTIC) % 1.0 - 0.5, 0.0) * pixel
        yield replace(view, corner=view.corner + shift)


def _hits(bodies, scene: _Scene, view: OrthographicView, layers: DepthLayers):
    """The patch that each fragment of the view belongs to."""
    row, column = np.divmod(layers.pixel, view.width)
    seen = np.stack([column + 0.5, row + 0.5, layers.depth], axis=1)
    point = (seen * view.pitch + view.corner) @ view.frame
    body = scene.body[layers.triangle]
    patch = np.zeros(len(point), int)
    for number, one in enumerate(bodies):
        own = np.flatnonzero(body == number)
        normal = scene.normal[layers.triangle[own]]
        place = one.pose.unplace(point[own]), one.pose.unturn(normal)
        patch[own] = scene.first[number] + one.patches.of(*place)
    return patch


def _look(
    bodies, scene: _Scene, view: OrthographicView, room: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """How often which patches see each other, which the surroundings, and the room."""
    corners = view.project(scene.triangles)
    room = shared_room(corners, view.width, view.height, room)
    with jax.ensure_compile_time_eval():
        layers = peel(padded(corners), view.width, view.height, room)
    patch = _hits(bodies, scene, view, layers)
    same = layers.pixel[1:] == layers.pixel[:-1]
    enters = layers.entering
    open_gap: Bool[np.ndarray, " g"] = same & ~enters[:-1] & enters[1:]
    first, last = np.append(True, ~same), np.append(~same, True)
    numbers = patch[:-1][open_gap] * scene.count + patch[1:][open_gap]
    pairs = np.bincount(numbers, minlength=scene.count**2)
    ends = np.concatenate([patch[first & enters], patch[last & ~enters]])
    pairs = pairs.reshape(scene.count, scene.count)
    return pairs, np.bincount(ends, minlength=scene.count), room


def all_round(bodies: tuple[PatchedBody, ...], directions: int, pixel: float) -> Sight:
    """Everything that every patch sees, in directions over the whole sphere.

    Args:
        bodies: the scene.
        directions: how many; an odd one counts as one more.
        pixel: distance of the lines [m].
    """
    scene = _joined(bodies)
    between, outside = np.zeros((scene.count, scene.count)), np.zeros(scene.count)
    room, half = (SMALLEST, SMALLEST), (directions + 1) // 2
    weight = 2 / half * pixel * pixel
    for view in _views(scene.triangles, half_sphere_directions(half), pixel):
        pairs, ends, room = _look(bodies, scene, view, room)
        between += weight * pairs
        outside += weight * ends
    return Sight(between + between.T, outside)


def _cone(
    first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"], pose: Pose
) -> tuple[np.ndarray, float]:
    """Axis and least cosine of all that leads from the one's box to the other's.

    The boxes lie along the axes of `pose`.
    """
    ends = [pose.unturn(points) for points in (first, second)]
    low, high = ends[1].min(0) - ends[0].max(0), ends[1].max(0) - ends[0].min(0)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T == 1, high, low)
    axis = (low + high) / 2
    length = np.linalg.norm(corners, axis=1) * np.linalg.norm(axis)
    cosines = corners @ axis / np.where(length > 0, length, 1.0)
    return pose.turn(axis), float(cosines.min())


def towards(
    bodies: tuple[PatchedBody, ...], pair: tuple[int, int], directions: int, across: int
) -> Float[np.ndarray, "p p"] | None:
    """What two bodies see of each other, in the directions in which they can.

    However far apart they are, all lines go from the one to the other.

    Args:
        bodies: the scene; the others may stand in the way.
        pair: numbers of the two.
        directions: how many.
        across: lines over the smaller body.

    Returns:
        A_i F_ij of all patches; None if no box around the one, in the world's frame
        or in the bodies' own, is apart from one around the other.
    """
    first, second = (bodies[number].triangles.reshape(-1, 3) for number in pair)
    poses = [Pose(), *(bodies[number].pose for number in pair)]
    cones = [_cone(first, second, pose) for pose in poses]
    axis, least = max(cones, key=lambda cone: cone[1])
    if least <= 0:
        return None
    scene = _joined(bodies)
    extent = lambda points: float(np.ptp(points, axis=0).max())
    small = min(first, second, key=extent)
    pixel = extent(small) / across
    between = np.zeros((scene.count, scene.count))
    room = (SMALLEST, SMALLEST)
    weight = 2 * (1 - least) / directions * pixel * pixel
    spans = [
        slice(scene.first[n], scene.first[n] + bodies[n].patches.count) for n in pair
    ]
    for view in _views(small, cap_directions(axis, least, directions), pixel):
        pairs, _, room = _look(bodies, scene, view, room)
        between += weight * pairs
    only = np.zeros_like(between)
    only[spans[0], spans[1]] = between[spans[0], spans[1]]
    return only + only.T


# View factors between the patches of near bodies, reciprocal and closed.
#
# Sampled areas A_i F_ij are symmetric as they are. They are made to add up by a
# symmetric scaling, A_i F_ij -> d_i A_i F_ij d_j, such that with the surroundings every
# row adds up to the patch's true area: what sees nothing stays so, and a sealed cavity
# stays sealed. The rounding that is left goes to the patch's own F_ii, which exchanges
# nothing.


DIRECTIONS = 128
"""All round, and again as many from each body to each other one."""

ACROSS = 64
"""Lines over the largest extent of the scene, and of a body that is looked at."""

ROUNDS = 200


class ViewFactors(NamedTuple):
    """Of all bodies' patches, one after the other."""

    area: Float[np.ndarray, " p"]
    """[m^2]"""
    between: Float[np.ndarray, "p p"]
    """A_i F_ij, symmetric [m^2]."""
    outside: Float[np.ndarray, " p"]
    """A_i F_i,surroundings [m^2]."""

    @property
    def factor(self) -> Float[np.ndarray, "p p"]:
        """F_ij: the share of what patch i emits that reaches patch j."""
        return self.between / self.area[:, None]

    @property
    def to_surroundings(self) -> Float[np.ndarray, " p"]:
        """F of each patch to the surroundings; with the others 1 in sum."""
        return self.outside / self.area


def view_factors(
    bodies: tuple[PatchedBody, ...],
    directions: int = DIRECTIONS,
    across: int = ACROSS,
) -> ViewFactors:
    """View factors by lines of sight, for any number of bodies of any shape.

    Args:
        bodies: whose surfaces exchange; all of them may stand in each other's way.
        directions: how many views of the scene, and of each pair of bodies.
        across: lines over the largest extent, of the scene or of the smaller body.

    Raises:
        InputError: for fewer than 8 directions or lines.
    """
    if directions < 8 or across < 8:
        raise InputError(
            f"view factors: directions={directions}, across={across}; "
            "give 8 or more of both"
        )
    extent = max(float(np.ptp(b.triangles.reshape(-1, 3), 0).max()) for b in bodies)
    area = np.concatenate([body.patches.area for body in bodies])
    found = balanced(all_round(bodies, directions, extent / across), area)
    for first in range(len(bodies)):
        for second in range(first + 1, len(bodies)):
            seen = towards(bodies, (first, second), directions, across)
            if seen is not None:
                found = _replaced(found, seen, bodies, (first, second))
    return found


def _replaced(found: ViewFactors, seen, bodies, pair: tuple[int, int]) -> ViewFactors:
    """With one pair of bodies sampled better; the surroundings take the difference."""
    counts = [body.patches.count for body in bodies]
    number = np.repeat(np.arange(len(bodies)), counts)
    a, b = number == pair[0], number == pair[1]
    between = np.where((a[:, None] & b) | (b[:, None] & a), seen, found.between)
    outside = found.outside + (found.between - between).sum(1)
    return balanced(Sight(between, np.maximum(outside, 0.0)), found.area)


def balanced(sight: Sight, area: Float[np.ndarray, " p"]) -> ViewFactors:
    """Scaled such that every patch sees as much as it has area.

    Args:
        sight: symmetric, as sampled.
        area: of the patches [m^2].
    """
    between = sight.between
    # A patch that no line has met sees the surroundings.
    met = between.sum(1) + sight.outside > 0
    outside = np.where(met, sight.outside, area)
    scale = np.ones(len(area))
    for _ in range(ROUNDS):
        row = scale * (between @ scale + outside)
        # The square root keeps the two ends of a pair from overcorrecting each other.
        scale = scale * np.sqrt(area / row)
        if np.abs(row - area).max() <= 1e-13 * area.max():
            break
    between = between * np.outer(scale, scale)
    outside = scale * outside
    between[np.diag_indices(len(area))] += area - between.sum(1) - outside
    return ViewFactors(area, between, outside)
