"""Which fragment of a body a point on its surface belongs to."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...voxels.grid import VoxelGrid
from ...voxels.lattice import pixel_axes
from ...voxels.surface import face_axes


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
