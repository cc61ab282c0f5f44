"""Fragments of a body's surface that points on it belong to.

A point on a solid belongs to the nearest fragment on its ray; one on a sheet to the
third of a triangle in which it lies, on the face that is touched.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...geometry.vectors import row_dot
from ...sheets.sheet_grid import SheetGrid
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.grid import VoxelGrid
from ...voxels.lattice import pixel_axes
from ...voxels.surface import face_axes


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
    grid: AbstractGrid,
    point: Float[np.ndarray, "k 3"],
    triangle: Int[np.ndarray, " k"],
    is_back: Bool[np.ndarray, " k"],
) -> list[_FragmentShares]:
    """Fragments to which the area around each point on a body's surface belongs.

    Args:
        grid: of the body.
        point: in the body's frame [m].
        triangle: number of the triangle of `surface_triangles` that each point is in.
        is_back: True for points on the back of a sheet.
    """
    if isinstance(grid, SheetGrid):
        fragment = grid.fragments_at(point, triangle=triangle, is_back=is_back)
        return [(fragment, np.ones(len(point)))]
    assert isinstance(grid, VoxelGrid)
    return _solid_shares(grid, point, triangle)


def _solid_shares(
    grid: VoxelGrid, point: Float[np.ndarray, "k 3"], triangle: Int[np.ndarray, " k"]
) -> list[_FragmentShares]:
    # Where there are fragments on rays of all axes a, the one along a has the share
    # n_a^2, as everywhere on the surface.
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
