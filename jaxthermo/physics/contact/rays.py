"""Rays through two bodies: where the surface of one meets the other's (thesis 5.3).

The depth layers of both bodies are peeled together along the axes of a lattice, that of
the finer body. Crossings that follow each other on a ray and are of different bodies
are in contact if they face each other within reach:

    out of A, into B: a gap between them        into B, out of A: A and B overlap

Every piece of the finer body's surface is looked at along the dominant axis of its
normal n_A, as where fragments are made, by SAMPLES^2 rays a voxel. Gap and area are
those of the surface that the ray e meets more squarely,

    c = max(|n_A . e|, |n_B . e|),    gap = c * way,    area = ray's square / c,

exact for parallel surfaces, and for others the same whichever body is looked at.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ...memory import require_memory
from ...raster.fragments import capacities
from ...raster.layers import DepthLayers, peel
from ...voxels.grid import VoxelGrid
from ...voxels.lattice import BYTES_PER_FRAGMENT, Lattice, pixel_axes
from ...voxels.surface import face_axes
from .bodies import PlacedGrid


SAMPLES = 4
"""Rays along either edge of a voxel."""

FACING = 0.5
"""Least cosine between one surface and the other's reverse: within 60 degrees."""

STEEPEST = float(np.sqrt(3.0))
"""Way along the axis over the gap, at most: 1 / min |n_A . e|."""

SLACK = 1.5
"""A surface point is nearer to a fragment than this along each axis, in voxels."""


class Reach(NamedTuple):
    """How far apart surfaces may be to be in contact."""

    gap: float
    """The widest one [m]."""
    overlap: float
    """The deepest one [m]."""

    @property
    def way(self) -> float:
        """The longest one along an axis [m]."""
        return STEEPEST * max(self.gap, self.overlap)


class Touches(NamedTuple):
    """Where rays leave one body for the other within reach; points in A's frame [m]."""

    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    triangle_a: Int[np.ndarray, " k"]
    triangle_b: Int[np.ndarray, " k"]
    area: Float[np.ndarray, " k"]
    """[m^2]"""
    gap: Float[np.ndarray, " k"]
    """[m]; negative where the bodies overlap."""


def touches(
    a: PlacedGrid, b: PlacedGrid, near: Int[np.ndarray, " c"], reach: Reach
) -> Touches:
    """All touches of two bodies by rays of A's lattice.

    Args:
        a: the body that gives the lattice.
        b: the other one.
        near: fragments of A that may touch it, one or more.
        reach: of contact.
    """
    lattice = a.grid.lattice
    corners = (a.grid.mesh.vertices, b.vertices_in(a))
    faces = (a.grid.mesh.faces, b.grid.mesh.faces)
    triangles = np.concatenate(
        [lattice.to_cells(c)[f] for c, f in zip(corners, faces, strict=True)]
    )
    dominant = face_axes(a.grid.mesh)[1]
    position = lattice.to_cells(a.grid.fragment_position[near])
    axes = a.grid.fragment_axis[near]
    parts = []
    for axis in np.unique(axes).tolist():
        mine = position[axes == axis]
        low, high = mine.min(0) - SLACK, mine.max(0) + SLACK
        low[axis] -= reach.way / lattice.pitch
        high[axis] += reach.way / lattice.pitch
        box = np.floor(low), np.ceil(high)
        parts.append(_along(axis, lattice, triangles, dominant, box, reach))
    return Touches(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _along(axis: int, lattice: Lattice, triangles, dominant, box, reach: Reach):
    """Touches of the pieces of A's surface that this axis is dominant for.

    Args:
        axis: of the rays.
        lattice: of A.
        triangles: A's and then B's, in cells.
        dominant: axis of each of A's.
        box: corners of what to look at, in cells.
        reach: of contact.
    """
    seen = (triangles.min(1) <= box[1]) & (triangles.max(1) >= box[0])
    which = np.flatnonzero(seen.all(1))
    layers = _layers(triangles[which], axis, box)
    normals = _unit_normals(triangles[which])
    # Crossings that follow each other on a ray, and are of different bodies.
    count_a = len(dominant)
    of_a = which[layers.triangle] < count_a
    same_ray = layers.pixel[1:] == layers.pixel[:-1]
    first = np.flatnonzero(same_ray & (of_a[1:] != of_a[:-1]))
    at_a, at_b = first + ~of_a[first], first + of_a[first]
    n_a, n_b = normals[layers.triangle[at_a]], normals[layers.triangle[at_b]]
    way = (layers.depth[at_b] - layers.depth[at_a]) * np.sign(n_a[:, axis])
    cosine = np.maximum(np.abs(n_a[:, axis]), np.abs(n_b[:, axis]))
    gap = way * cosine * lattice.pitch
    hit = (gap <= reach.gap) & (gap >= -reach.overlap)
    hit &= (n_a * n_b).sum(1) <= -FACING
    hit &= dominant[which[layers.triangle[at_a]]] == axis
    at_a, at_b = at_a[hit], at_b[hit]
    return Touches(
        point_a=_points(layers, at_a, axis, lattice, box),
        point_b=_points(layers, at_b, axis, lattice, box),
        triangle_a=which[layers.triangle[at_a]],
        triangle_b=which[layers.triangle[at_b]] - count_a,
        area=(lattice.pitch / SAMPLES) ** 2 / cosine[hit],
        gap=gap[hit],
    )


def _layers(triangles, axis: int, box) -> DepthLayers:
    """Depth layers within a box of cells, SAMPLES pixels a cell; depths in cells."""
    row_axis, column_axis = pixel_axes(axis)
    views = [column_axis, row_axis]
    width, height = ((box[1] - box[0])[views] * SAMPLES).astype(int).tolist()
    frame = triangles[..., [*views, axis]]
    frame[..., :2] = (frame[..., :2] - box[0][views]) * SAMPLES
    rows, fragments = capacities(frame, width, height)
    rows, fragments = _padded(rows, 1 << 14), _padded(fragments, 1 << 16)
    require_memory(
        fragments * BYTES_PER_FRAGMENT, "the search for contact", "use a coarser pitch"
    )
    # Points without extent cover no pixel.
    spare = _padded(len(frame), 1 << 12) - len(frame)
    frame = np.pad(frame, ((0, spare), (0, 0), (0, 0)))
    # Shapes are known while the rest of a scene is traced: contact is found there too.
    with jax.ensure_compile_time_eval():
        return peel(frame, width, height, (rows, fragments))


def _padded(count: int, least: int) -> int:
    """The next power of 4: few sizes, so that few programs are compiled."""
    bits = int(max(count, least) - 1).bit_length()
    return 1 << (bits + bits % 2)


def _points(layers: DepthLayers, which, axis: int, lattice: Lattice, box):
    """Where rays cross a surface, in the lattice's frame [m]."""
    row, column = np.divmod(layers.pixel[which], layers.width)
    cells = np.zeros((len(which), 3))
    cells[:, axis] = layers.depth[which]
    for across, pixel in zip(pixel_axes(axis), (row, column), strict=True):
        cells[:, across] = box[0][across] + (pixel + 0.5) / SAMPLES
    return lattice.origin + cells * lattice.pitch


def _unit_normals(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    vector = np.cross(b - a, c - a)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return vector / np.where(length > 0, length, 1)


# Which fragment of a body a point on its surface belongs to.


FARTHEST = 2.0
"""From a point to its fragment, in voxels; a part without any nearer has no voxels."""

AROUND = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))


class _Rays(NamedTuple):
    """The fragments of a body made along one axis, by ray and depth; all in cells."""

    axis: int
    shape: tuple[int, ...]
    fragment: Int[np.ndarray, " s"]
    position: Float[np.ndarray, "s 3"]
    outward: Float[np.ndarray, "s 3"]
    ray: Int[np.ndarray, " s"]
    key: Float[np.ndarray, " s"]
    """Ray and depth as one number."""


def nearest_fragments(
    grid: VoxelGrid,
    point: Float[np.ndarray, "k 3"],
    triangle: Int[np.ndarray, " k"],
) -> Int[np.ndarray, " k"]:
    """The fragment of a body on whose ray, or beside it, each point lies; -1 for none.

    Where a ray has none that faces the same way (a sliver beside an edge), the nearest
    one on the rays around it, along all three axes.

    Args:
        grid: the body.
        point: on its surface, own frame [m].
        triangle: of its mesh, in which each point lies.
    """
    normals, dominant = face_axes(grid.mesh)
    normal, own = normals[triangle], dominant[triangle]
    cells = grid.lattice.to_cells(point)
    rays = [_rays_along(grid, axis) for axis in range(3)]
    found = np.full(len(point), -1)
    distance = np.full(len(point), FARTHEST)
    for axis in range(3):
        mine = np.flatnonzero(own == axis)
        found[mine], distance[mine] = _on_ray(
            rays[axis], cells[mine], normal[mine], (0, 0)
        )
    left = np.flatnonzero(found < 0)
    for axis in range(3 if len(left) else 0):
        for offset in AROUND:
            other, apart = _on_ray(rays[axis], cells[left], normal[left], offset)
            nearer = apart < distance[left]
            found[left] = np.where(nearer, other, found[left])
            distance[left] = np.where(nearer, apart, distance[left])
    return found


def _rays_along(grid: VoxelGrid, axis: int) -> _Rays:
    mine = np.flatnonzero(grid.fragment_axis == axis)
    position = grid.lattice.to_cells(grid.fragment_position[mine])
    ray = _ray(position, axis, grid.solid.shape, (0, 0))
    key = _key(ray, position[:, axis], grid.solid.shape)
    order = np.argsort(key, kind="stable")
    return _Rays(
        axis,
        grid.solid.shape,
        mine[order],
        position[order],
        grid.fragment_normal[mine[order]],
        ray[order],
        key[order],
    )


def _ray(cells, axis, shape, offset):
    """Number of the ray through the column of cells beside a point's; -1 if outside."""
    place = np.floor(cells[:, list(pixel_axes(axis))]).astype(np.int64) + offset
    size = np.array([shape[a] for a in pixel_axes(axis)])
    within = ((place >= 0) & (place < size)).all(1)
    return np.where(within, place[:, 0] * size[1] + place[:, 1], -1)


def _key(ray, depth, shape):
    longest = max(shape)
    return ray * (longest + 1.0) + np.clip(depth, 0, longest)


def _on_ray(rays: _Rays, cells, normal, offset):
    """The nearest fragment on one ray beside each point, and its distance in cells."""
    found = np.full(len(cells), -1)
    distance = np.full(len(cells), FARTHEST)
    if not len(rays.ray):
        return found, distance
    ray = _ray(cells, rays.axis, rays.shape, offset)
    behind = np.searchsorted(rays.key, _key(ray, cells[:, rays.axis], rays.shape))
    for place in (behind - 1, behind):
        slot = np.clip(place, 0, len(rays.ray) - 1)
        apart = np.linalg.norm(cells - rays.position[slot], axis=1)
        faces = (rays.outward[slot] * normal).sum(1) > 0
        nearer = (rays.ray[slot] == ray) & faces & (apart < distance)
        found = np.where(nearer, rays.fragment[slot], found)
        distance = np.where(nearer, apart, distance)
    return found, distance
