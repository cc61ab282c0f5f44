"""Contact and overlap of two placed bodies, on rays through both (thesis 5.3).

The depth layers of both bodies are peeled together along the axes of the lattice of the
finer body. Consecutive crossings of different bodies on a ray are in contact if they
face each other within a maximum distance:

    out of A, into B: a gap between them        into B, out of A: A and B overlap

Every part of the finer body's surface is sampled along the dominant axis of its normal
n_A, where its fragments are too, by 4 x 4 rays for each voxel. Each hit is assigned to
the nearest fragments of both bodies.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...geometry.mesh import Pose
from ...geometry.vectors import row_dot, triangle_normals, unit_vectors
from ...host_memory import require_memory
from ...raster.fragments import DepthLayers, expected_fragments, peel
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.grid import VoxelGrid
from ...voxels.lattice import BYTES_PER_FRAGMENT, Lattice, pixel_axes
from ...voxels.surface import face_axes


# Rays along either edge of a voxel.
_SAMPLES = 4

# Smallest cosine between one normal and the reverse of the other: within 60 degrees.
_MIN_FACING_COSINE = 0.5

MAX_SLANT = float(np.sqrt(3.0))
"""Largest ratio of the distance along an axis to the gap: 1 / min |n_A . e|."""

FRAGMENT_SPACING = 1.5
"""Distance along each axis within which a surface point has a fragment [voxels]."""


# Allowed overlap in voxels of the coarser body: rounding and coarse meshes cause it.
_MAX_OVERLAP_VOXELS = 2.0

_AXIS_DIRECTIONS = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])


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
        """Voxels of a solid body.

        Raises:
            InputError: for a sheet.
        """
        if not isinstance(self.grid, VoxelGrid):
            raise InputError(f"{self.name} is a sheet: contact needs solid bodies")
        return self.grid

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


class ContactRange(NamedTuple):
    """Distances at which surfaces count as in contact."""

    max_gap: float
    """Largest gap [m]."""
    max_overlap: float
    """Largest overlap [m]."""

    @classmethod
    def between(cls, a: PlacedGrid, b: PlacedGrid, max_gap: float) -> "ContactRange":
        """Distances for two bodies, with the largest gap [m]."""
        voxel = max(a.pitch, b.pitch)
        return cls(max_gap, max(max_gap, _MAX_OVERLAP_VOXELS * voxel))

    @property
    def max_distance(self) -> float:
        """Largest distance along an axis [m]."""
        return MAX_SLANT * max(self.max_gap, self.max_overlap)


class _RayHits(NamedTuple):
    """Rays that pass from one body to the other in contact; points in A's frame [m]."""

    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    triangle_a: Int[np.ndarray, " k"]
    triangle_b: Int[np.ndarray, " k"]
    area: Float[np.ndarray, " k"]
    """Contact area that each ray stands for [m^2]."""
    gap: Float[np.ndarray, " k"]
    """Distance of the surfaces [m], negative where the bodies overlap."""


def ray_hits(
    a: PlacedGrid, b: PlacedGrid, near: Int[np.ndarray, " c"], limits: ContactRange
) -> _RayHits:
    """Contact of two bodies on rays of A's lattice, near some fragments of A."""
    lattice = a.grid.lattice
    corners = (
        a.grid.mesh.vertices,
        a.pose.to_body(b.pose.to_world(b.grid.mesh.vertices)),
    )
    faces = (a.grid.mesh.faces, b.grid.mesh.faces)
    triangles = np.concatenate(
        [lattice.to_cells(c)[f] for c, f in zip(corners, faces, strict=True)]
    )
    dominant = face_axes(a.grid.mesh)[1]
    position = lattice.to_cells(a.grid.fragment_position[near])
    axes = a.voxels.fragment_axis[near]
    hits = []
    for axis in np.unique(axes).tolist():
        points = position[axes == axis]
        low = points.min(0) - FRAGMENT_SPACING
        high = points.max(0) + FRAGMENT_SPACING
        low[axis] -= limits.max_distance / lattice.pitch
        high[axis] += limits.max_distance / lattice.pitch
        hits.append(
            _hits_along(
                axis,
                lattice=lattice,
                triangles=triangles,
                dominant=dominant,
                box=(np.floor(low), np.ceil(high)),
                limits=limits,
            )
        )
    return _RayHits(*(np.concatenate(column) for column in zip(*hits, strict=True)))


def _hits_along(axis, lattice: Lattice, triangles, dominant, box, limits: ContactRange):
    """Contact of A's surface where its dominant axis is `axis`.

    `triangles` are those of A, then of B; `box` is the sampled region; both in cells.
    """
    seen = (triangles.min(1) <= box[1]) & (triangles.max(1) >= box[0])
    which = np.flatnonzero(seen.all(1))
    layers = _layers(triangles[which], axis, box)
    normals = unit_vectors(triangle_normals(triangles[which]))
    # Consecutive crossings on one ray that belong to different bodies.
    count_a = len(dominant)
    of_a = which[layers.triangle] < count_a
    same_ray = layers.pixel[1:] == layers.pixel[:-1]
    first = np.flatnonzero(same_ray & (of_a[1:] != of_a[:-1]))
    at_a = first + ~of_a[first]
    at_b = first + of_a[first]
    n_a = normals[layers.triangle[at_a]]
    n_b = normals[layers.triangle[at_b]]
    # Gap and area refer to the surface that is closer to normal to the ray e: with c =
    # max(|n_A . e|, |n_B . e|), gap = c distance and area = ray's square / c. This is
    # exact for parallel surfaces, and otherwise the same whichever body is sampled.
    distance = (layers.depth[at_b] - layers.depth[at_a]) * np.sign(n_a[:, axis])
    cosine = np.maximum(np.abs(n_a[:, axis]), np.abs(n_b[:, axis]))
    gap = distance * cosine * lattice.pitch
    hit = (gap <= limits.max_gap) & (gap >= -limits.max_overlap)
    hit &= row_dot(n_a, n_b) <= -_MIN_FACING_COSINE
    hit &= dominant[which[layers.triangle[at_a]]] == axis
    at_a = at_a[hit]
    at_b = at_b[hit]
    return _RayHits(
        point_a=_points(layers, which=at_a, axis=axis, lattice=lattice, box=box),
        point_b=_points(layers, which=at_b, axis=axis, lattice=lattice, box=box),
        triangle_a=which[layers.triangle[at_a]],
        triangle_b=which[layers.triangle[at_b]] - count_a,
        area=(lattice.pitch / _SAMPLES) ** 2 / cosine[hit],
        gap=gap[hit],
    )


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


def _points(layers: DepthLayers, which, axis: int, lattice: Lattice, box):
    """Points at which rays cross a surface, in the lattice's frame [m]."""
    row, column = np.divmod(layers.pixel[which], layers.width)
    cells = np.zeros((len(which), 3))
    cells[:, axis] = layers.depth[which]
    for across, pixel in zip(pixel_axes(axis), (row, column), strict=True):
        cells[:, across] = box[0][across] + (pixel + 0.5) / _SAMPLES
    return lattice.origin + cells * lattice.pitch


MAX_FRAGMENT_DISTANCE = 2.0
"""Largest distance of a surface point from its fragment [voxels]; a part of the body
without any nearer fragment has no voxels."""

_OFFSETS = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))


class _Rays(NamedTuple):
    """Fragments of a body along one axis, sorted by ray and depth; all in cells."""

    axis: int
    shape: tuple[int, ...]
    fragment: Int[np.ndarray, " s"]
    position: Float[np.ndarray, "s 3"]
    outward: Float[np.ndarray, "s 3"]
    ray: Int[np.ndarray, " s"]
    key: Float[np.ndarray, " s"]
    """Sort key: ray and depth as one number."""


def _nearest_fragments(
    grid: VoxelGrid, point: Float[np.ndarray, "k 3"], triangle: Int[np.ndarray, " k"]
) -> Int[np.ndarray, " k"]:
    """Fragment nearest to each point on a body's surface along its ray; -1 for none.

    Points are in the body's frame [m], each in a triangle of its mesh. If no fragment
    on the ray faces the same way (a sliver at an edge), it is the nearest one on the
    surrounding rays along all three axes.
    """
    normals, dominant = face_axes(grid.mesh)
    normal = normals[triangle]
    point_axis = dominant[triangle]
    cells = grid.lattice.to_cells(point)
    rays = [_rays_along(grid, axis) for axis in range(3)]
    fragment = np.full(len(point), -1)
    distance = np.full(len(point), MAX_FRAGMENT_DISTANCE)
    for axis in range(3):
        points = np.flatnonzero(point_axis == axis)
        fragment[points], distance[points] = _on_ray(
            rays[axis], cells=cells[points], normal=normal[points], offset=(0, 0)
        )
    missing = np.flatnonzero(fragment < 0)
    for axis in range(3 if len(missing) else 0):
        for offset in _OFFSETS:
            candidate, apart = _on_ray(
                rays[axis], cells=cells[missing], normal=normal[missing], offset=offset
            )
            nearer = apart < distance[missing]
            fragment[missing] = np.where(nearer, candidate, fragment[missing])
            distance[missing] = np.where(nearer, apart, distance[missing])
    return fragment


_FragmentShares = tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]
"""Fragment of each point, -1 for none, and the share of the point's area [-]."""


def fragment_shares(
    grid: VoxelGrid, point: Float[np.ndarray, "k 3"], triangle: Int[np.ndarray, " k"]
) -> list[_FragmentShares]:
    """Fragments to which the area around each point on a body's surface belongs.

    Arguments as for `_nearest_fragments`. Where there are fragments on rays of all axes
    a, the one along a has the share n_a^2, as everywhere on the surface.
    """
    nearest = _nearest_fragments(grid, point, triangle)
    if grid.cut is None:
        return [(nearest, np.ones(len(point)))]
    normal = face_axes(grid.mesh)[0][triangle]
    cells = grid.lattice.to_cells(point)
    shares = []
    for axis in range(3):
        fragment, _ = _on_ray(
            _rays_along(grid, axis), cells=cells, normal=normal, offset=(0, 0)
        )
        # Near an edge the rays of an axis may have none.
        fragment = np.where(fragment < 0, nearest, fragment)
        shares.append((fragment, np.square(normal[:, axis])))
    return shares


def _rays_along(grid: VoxelGrid, axis: int) -> _Rays:
    fragments = np.flatnonzero(grid.fragment_axis == axis)
    position = grid.lattice.to_cells(grid.fragment_position[fragments])
    ray = _ray(position, axis=axis, shape=grid.solid.shape, offset=(0, 0))
    key = _key(ray, position[:, axis], grid.solid.shape)
    order = np.argsort(key, kind="stable")
    return _Rays(
        axis=axis,
        shape=grid.solid.shape,
        fragment=fragments[order],
        position=position[order],
        outward=grid.fragment_normal[fragments[order]],
        ray=ray[order],
        key=key[order],
    )


def _ray(cells, axis, shape, offset):
    """Index of the ray through a column of cells, offset from a point's; -1 outside."""
    column = np.floor(cells[:, list(pixel_axes(axis))]).astype(np.int64) + offset
    size = np.array([shape[a] for a in pixel_axes(axis)])
    within = ((column >= 0) & (column < size)).all(1)
    return np.where(within, column[:, 0] * size[1] + column[:, 1], -1)


def _key(ray, depth, shape):
    longest = max(shape)
    return ray * (longest + 1.0) + np.clip(depth, 0, longest)


def _on_ray(rays: _Rays, cells, normal, offset):
    """Nearest fragment on the ray at an offset from each point; distance in cells."""
    fragment = np.full(len(cells), -1)
    distance = np.full(len(cells), MAX_FRAGMENT_DISTANCE)
    if not len(rays.ray):
        return fragment, distance
    ray = _ray(cells, axis=rays.axis, shape=rays.shape, offset=offset)
    behind = np.searchsorted(rays.key, _key(ray, cells[:, rays.axis], rays.shape))
    for candidate in (behind - 1, behind):
        slot = np.clip(candidate, 0, len(rays.ray) - 1)
        apart = np.linalg.norm(cells - rays.position[slot], axis=1)
        faces = row_dot(rays.outward[slot], normal) > 0
        nearer = (rays.ray[slot] == ray) & faces & (apart < distance)
        fragment = np.where(nearer, rays.fragment[slot], fragment)
        distance = np.where(nearer, apart, distance)
    return fragment, distance


def _depth_in(body: PlacedGrid, target: PlacedGrid) -> float:
    """Depth of a body's fragments in another one [m]; 0 if all are outside."""
    # The shortest way out of its voxels along the axes of its lattice, to half a voxel.
    solid = np.pad(target.voxels.solid, 1)
    points = body.world_fragments
    points = target.pose.to_body(points[target.contains(points)])
    if not len(points):
        return 0.0
    cells = np.floor(target.grid.lattice.to_cells(points)).astype(np.int64)
    # Padded on all sides, so that every way out ends.
    cells = np.unique(cells + 1, axis=0)
    steps = 0
    while len(cells):
        steps += 1
        ahead = np.clip(
            cells[:, None] + steps * _AXIS_DIRECTIONS, 0, np.array(solid.shape) - 1
        )
        cells = cells[solid[tuple(np.moveaxis(ahead, 2, 0))].all(1)]
    return (steps - 0.5) * target.pitch


def _fraction_inside(body: PlacedGrid, target: PlacedGrid) -> float:
    """Fraction of a body's fragments with a voxel centre inside another body."""
    voxels = body.grid.fragment_centre
    return float(target.contains(body.pose.to_world(voxels)).mean())


def require_shallow(a: PlacedGrid, b: PlacedGrid, threshold: float) -> None:
    """Raise an error for bodies that overlap too deeply to be in contact.

    `threshold` is the largest gap that counts as contact [m].

    Raises:
        InputError: naming both bodies and the depth.
    """
    depth = max(_depth_in(a, b), _depth_in(b, a))
    # The depth is known to half a voxel.
    limit = ContactRange.between(a, b, threshold).max_overlap
    limit += 0.5 * max(a.pitch, b.pitch)
    # Thin bodies can be inside each other entirely at a small depth.
    if depth > limit or max(_fraction_inside(a, b), _fraction_inside(b, a)) > 0.5:
        raise InputError(
            f"{a.name} and {b.name} overlap by about {depth:.3g} m: move them apart "
            "until they touch, or join them in one mesh"
        )
