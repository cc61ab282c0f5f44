"""Global lines through a scene, which count the patches that see each other.

Along every line of a view, surfaces follow each other in the order of their depth
layers. Where the line leaves one surface and enters the next, the two see each other
along it, in both directions, and its first and last surface see the surroundings. So

    A_i F_ij = integral over directions of dw/pi, over the lines of dA, of [i sees j],

with as many views as directions, no lines of its own for any patch, symmetric by
construction, and obstacles are found by the same sort that orders the layers. A thin
wall is entered and left at one point, through both of its faces. Source: the global
lines of Sbert, Comput. Graph. Forum 12(3) (1993).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull, QhullError

from ...geometry.mesh import Pose, joined
from ...geometry.vectors import triangle_normals
from ...raster.fragments import DepthLayers, peel
from ...raster.views import (
    OrthographicView,
    cap_directions,
    half_sphere_directions,
    orthographic_view,
)
from ...voxels.cavities import Cavities
from .patches import PatchedBody


class _Scene(NamedTuple):
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normal: Float[np.ndarray, "f 3"]
    body: Int[np.ndarray, " f"]
    is_thin: Bool[np.ndarray, " f"]
    """True for faces of thin walls, both of whose sides are surfaces."""
    first_face: Int[np.ndarray, " b"]
    """Index of each body's first face among all faces."""
    first: Int[np.ndarray, " b"]
    """Index of each body's first patch among all patches."""
    count: int


def _concatenated(bodies: tuple[PatchedBody, ...]) -> _Scene:
    vertices, faces = joined([(body.vertices, body.faces) for body in bodies])
    counts = [body.patches.count for body in bodies]
    face_counts = [len(body.faces) for body in bodies]
    return _Scene(
        vertices=vertices,
        faces=faces,
        normal=triangle_normals(vertices[faces]),
        body=np.repeat(np.arange(len(bodies)), face_counts),
        is_thin=np.repeat([body.wall is not None for body in bodies], face_counts),
        first_face=np.cumsum([0, *face_counts[:-1]]),
        first=np.cumsum([0, *counts[:-1]]),
        count=sum(counts),
    )


# Views that are drawn at once, at most; and triangles, of all these views together.
_MAX_VIEWS = 16
_MAX_TRIANGLES = 2048

# Steps of a low-discrepancy sequence in the unit square: 1/g, 1/g^2 with g^3 = g + 1.
_SEQUENCE_STEP = np.array([0.7548776662466927, 0.5698402909980532])


# Fewer points need no outline.
_FEW_POINTS = 1000


def _outline(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Corners of the convex hull of points; their views have the same extent."""
    if len(points) < _FEW_POINTS:
        return points
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        # Points in one plane have none.
        return points


def _views(
    points: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "d 3"],
    pixel: float,
) -> Iterator[OrthographicView]:
    """View along each direction, displaced by a fraction of a pixel."""
    # A view centred on the scene would count half a pixel too much on average.
    for index, direction in enumerate(directions):
        view = orthographic_view(points, direction, pixel)
        shift = np.append((index * _SEQUENCE_STEP) % 1.0 - 0.5, 0.0) * pixel
        yield replace(view, corner=view.corner + shift)


class _Strip(NamedTuple):
    """Views side by side in one image, which are drawn at once."""

    views: Sequence[OrthographicView]
    """All with the same pitch."""
    start: Int[np.ndarray, " w"]
    """First column of each view."""
    width: int
    height: int

    def project(self, scene: _Scene) -> Float[np.ndarray, "k 3 3"]:
        """Triangles in the image [pixels], of one view after the other."""
        right = np.array([1.0, 0.0, 0.0])
        pairs = zip(self.views, self.start, strict=True)
        # Vertices are fewer than corners.
        projected = [
            view.project(scene.vertices) + start * right for view, start in pairs
        ]
        return np.concatenate([points[scene.faces] for points in projected])

    def points(
        self, layers: DepthLayers, view: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k 3"]:
        """Positions of fragments in the world [m], by the number of their view."""
        row, column = np.divmod(layers.pixel, self.width)
        column = column - self.start[view]
        seen = np.stack([column + 0.5, row + 0.5, layers.depth], axis=1)
        corner = np.stack([strip_view.corner for strip_view in self.views])
        frame = np.stack([strip_view.frame for strip_view in self.views])
        local = seen * self.views[0].pitch + corner[view]
        return np.einsum("ki,kij->kj", local, frame[view])


def _strip(views: Sequence[OrthographicView]) -> _Strip:
    widths = [view.width for view in views]
    start = np.cumsum([0, *widths[:-1]])
    return _Strip(
        views=views,
        start=start,
        width=sum(widths),
        height=max(view.height for view in views),
    )


class _Hits(NamedTuple):
    """Surfaces along the lines of a view, in the order of their depth."""

    pixel: Int[np.ndarray, " k"]
    """Line."""
    point: Float[np.ndarray, "k 3"]
    """Position in the world [m]."""
    triangle: Int[np.ndarray, " k"]
    enters: Bool[np.ndarray, " k"]
    """True where the line leads into the surface, False where it leads out of it."""
    is_behind: Bool[np.ndarray, " k"]
    """True for the back of a thin wall."""


def _hits(strip: _Strip, scene: _Scene) -> _Hits:
    layers = peel(strip.project(scene), width=strip.width, height=strip.height)
    view, triangle = np.divmod(layers.triangle, len(scene.faces))
    is_thin = scene.is_thin[triangle]
    hit = np.repeat(np.arange(len(triangle)), 1 + is_thin)
    is_second = np.append(False, hit[1:] == hit[:-1])[: len(hit)]
    turned = layers.entering[hit]
    enters = np.where(is_thin[hit], ~is_second, turned)
    return _Hits(
        pixel=layers.pixel[hit],
        point=strip.points(layers, view)[hit],
        triangle=triangle[hit],
        enters=enters,
        is_behind=enters != turned,
    )


class _Met(NamedTuple):
    """Surfaces that the hits are on."""

    patch: Int[np.ndarray, " k"]
    thin_body: Int[np.ndarray, " k"]
    """Number of the body of a thin wall; -1 for a solid."""
    cavity: Int[np.ndarray, " k"]
    """Number of the cavity of that body that the hit is in; 0 outside."""


def _met(
    bodies: tuple[PatchedBody, ...],
    scene: _Scene,
    hits: _Hits,
    open_gap: Bool[np.ndarray, " g"],
) -> _Met:
    body = scene.body[hits.triangle]
    outward = scene.normal[hits.triangle] * np.where(hits.is_behind, -1, 1)[:, None]
    patch = np.zeros(len(body), int)
    cavity = np.zeros(len(body), int)
    for number, patched in enumerate(bodies):
        on_body = np.flatnonzero(body == number)
        pose = patched.pose
        if patched.wall is not None:
            # Its two hits follow each other, at one point.
            once = on_body[::2]
            face = hits.triangle[once] - scene.first_face[number]
            patches = patched.wall.patches_at(pose.to_body(hits.point[once]), face)
            side = hits.is_behind[on_body].astype(int)
            point = np.repeat(np.arange(len(once)), 2)
            patch[on_body] = scene.first[number] + patches[side, point]
            cavity[on_body] = patched.wall.face_space[face[point], side] // 2
            continue
        space = None
        if patched.patches.cavities is not None:
            space = _cavity_ahead(
                patched.patches.cavities,
                point=pose.to_body(hits.point),
                normal=pose.rotate_back(outward),
                open_gap=open_gap,
            )[on_body]
        patch_in_body = patched.patches.patch_of(
            pose.to_body(hits.point[on_body]),
            normals=pose.rotate_back(outward[on_body]),
            space=space,
        )
        patch[on_body] = scene.first[number] + patch_in_body
    thin_body = np.where(scene.is_thin[hits.triangle], body, -1)
    return _Met(patch=patch, thin_body=thin_body, cavity=cavity)


def _is_false(
    scene: _Scene, hits: _Hits, met: _Met, gap: Bool[np.ndarray, " g"]
) -> Bool[np.ndarray, " g"]:
    """Flag gaps between two faces of a thin body that cannot see each other.

    Close to an edge the two faces that meet there may follow each other in the wrong
    order.
    """
    same_body = (met.thin_body[1:] == met.thin_body[:-1]) & (met.thin_body[1:] >= 0)
    is_false = same_body & (met.cavity[1:] != met.cavity[:-1])
    start = np.flatnonzero(gap & same_body & ~is_false)
    corners = scene.vertices[scene.faces]
    for near, far in ((start, start + 1), (start + 1, start)):
        triangle = hits.triangle[near]
        sign = np.where(hits.is_behind[near], -1.0, 1.0)
        normal = sign[:, None] * scene.normal[triangle]
        offset = corners[hits.triangle[far]] - corners[triangle, :1]
        height = np.einsum("kci,ki->kc", offset, normal)
        size = np.abs(offset).max(axis=(1, 2)) * np.abs(normal).max(axis=1)
        is_false[start] |= height.max(axis=1) <= 1e-9 * size
    return is_false


def _cavity_ahead(
    cavities: Cavities,
    point: Float[np.ndarray, "k 3"],
    normal: Float[np.ndarray, "k 3"],
    open_gap: Bool[np.ndarray, " g"],
) -> Int[np.ndarray, " k"]:
    """Cavity of a body in front of each fragment, 0 for none; all in its frame."""
    # Both ends of a gap face the cavity in the middle of the gap: no line leads out of
    # a closed one, however coarse the voxels. First and last surfaces are outside.
    start = np.flatnonzero(open_gap)
    middle = cavities.at((point[start] + point[start + 1]) / 2)
    # A short gap in a corner may have a solid voxel there: its ends decide.
    short = np.flatnonzero(middle < 0)
    exit_point = start[short]
    entry = exit_point + 1
    middle[short] = np.maximum(
        cavities.faced(point[exit_point], normal[exit_point]),
        cavities.faced(point[entry], normal[entry]),
    )
    cavity = np.zeros(len(point), int)
    cavity[start] = middle
    cavity[start + 1] = middle
    return cavity


class LineSums(NamedTuple):
    """Sums over lines that all lead upward [m^2]."""

    pairs: Float[np.ndarray, "p p"]
    """Lines from each patch up to each other one."""
    sky: Float[np.ndarray, " p"]
    """Lines from each patch up to the surroundings."""
    ground: Float[np.ndarray, " p"]
    """Lines from the surroundings up to each patch."""

    @property
    def visible(self) -> Float[np.ndarray, "2 p"]:
        """Fraction of the sky and of the ground that each patch sees [-]."""
        free = np.stack([self.sky, self.ground])
        total = free + np.stack([self.pairs.sum(1), self.pairs.sum(0)])
        return np.where(total > 0, free / np.where(total > 0, total, 1.0), 1.0)


def _count_lines(
    bodies: tuple[PatchedBody, ...],
    scene: _Scene,
    views: Sequence[OrthographicView],
) -> LineSums:
    """Lines between each pair of patches and to the surroundings.

    Several views must each show the whole scene.
    """
    hits = _hits(_strip(views), scene)
    same = hits.pixel[1:] == hits.pixel[:-1]
    enters = hits.enters
    # Consecutive hits of a line face each other across empty space where the first
    # surface is left and the second entered.
    open_gap: Bool[np.ndarray, " g"] = same & ~enters[:-1] & enters[1:]
    met = _met(bodies, scene=scene, hits=hits, open_gap=open_gap)
    open_gap = open_gap & ~_is_false(scene, hits=hits, met=met, gap=open_gap)
    is_outside = met.cavity == 0
    first = np.append(True, ~same) & is_outside
    last = np.append(~same, True) & is_outside
    patch = met.patch
    numbers = patch[:-1][open_gap] * scene.count + patch[1:][open_gap]
    pairs = np.bincount(numbers, minlength=scene.count**2)
    return LineSums(
        pairs=pairs.reshape(scene.count, scene.count),
        sky=np.bincount(patch[last & ~enters], minlength=scene.count),
        ground=np.bincount(patch[first & enters], minlength=scene.count),
    )


def sample_all_directions(
    bodies: tuple[PatchedBody, ...], directions: int, lines: int
) -> LineSums:
    """Areas A_i F_ij of patches that see each other, and the surroundings [m^2].

    A view has `lines` lines across the largest body.
    """
    # A line counts both ways, so that half of the directions are enough, rounded up.
    scene = _concatenated(bodies)
    extent = max(float(np.ptp(b.vertices, 0).max()) for b in bodies)
    pixel = extent / lines
    totals = LineSums(
        pairs=np.zeros((scene.count, scene.count)),
        sky=np.zeros(scene.count),
        ground=np.zeros(scene.count),
    )
    half = (directions + 1) // 2
    weight = 2 / half * pixel * pixel
    views = _views(_outline(scene.vertices), half_sphere_directions(half), pixel)
    # Several views of a small scene at once: each call has a cost of its own.
    at_once = max(1, min(_MAX_VIEWS, _MAX_TRIANGLES // len(scene.faces)))
    while batch := tuple(islice(views, at_once)):
        counted = _count_lines(bodies, scene=scene, views=batch)
        for total, number in zip(totals, counted, strict=True):
            total += weight * number
    return totals


def _cone(
    first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"], pose: Pose
) -> tuple[np.ndarray, float]:
    """Axis and smallest cosine of the cone of directions between two boxes."""
    # The boxes are aligned with the axes of `pose`.
    source = pose.rotate_back(first)
    target = pose.rotate_back(second)
    low = target.min(0) - source.max(0)
    high = target.max(0) - source.min(0)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T == 1, high, low)
    axis = (low + high) / 2
    length = np.linalg.norm(corners, axis=1) * np.linalg.norm(axis)
    cosines = corners @ axis / np.where(length > 0, length, 1.0)
    return pose.rotate(axis), float(cosines.min())


class PairCone(NamedTuple):
    """Cone of all directions from one body to another."""

    pair: tuple[int, int]
    axis: Float[np.ndarray, "3"]
    min_cosine: float
    small: Float[np.ndarray, "n 3"]
    """Points of the smaller body, world [m]."""

    @property
    def extent(self) -> float:
        """Largest extent of the smaller body [m]."""
        return float(np.ptp(self.small, axis=0).max())


def pair_cones(bodies: tuple[PatchedBody, ...]) -> list[PairCone]:
    """Cones of the pairs of bodies that are apart.

    Those are pairs with separate boxes around them, along the world's axes or those of
    either body.
    """
    cones_apart = []
    for pair in combinations(range(len(bodies)), 2):
        first, second = (bodies[number].vertices for number in pair)
        poses = [Pose(), *(bodies[number].pose for number in pair)]
        cones = [_cone(first, second, pose) for pose in poses]
        axis, min_cosine = max(cones, key=lambda cone: cone[1])
        if min_cosine > 0:
            small = min(first, second, key=lambda points: np.ptp(points, axis=0).max())
            cones_apart.append(
                PairCone(pair=pair, axis=axis, min_cosine=min_cosine, small=small)
            )
    return cones_apart


def sample_pair(
    bodies: tuple[PatchedBody, ...], cone: PairCone, directions: int, lines: int
) -> Float[np.ndarray, "p p"]:
    """Areas A_i F_ij of two bodies, from the cone of directions between them [m^2].

    All lines go from one body to the other, however far apart they are; `lines` of them
    across the smaller one.
    """
    scene = _concatenated(bodies)
    pixel = cone.extent / lines
    between = np.zeros((scene.count, scene.count))
    weight = 2 * (1 - cone.min_cosine) / directions * pixel * pixel
    ahead = cap_directions(cone.axis, cone.min_cosine, directions)
    for view in _views(_outline(cone.small), ahead, pixel):
        counted = _count_lines(bodies, scene=scene, views=[view])
        between += weight * counted.pairs
    rows, columns = (
        slice(scene.first[n], scene.first[n] + bodies[n].patches.count)
        for n in cone.pair
    )
    only = np.zeros_like(between)
    only[rows, columns] = between[rows, columns]
    return only + only.T
