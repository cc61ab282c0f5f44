"""Surfaces that parallel lines through a scene meet, in the order of their depth.

A line leads through empty space where it leaves one surface and enters the next, which
it does in a pixel of a view between two of its depth layers. A thin wall is entered and
left at one point, through both of its faces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull, QhullError

from ...arrays import linear_map
from ...geometry.mesh import Pose, joined
from ...geometry.vectors import triangle_normals
from ...raster.bounding_spheres import BoundingSpheres
from ...raster.fragments import DepthLayers, peel_mesh
from ...raster.views import OrthographicView, orthographic_view
from ...voxels.cavities import Cavities
from .patches import PatchedBody, SolidPatches


class LineScene(NamedTuple):
    """Surfaces of all bodies of a scene, with their patches."""

    bodies: tuple[PatchedBody, ...]
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    corners: Float[np.ndarray, "f 3 3"]
    normal: Float[np.ndarray, "f 3"]
    body: Int[np.ndarray, " f"]
    is_thin: Bool[np.ndarray, " f"]
    """True for faces of thin walls, both of whose sides are surfaces."""
    first_face: Int[np.ndarray, " b"]
    """Index of each body's first face among all faces."""
    solids: SolidPatches
    of_face: Int[np.ndarray, " f"]
    """Patch of each face that lies in one patch; -1 for others."""
    walls: tuple[int, ...]
    """Numbers of the bodies that are thin walls."""
    rooms: tuple[int, ...]
    """Numbers of the solids whose closed cavities have patches of their own."""
    count: int
    """Number of patches."""

    @classmethod
    def of_bodies(cls, bodies: tuple[PatchedBody, ...]) -> "LineScene":
        """The scene of some bodies."""
        vertices, faces = joined([(body.vertices, body.faces) for body in bodies])
        corners = vertices[faces]
        normal = triangle_normals(corners)
        solids = SolidPatches.of_bodies(bodies, normal)
        face_counts = [len(body.faces) for body in bodies]
        is_thin = [body.wall is not None for body in bodies]
        return cls(
            bodies=bodies,
            vertices=vertices,
            faces=faces,
            corners=corners,
            normal=normal,
            body=np.repeat(np.arange(len(bodies)), face_counts),
            is_thin=np.repeat(is_thin, face_counts),
            first_face=np.cumsum([0, *face_counts[:-1]]),
            solids=solids,
            of_face=solids.of_faces(corners),
            walls=tuple(n for n, body in enumerate(bodies) if body.wall is not None),
            rooms=tuple(n for n, body in enumerate(bodies) if body.has_rooms),
            count=sum(body.patches.count for body in bodies),
        )


# Steps of a low-discrepancy sequence in the unit square: 1/g, 1/g^2 with g^3 = g + 1.
_SEQUENCE_STEP = np.array([0.7548776662466927, 0.5698402909980532])


# Fewer points need no outline.
_FEW_POINTS = 1000


def outline(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Corners of the convex hull of points; their views have the same extent."""
    if len(points) < _FEW_POINTS:
        return points
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        # Points in one plane have none.
        return points


def displaced_views(
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
    """Views one below the other in one image, which are drawn at once."""

    views: Sequence[OrthographicView]
    """All with the same pitch."""
    start: Int[np.ndarray, " w"]
    """First row of each view."""
    width: int
    height: int

    def peel(self, scene: LineScene) -> DepthLayers:
        """Depth layers of the scene in all views; triangles of one after the other."""
        if len(self.views) == 1:
            return _peeled(self.views[0], scene)
        down = np.array([0.0, 1.0, 0.0])
        pairs = zip(self.views, self.start, strict=True)
        points = [view.project(scene.vertices) + start * down for view, start in pairs]
        first = len(scene.vertices) * np.arange(len(self.views))
        faces = scene.faces + first[:, None, None]
        return peel_mesh(
            np.concatenate(points),
            faces=faces.reshape(-1, 3),
            width=self.width,
            height=self.height,
        )

    def points(
        self, layers: DepthLayers, fragment: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k 3"]:
        """Positions of some fragments, in ascending order, in the world [m]."""
        row, column = np.divmod(layers.pixel[fragment], self.width)
        depth = layers.depth[fragment]
        points = np.stack([column + 0.5, row + 0.5, depth], axis=1)
        # Fragments are sorted by row.
        ends = np.searchsorted(row, np.append(self.start[1:], self.height))
        first = 0
        for view, start, end in zip(self.views, self.start, ends, strict=True):
            offset = view.corner - np.array([0.0, start * view.pitch, 0.0])
            local = points[first:end] * view.pitch + offset
            points[first:end] = linear_map(local, view.frame)
            first = end
        return points


def _peeled(view: OrthographicView, scene: LineScene) -> DepthLayers:
    """Depth layers of the scene in a view, which may show a part of it."""
    spaces = view.half_spaces(
        low=np.array([0, 0]), high=np.array([view.width, view.height])
    )
    over = BoundingSpheres.of(scene.corners).reaching_into(spaces)
    if len(over) == len(scene.faces):
        return peel_mesh(
            view.project(scene.vertices),
            faces=scene.faces,
            width=view.width,
            height=view.height,
        )
    layers = view.peel(scene.corners[over])
    return replace(layers, triangle=over[layers.triangle])


def _strip(views: Sequence[OrthographicView]) -> _Strip:
    heights = [view.height for view in views]
    start = np.cumsum([0, *heights[:-1]])
    return _Strip(
        views=views,
        start=start,
        width=max(view.width for view in views),
        height=sum(heights),
    )


class _Hits(NamedTuple):
    """Surfaces along the lines of a view, in the order of their depth."""

    pixel: Int[np.ndarray, " k"]
    """Line."""
    point: Float[np.ndarray, "k 3"]
    """Position in the world [m]; nan where the triangle lies in one patch."""
    triangle: Int[np.ndarray, " k"]
    enters: Bool[np.ndarray, " k"]
    """True where the line leads into the surface, False where it leads out of it."""
    is_behind: Bool[np.ndarray, " k"]
    """True for the back of a thin wall."""


def _hits(strip: _Strip, scene: LineScene) -> _Hits:
    layers = strip.peel(scene)
    triangle = layers.triangle % len(scene.faces)
    point = np.full((len(triangle), 3), np.nan)
    is_apart = scene.of_face[triangle] < 0
    placed = np.flatnonzero(is_apart | bool(scene.rooms))
    point[placed] = strip.points(layers, placed)
    is_thin = scene.is_thin[triangle]
    if not is_thin.any():
        return _Hits(
            pixel=layers.pixel,
            point=point,
            triangle=triangle,
            enters=layers.entering,
            is_behind=is_thin,
        )
    hit = np.repeat(np.arange(len(triangle)), 1 + is_thin)
    is_second = np.append(False, hit[1:] == hit[:-1])[: len(hit)]
    turned = layers.entering[hit]
    enters = np.where(is_thin[hit], ~is_second, turned)
    return _Hits(
        pixel=layers.pixel[hit],
        point=point[hit],
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
    scene: LineScene,
    hits: _Hits,
    open_gap: Bool[np.ndarray, " g"],
) -> _Met:
    patch = scene.of_face[hits.triangle]
    apart = np.flatnonzero(patch < 0)
    space = np.zeros(len(patch), int)
    cavity = np.zeros(len(patch), int)
    is_thin = scene.is_thin[hits.triangle]
    body = scene.body[hits.triangle]
    for number in scene.walls:
        patched = scene.bodies[number]
        assert patched.wall is not None
        # Its two hits follow each other, at one point.
        on_body = np.flatnonzero(body == number)
        once = on_body[::2]
        face = hits.triangle[once] - scene.first_face[number]
        at = patched.pose.to_body(hits.point[once])
        side = hits.is_behind[on_body].astype(int)
        point = np.repeat(np.arange(len(once)), 2)
        patches = patched.wall.patches_at(at, face)[side, point]
        patch[on_body] = scene.solids.first[number] + patches
        cavity[on_body] = patched.wall.face_space[face[point], side] // 2
    for number in scene.rooms:
        patched = scene.bodies[number]
        cavities = patched.patches.cavities
        if cavities is None:
            continue
        is_on_body = body == number
        ahead = _cavity_ahead(
            cavities,
            point=hits.point,
            normal=scene.normal[hits.triangle],
            gap=np.flatnonzero(open_gap & (is_on_body[:-1] | is_on_body[1:])),
            pose=patched.pose,
        )
        space[is_on_body] = ahead[is_on_body]
    solid = apart[~is_thin[apart]]
    if len(solid):
        patch[solid] = scene.solids.at(
            hits.point[solid], face=hits.triangle[solid], space=space[solid]
        )
    return _Met(patch=patch, thin_body=np.where(is_thin, body, -1), cavity=cavity)


def _is_false(
    scene: LineScene, hits: _Hits, met: _Met, gap: Bool[np.ndarray, " g"]
) -> Bool[np.ndarray, " g"]:
    """Flag gaps between two faces of a thin body that cannot see each other.

    Close to an edge the two faces that meet there may follow each other in the wrong
    order.
    """
    same_body = (met.thin_body[1:] == met.thin_body[:-1]) & (met.thin_body[1:] >= 0)
    is_false = same_body & (met.cavity[1:] != met.cavity[:-1])
    start = np.flatnonzero(gap & same_body & ~is_false)
    if not len(start):
        return is_false
    corners = scene.corners
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
    gap: Int[np.ndarray, " g"],
    pose: Pose,
) -> Int[np.ndarray, " k"]:
    """Cavity of a body that the two ends of each gap face, 0 for none.

    Gaps are the numbers of their first ends; points and normals are in the world.
    """
    # Both ends of a gap face the cavity in the middle of the gap: no line leads out of
    # a closed one, however coarse the voxels. First and last surfaces are outside.
    middle = cavities.at(pose.to_body((point[gap] + point[gap + 1]) / 2))
    # A short gap in a corner may have a solid voxel there: its ends decide.
    short = np.flatnonzero(middle < 0)
    exit_point = gap[short]
    faced = [
        cavities.faced(pose.to_body(point[end]), pose.rotate_back(normal[end]))
        for end in (exit_point, exit_point + 1)
    ]
    middle[short] = np.maximum(*faced)
    cavity = np.zeros(len(point), int)
    cavity[gap] = middle
    cavity[gap + 1] = middle
    return cavity


class Segments(NamedTuple):
    """Lines between patches, and from patches to the surroundings."""

    start: Int[np.ndarray, " g"]
    """Lower patch of each line between two."""
    end: Int[np.ndarray, " g"]
    sky: Int[np.ndarray, " u"]
    """Patch of each line up to the surroundings."""
    ground: Int[np.ndarray, " d"]


def segments_along(
    scene: LineScene,
    views: Sequence[OrthographicView],
    left_out: Bool[np.ndarray, " f"] | None = None,
) -> tuple[Segments, ...]:
    """Lines of some views; several views must each show the whole scene.

    With flags of faces that are `left_out`, also the lines without these.
    """
    hits = _hits(_strip(views), scene)
    if left_out is None:
        return (_segments_between(scene, hits),)
    stays = ~left_out[hits.triangle]
    remaining = _Hits(*(values[stays] for values in hits))
    return _segments_between(scene, hits), _segments_between(scene, remaining)


def _segments_between(scene: LineScene, hits: _Hits) -> Segments:
    """Lines from each surface that is met to the next one."""
    same = hits.pixel[1:] == hits.pixel[:-1]
    enters = hits.enters
    # Consecutive hits of a line face each other across empty space where the first
    # surface is left and the second entered.
    open_gap: Bool[np.ndarray, " g"] = same & ~enters[:-1] & enters[1:]
    met = _met(scene, hits=hits, open_gap=open_gap)
    open_gap = open_gap & ~_is_false(scene, hits=hits, met=met, gap=open_gap)
    is_outside = met.cavity == 0
    first = np.append(True, ~same)[: len(enters)] & is_outside
    last = np.append(~same, True)[: len(enters)] & is_outside
    return Segments(
        start=met.patch[:-1][open_gap],
        end=met.patch[1:][open_gap],
        sky=met.patch[last & ~enters],
        ground=met.patch[first & enters],
    )
