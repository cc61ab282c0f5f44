"""Contact and overlap of two placed bodies, on rays through both (thesis 5.3).

The depth layers of both bodies are peeled together along the axes of the lattice of the
finer body. Consecutive crossings of different bodies on a ray are in contact if they
face each other within a maximum distance:

    out of A, into B: a gap between them        into B, out of A: A and B overlap

Every part of the finer body's surface is sampled along the dominant axis of its normal
n_A, where its fragments are too, by 4 x 4 rays for each voxel. Each hit is assigned to
the nearest fragments of both bodies.

Both faces of a sheet are where its mesh is, whatever its thickness. A solid touches the
face whose normal opposes that of the solid, on either side of the sheet: rounding does
not decide. Two sheets touch with the faces between them; where they are at one place,
the second lies on the front of the first. A sheet is sampled along the normal of its
largest plane, by rays in rows that are turned, so that no straight border runs along
one. Its areas are those of its fragments, of which rays tell the fraction in contact.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...geometry.mesh import Pose
from ...geometry.vectors import (
    row_dot,
    tangents,
    triangle_normals,
    unit_vector,
    unit_vectors,
)
from ...host_memory import require_memory
from ...raster.fragments import DepthLayers, expected_fragments, peel
from ...sheets.sheet_grid import SheetGrid
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.grid import VoxelGrid
from ...voxels.lattice import BYTES_PER_FRAGMENT, pixel_axes
from ...voxels.surface import dominant_axis, face_axes
from .shares import MAX_FRAGMENT_DISTANCE


# Rays along either edge of a voxel.
_SAMPLES = 4

# Smallest cosine between one normal and the reverse of the other: within 60 degrees.
_MIN_FACING_COSINE = 0.5

MAX_SLANT = float(np.sqrt(3.0))
"""Largest ratio of the distance along an axis to the gap: 1 / min |n_A . e|."""

# Distance along each axis within which a surface point of a solid has a fragment
# [voxels].
_FRAGMENT_SPACING = 1.5

# Ratio of the finer body's cells to those that 4 x 4 rays sample in a sheet.
_FINER_FOR_SHEETS = 2

# Distance of two sheets that are at one place [cells]. Rays know the depth of a slanted
# plane to a tenth of it, since they round corners.
_COINCIDENT = 2e-3

# Slope of the rows of rays against the edges of a sheet: far from all simple fractions
# (the square of the golden section).
_SLOPE = (3 - math.sqrt(5)) / 2

# Allowed overlap in voxels of the coarser body: rounding and coarse meshes cause it.
_MAX_OVERLAP_VOXELS = 2.0


@dataclass(frozen=True, eq=False)
class PlacedGrid:
    """Grid of a body with its pose, and its name in messages."""

    grid: AbstractGrid
    pose: Pose = field(default_factory=Pose)
    name: str = "body"

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    @property
    def voxels(self) -> VoxelGrid:
        """Voxels of a solid body."""
        assert isinstance(self.grid, VoxelGrid)
        return self.grid

    @property
    def is_sheet(self) -> bool:
        """True for a sheet, which has a surface and no inside."""
        return isinstance(self.grid, SheetGrid)

    @property
    def spacing(self) -> float:
        """Distance along each axis within which a surface point has a fragment [m]."""
        if isinstance(self.grid, SheetGrid):
            return self.grid.fragment_reach
        return _FRAGMENT_SPACING * self.pitch

    @property
    def fragment_reach(self) -> float:
        """Distance within which a surface point has a fragment [m]."""
        if isinstance(self.grid, SheetGrid):
            return self.grid.fragment_reach
        return MAX_FRAGMENT_DISTANCE * self.pitch

    @cached_property
    def world_fragments(self) -> Float[np.ndarray, "s 3"]:
        """Positions of the fragments in the world [m]."""
        return self.pose.to_world(self.grid.fragment_position)

    @cached_property
    def world_bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the body in the world [m]."""
        corners = self.pose.to_world(self.grid.mesh.vertices)
        return np.stack([corners.min(0), corners.max(0)])

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Points of the world [m] in solid voxels of the body."""
        return self.grid.contains(self.pose.to_body(points))


def coarser_pitch(a: PlacedGrid, b: PlacedGrid) -> float:
    """Edge of the coarser body's voxels [m]; 0 for two sheets, which have none."""
    # The pitch of a sheet is along it and does not say how well it is placed.
    return max(0.0 if body.is_sheet else body.pitch for body in (a, b))


class ContactRange(NamedTuple):
    """Distances at which surfaces count as in contact."""

    max_gap: float
    """Largest gap [m]."""
    max_overlap: float
    """Largest overlap [m]."""

    @classmethod
    def between(cls, a: PlacedGrid, b: PlacedGrid, max_gap: float) -> "ContactRange":
        """Distances for two bodies, with the largest gap [m]."""
        return cls(max_gap, max(max_gap, _MAX_OVERLAP_VOXELS * coarser_pitch(a, b)))

    @property
    def max_distance(self) -> float:
        """Largest distance along an axis [m]."""
        return MAX_SLANT * max(self.max_gap, self.max_overlap)


class _RayHits(NamedTuple):
    """Rays that pass from one body to the other in contact; points in A's frame [m]."""

    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    triangle_a: Int[np.ndarray, " k"]
    """Numbers of triangles of `_surface_mesh`."""
    triangle_b: Int[np.ndarray, " k"]
    is_back_a: Bool[np.ndarray, " k"]
    """True where the back of a sheet is touched."""
    is_back_b: Bool[np.ndarray, " k"]
    area: Float[np.ndarray, " k"]
    """Contact area that each ray stands for [m^2]."""
    gap: Float[np.ndarray, " k"]
    """Distance of the surfaces [m], negative where the bodies overlap."""


class _Crossings(NamedTuple):
    """All crossings of rays with A's surface where they sample it, in A's frame."""

    point: Float[np.ndarray, "n 3"]
    triangle: Int[np.ndarray, " n"]
    area: Float[np.ndarray, " n"]
    """Area of A's surface that each ray stands for [m^2]."""


class _RayFrame(NamedTuple):
    """Axes of the rays in the frame of a body: those of its lattice, or turned ones."""

    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    """Unit vectors."""
    pitch: float
    """Cells of this edge are sampled by 4 x 4 rays [m]."""

    def to_cells(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Positions [m] along the axes, in units of cells."""
        return (points - self.origin) @ self.axes.T / self.pitch

    def to_points(self, cells: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Positions [m] of points given in cells."""
        return self.origin + cells @ self.axes * self.pitch


class _Sampling(NamedTuple):
    """Surfaces of both bodies as the rays meet them, in cells."""

    frame: _RayFrame
    triangles: Float[np.ndarray, "t 3 3"]
    """Those of A, then those of B."""
    normals: Float[np.ndarray, "t 3"]
    """Unit normals; 0 for triangles without area."""
    dominant: Int[np.ndarray, " f"]
    """Axis along which each triangle of A is sampled; -1 for one without area."""
    is_sheet: tuple[bool, bool]
    second_is_a: bool
    """True if A comes after B in the scene."""


def _surface_mesh(
    grid: AbstractGrid,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices [m] and triangles of a surface: of a sheet, those of its cells."""
    if isinstance(grid, SheetGrid):
        return grid.cells.vertices, grid.cells.faces
    return grid.mesh.vertices, grid.mesh.faces


def ray_hits(
    a: PlacedGrid,
    b: PlacedGrid,
    near: Int[np.ndarray, " c"],
    limits: ContactRange,
    second_is_a: bool,
) -> _RayHits:
    """Contact of two bodies on rays through A, near some fragments of A.

    `second_is_a` is True if A comes after B in the scene.
    """
    sampling = _sampling(a, b, near, second_is_a)
    pitch = sampling.frame.pitch
    hits = []
    crossings = []
    for axis, low, high in _near_boxes(a, near, sampling):
        low[axis] -= limits.max_distance / pitch
        high[axis] += limits.max_distance / pitch
        box = (np.floor(low), np.ceil(high))
        layers = _layers_near(sampling.triangles, axis, box)
        hits.append(
            _hits_along(axis, sampling=sampling, layers=layers, box=box, limits=limits)
        )
        if a.is_sheet:
            crossings.append(_crossings(axis, sampling, layers, box))
    all_hits = _RayHits(*(np.concatenate(column) for column in zip(*hits, strict=True)))
    if not isinstance(a.grid, SheetGrid):
        return all_hits
    columns = zip(*crossings, strict=True)
    return _with_true_areas(
        a.grid,
        near=near,
        hits=all_hits,
        crossings=_Crossings(*(np.concatenate(column) for column in columns)),
    )


def _sampling(
    a: PlacedGrid, b: PlacedGrid, near: Int[np.ndarray, " c"], second_is_a: bool
) -> _Sampling:
    lattice = a.grid.lattice
    frame = _RayFrame(origin=lattice.origin, axes=np.eye(3), pitch=a.pitch)
    if isinstance(a.grid, SheetGrid):
        area = a.grid.cells.fragments.area
        # Nodes in the vertices of a fine mesh are closer than the pitch.
        size = math.sqrt(area @ area / area.sum())
        frame = frame._replace(
            axes=_turned_axes(a.grid, near),
            pitch=min(a.pitch, b.pitch, size) / _FINER_FOR_SHEETS,
        )
    vertices_a, faces_a = _surface_mesh(a.grid)
    vertices_b, faces_b = _surface_mesh(b.grid)
    in_a = a.pose.to_body(b.pose.to_world(vertices_b))
    of_a = frame.to_cells(vertices_a)[faces_a]
    triangles = np.concatenate([of_a, frame.to_cells(in_a)[faces_b]])
    normals = unit_vectors(triangle_normals(triangles))
    if a.is_sheet:
        normals_a = normals[: len(of_a)]
        has_area = (normals_a != 0).any(axis=1)
        dominant = np.where(has_area, dominant_axis(normals_a), -1)
    else:
        dominant = face_axes(a.grid.mesh)[1]
    return _Sampling(
        frame=frame,
        triangles=triangles,
        normals=normals,
        dominant=dominant,
        is_sheet=(a.is_sheet, b.is_sheet),
        second_is_a=second_is_a,
    )


def _turned_axes(
    grid: SheetGrid, near: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "3 3"]:
    """Unit vectors: the normal of the fragments' largest plane, and two across it."""
    normal = grid.fragment_normal[near]
    weighted = grid.fragment_area[near, None] * normal
    # Of all directions the one with the largest sum of area (n . e)^2.
    upright = np.linalg.eigh(weighted.T @ normal).eigenvectors[:, -1]
    first, second = (vector[0] for vector in tangents(upright[None]))
    across = unit_vector(first + _SLOPE * second)
    return np.stack([upright, across, np.cross(upright, across)])


def _near_boxes(
    a: PlacedGrid, near: Int[np.ndarray, " c"], sampling: _Sampling
) -> Iterator[tuple[int, Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]:
    """Axes of rays, and the corners of the boxes in which they sample A [cells]."""
    if isinstance(a.grid, SheetGrid):
        triangles = np.flatnonzero(_is_near(a.grid, near).any(axis=1))
        axes = sampling.dominant[triangles]
        points = sampling.triangles[triangles]
        spacing = 0.0
    else:
        axes = a.voxels.fragment_axis[near]
        points = sampling.frame.to_cells(a.grid.fragment_position[near])[:, None]
        spacing = _FRAGMENT_SPACING
    for axis in np.unique(axes[axes >= 0]).tolist():
        corners = points[axes == axis].reshape(-1, 3)
        yield axis, corners.min(0) - spacing, corners.max(0) + spacing


def _is_near(grid: SheetGrid, near: Int[np.ndarray, " c"]) -> Bool[np.ndarray, "t 3"]:
    """True for thirds of triangles in some fragments, whatever their face."""
    count = len(grid.cells.fragments.area)
    is_near = np.zeros(count, bool)
    is_near[near % count] = True
    return is_near[grid.cells.fragments.of_corner]


def _with_true_areas(
    grid: SheetGrid, near: Int[np.ndarray, " c"], hits: _RayHits, crossings: _Crossings
) -> _RayHits:
    """Hits of A's near fragments, with areas that sum to those of a sheet's fragments.

    A ray stands for the area of its fragment over the number of rays through it, so
    that a fragment that is wholly in contact has its area.
    """
    count = len(grid.cells.fragments.area)
    crossed = grid.fragments_at(
        crossings.point,
        triangle=crossings.triangle,
        is_back=np.zeros(len(crossings.area), bool),
    )
    sampled = np.bincount(crossed, crossings.area, count)
    fragment = grid.fragments_at(
        hits.point_a,
        triangle=hits.triangle_a,
        is_back=np.zeros(len(hits.area), bool),
    )
    is_near = np.isin(fragment, near % count)
    scale = grid.cells.fragments.area[fragment] / sampled[fragment]
    scaled = hits._replace(area=hits.area * scale)
    return _RayHits(*(column[is_near] for column in scaled))


def _hits_along(
    axis: int, *, sampling: _Sampling, layers: DepthLayers, box, limits: ContactRange
) -> _RayHits:
    """Contact of A's surface where its dominant axis is `axis`.

    `layers` are those of all triangles within a box of cells.
    """
    frame = sampling.frame
    # Consecutive crossings on one ray that belong to different bodies.
    count_a = len(sampling.dominant)
    of_a = layers.triangle < count_a
    same_ray = layers.pixel[1:] == layers.pixel[:-1]
    first = np.flatnonzero(same_ray & (of_a[1:] != of_a[:-1]))
    at_a = first + ~of_a[first]
    at_b = first + of_a[first]
    n_a = sampling.normals[layers.triangle[at_a]]
    n_b = sampling.normals[layers.triangle[at_b]]
    depth = layers.depth[at_b] - layers.depth[at_a]
    side_a, side_b = _touching_sides(sampling, n_a=n_a, n_b=n_b, axis=axis, depth=depth)
    n_a = n_a * side_a[:, None]
    n_b = n_b * side_b[:, None]
    # Gap and area refer to the surface that is closer to normal to the ray e: with c =
    # max(|n_A . e|, |n_B . e|), gap = c distance and area = ray's square / c. This is
    # exact for parallel surfaces, and otherwise the same whichever body is sampled.
    distance = depth * np.sign(n_a[:, axis])
    cosine = np.maximum(np.abs(n_a[:, axis]), np.abs(n_b[:, axis]))
    gap = distance * cosine * frame.pitch
    hit = (gap <= limits.max_gap) & (gap >= -limits.max_overlap)
    hit &= row_dot(n_a, n_b) <= -_MIN_FACING_COSINE
    hit &= sampling.dominant[layers.triangle[at_a]] == axis
    for is_sheet, crossing in zip(sampling.is_sheet, (at_a, at_b), strict=True):
        if is_sheet:
            hit[hit] = _is_nearest(crossing[hit], gap[hit])
    at_a = at_a[hit]
    at_b = at_b[hit]
    return _RayHits(
        point_a=_points(layers, which=at_a, axis=axis, frame=frame, box=box),
        point_b=_points(layers, which=at_b, axis=axis, frame=frame, box=box),
        triangle_a=layers.triangle[at_a],
        triangle_b=layers.triangle[at_b] - count_a,
        is_back_a=side_a[hit] < 0,
        is_back_b=side_b[hit] < 0,
        area=(frame.pitch / _SAMPLES) ** 2 / cosine[hit],
        gap=gap[hit],
    )


def _touching_sides(
    sampling: _Sampling,
    *,
    n_a: Float[np.ndarray, "k 3"],
    n_b: Float[np.ndarray, "k 3"],
    axis: int,
    depth: Float[np.ndarray, " k"],
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Sides with which surfaces touch: 1, or -1 for the back of a sheet.

    `depth` is that of B below A along the axis [cells].
    """
    front = np.ones(len(depth), int)
    opposite = np.where(row_dot(n_a, n_b) > 0, -1, 1)
    if not any(sampling.is_sheet):
        return front, front
    if not all(sampling.is_sheet):
        return (opposite, front) if sampling.is_sheet[0] else (front, opposite)
    # Towards the other sheet; where they are at one place, the front of the first one.
    side_a = np.where(n_a[:, axis] * depth > 0, 1, -1)
    if_coincident = opposite if sampling.second_is_a else front
    side_a = np.where(np.abs(depth) <= _COINCIDENT, if_coincident, side_a)
    return side_a, side_a * opposite


def _is_nearest(
    crossing: Int[np.ndarray, " k"], gap: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, " k"]:
    """False where a sheet is nearer to the other side of the solid that it is in.

    `crossing` numbers the crossings of rays with the sheet.
    """
    order = np.lexsort([-gap, crossing])
    is_nearest = np.ones(len(gap), bool)
    is_nearest[order[1:]] = crossing[order[1:]] != crossing[order[:-1]]
    return is_nearest | (gap > 0)


def _crossings(axis: int, sampling: _Sampling, layers: DepthLayers, box) -> _Crossings:
    """Crossings of rays with A's surface where its dominant axis is `axis`."""
    of_a = np.flatnonzero(layers.triangle < len(sampling.dominant))
    sampled = of_a[sampling.dominant[layers.triangle[of_a]] == axis]
    triangle = layers.triangle[sampled]
    slope = np.abs(sampling.normals[triangle, axis])
    return _Crossings(
        point=_points(layers, which=sampled, axis=axis, frame=sampling.frame, box=box),
        triangle=triangle,
        area=(sampling.frame.pitch / _SAMPLES) ** 2 / slope,
    )


def _layers_near(triangles, axis: int, box) -> DepthLayers:
    """Depth layers of the triangles that are in a box of cells."""
    seen = (triangles.min(1) <= box[1]) & (triangles.max(1) >= box[0])
    which = np.flatnonzero(seen.all(1))
    layers = _layers(triangles[which], axis, box)
    return replace(layers, triangle=which[layers.triangle])


def _layers(triangles, axis: int, box) -> DepthLayers:
    """Depth layers within a box of cells, 4 x 4 pixels for each; depths in cells."""
    row_axis, column_axis = pixel_axes(axis)
    views = [column_axis, row_axis]
    width, height = ((box[1] - box[0])[views] * _SAMPLES).astype(int).tolist()
    frame = triangles[..., [*views, axis]]
    frame[..., :2] = (frame[..., :2] - box[0][views]) * _SAMPLES
    fragments = expected_fragments(frame, width, height)
    require_memory(
        int(fragments * BYTES_PER_FRAGMENT),
        "the search for contact",
        "use a coarser pitch",
    )
    return peel(frame, width, height)


def _points(layers: DepthLayers, which, axis: int, frame: _RayFrame, box):
    """Points at which rays cross a surface, in A's frame [m]."""
    row, column = np.divmod(layers.pixel[which], layers.width)
    cells = np.zeros((len(which), 3))
    cells[:, axis] = layers.depth[which]
    for across, pixel in zip(pixel_axes(axis), (row, column), strict=True):
        cells[:, across] = box[0][across] + (pixel + 0.5) / _SAMPLES
    return frame.to_points(cells)
