"""Fractions of the voxels and the surface of a body that lie within a selection.

The border of a part of space divides voxels. A voxel is a box here, which ends at the
surface where the surface cuts its link to an empty neighbour; a surface fragment is the
projection of that box onto its plane, along the ray of the fragment or, where that is
steep, along the normal. Volumes and areas within a box are then exact for bodies along
the lattice, and within 1 % for balls and cylinders of ten voxels. Where voxels are
whole, also at the surface, the fractions of all voxels have one factor with which their
volume is that of the body, as its cut voxels have it.
"""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ..arrays import flat_index
from ..geometry.mesh import Mesh
from ..memo.found import found
from .abstract_grid import AbstractGrid
from .grid import VoxelGrid
from .selection import (
    AbstractSelection,
    AbstractSpace,
    FragmentCentres,
    SurfaceSamples,
)
from .spread_points import spread_points
from .surface import face_axes
from .voxelize import voxelize


# Voxels and fragments that are computed at once.
_VOXELS = 2**16
_FRAGMENTS = 2**10

# A ray that passes a voxel's centre nearer than this goes through it [cells].
_ON_RAY = 1e-6

# Extent of a voxel from its centre to the surface [cells].
_MIN_EXTENT = 0.01
_MAX_EXTENT = 1.25

_CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T.astype(float)
"""Corners of a unit cube."""

# Pieces of triangles at the border of a selection, for each voxel.
_FINEST = 16

# Largest distance of a fragment's points from its centre [voxels].
_REACH = 4.0

# Rays steeper than this against the surface do not project a voxel onto it.
_MIN_SLOPE = 0.5


def volume_fractions(space: AbstractSpace, grid: VoxelGrid) -> Float[np.ndarray, " v"]:
    """Fraction of each solid voxel, in lattice order, that lies in a part of space.

    Their sum is the volume of the body within it: fractions of a grid with the dominant
    axis, whose voxels are whole, may exceed 1.
    """
    return found(
        (grid,),
        _key("volume_fractions", space),
        lambda: _volume_fractions(space, grid),
    )


def _key(search: str, selection: AbstractSelection) -> Hashable:
    """Values that a finding depends on; None for a selection with arrays."""
    leaves, structure = jax.tree.flatten(selection)
    return None if leaves else (search, structure)


def _volume_fractions(space: AbstractSpace, grid: VoxelGrid) -> Float[np.ndarray, " v"]:
    fraction = _fractions_of_boxes(space, grid)
    # Bodies of another volume than their whole voxels have a surface within voxels. The
    # factor is not at the border alone, which may be between two planes of voxels.
    if grid.cut is None and grid.volume_ratio != 1 and fraction.any():
        cut_grid = voxelize(grid.mesh, grid.pitch)
        cut_fraction = _fractions_of_boxes(space, cut_grid)
        share = np.average(cut_fraction, weights=cut_grid.solid_volumes)
        fraction *= float(share) / fraction.mean()
    return fraction


def _fractions_of_boxes(
    space: AbstractSpace, grid: VoxelGrid
) -> Float[np.ndarray, " v"]:
    flat = np.flatnonzero(grid.solid)
    fraction = np.empty(len(flat))
    for start in range(0, len(flat), _VOXELS):
        chunk = slice(start, start + _VOXELS)
        boxes = _boxes(grid, flat[chunk])
        fraction[chunk] = space.fraction_of_boxes(
            grid.origin + boxes.low * grid.pitch, grid.origin + boxes.high * grid.pitch
        )
    return fraction


def selected_area(
    selection: AbstractSelection | None, grids: Sequence[AbstractGrid]
) -> float:
    """Area of the bodies of a scene that is selected [m^2]; of all for None."""
    area = 0.0
    if selection is None:
        for grid in grids:
            reached = grid.reached_by(None)
            selected = slice(None) if reached is None else reached
            area += float(grid.fragment_area[selected].sum())
        return area
    for body, grid in enumerate(grids):
        on_body = selection.on_body(body)
        if on_body is not None:
            area += float(area_fractions(on_body, grid) @ grid.fragment_area)
    return area


def area_fractions(
    selection: AbstractSelection, grid: AbstractGrid
) -> Float[np.ndarray, " s"]:
    """Fraction of each surface fragment that is selected.

    That of an adiabatic face is 0 unless the selection names it.
    """

    def find() -> Float[np.ndarray, " s"]:
        if isinstance(grid, VoxelGrid):
            return _area_fractions(selection, grid)
        fraction = grid.selected_fraction(selection)
        reached = grid.reached_by(selection)
        return fraction if reached is None else fraction * reached

    return found((grid,), _key("area_fractions", selection), find)


def _area_fractions(
    selection: AbstractSelection, grid: VoxelGrid
) -> Float[np.ndarray, " s"]:
    position = grid.fragment_position
    fraction = selection.select(grid.fragment_centres).astype(float)
    reach = _REACH * grid.pitch
    near = np.flatnonzero(selection.divides(position - reach, position + reach))
    for start in range(0, len(near), _FRAGMENTS):
        chunk = near[start : start + _FRAGMENTS]
        boxes = _boxes_of_fragments(grid, chunk)
        corners = _projected(grid, fragment=chunk, boxes=boxes, points=_CORNERS)
        is_divided = selection.divides(corners.min(axis=0), corners.max(axis=0))
        divided = np.flatnonzero(is_divided)
        if not len(divided):
            continue
        points = _projected(
            grid,
            fragment=chunk[divided],
            boxes=boxes.selected(divided),
            points=spread_points(3),
        )
        samples = SurfaceSamples(
            fragments=grid.fragment_centres, fragment=chunk[divided], points=points
        )
        fraction[chunk[divided]] = selection.contains_samples(samples).mean(axis=0)
    is_partial = ((fraction > 0) & (fraction < 1)).any()
    # A mesh that is open or has overlapping parts has another area than its body.
    if is_partial and selection.is_geometric and not grid.unscaled_because:
        _adjust_total(fraction, selection, grid)
    return fraction


def _adjust_total(
    fraction: Float[np.ndarray, " s"], selection: AbstractSelection, grid: VoxelGrid
) -> None:
    """Give fractions between 0 and 1 the area of the mesh, in place.

    Pieces of surface beside edges, and where it curves, are not planes.
    """
    mesh = grid.mesh
    exact = _selected_mesh_area(selection, mesh, grid.pitch / _FINEST)
    area = grid.fragment_area
    # Fragments of thin parts may be lost.
    exact *= float(area.sum()) / mesh.area
    missing = exact - float((area * fraction).sum())
    divided = (fraction > 0) & (fraction < 1)
    room = np.where(divided, 1 - fraction if missing > 0 else fraction, 0)
    available = float((area * room).sum())
    fraction += room * np.clip(missing / available, -1, 1)


def _selected_mesh_area(selection: AbstractSelection, mesh: Mesh, size: float) -> float:
    """Area of a mesh that is selected, with pieces of a size at the border [m^2]."""
    triangles = mesh.triangles
    normal, _ = face_axes(mesh)
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    total = 0.0
    while len(triangles):
        sides = triangles - np.roll(triangles, 1, axis=1)
        is_large = np.square(sides).sum(axis=2).max(axis=1) > size**2
        is_divided = selection.divides(triangles.min(axis=1), triangles.max(axis=1))
        is_cut = is_large & is_divided
        whole = ~is_cut
        centres = FragmentCentres(triangles[whole].mean(axis=1), normal[whole])
        is_selected = selection.select(centres)
        total += float(area[whole][is_selected].sum())
        corners = triangles[is_cut]
        middles = (corners + np.roll(corners, -1, axis=1)) / 2
        at_corners = [
            np.stack([corners[:, n], middles[:, n], middles[:, n - 1]], axis=1)
            for n in range(3)
        ]
        triangles = np.concatenate([middles, *at_corners])
        normal = np.tile(normal[is_cut], (4, 1))
        area = np.tile(area[is_cut] / 4, 4)
    return total


class _Boxes(NamedTuple):
    """Boxes of voxels [cells]."""

    low: Float[np.ndarray, "n 3"]
    """Lowest corner."""
    high: Float[np.ndarray, "n 3"]
    """Highest corner."""
    centre: Float[np.ndarray, "n 3"]
    """Centre of the whole voxel."""

    def selected(self, which: Int[np.ndarray, " k"]) -> "_Boxes":
        """Some of the boxes."""
        return _Boxes(*(corner[which] for corner in self))


def _boxes(grid: VoxelGrid, flat: Int[np.ndarray, " n"]) -> _Boxes:
    """Boxes of solid voxels, by their ascending numbers in the lattice."""
    voxel = np.stack(np.unravel_index(flat, grid.solid.shape), axis=1)
    low = voxel.astype(float)
    high = low + 1
    if grid.cut is None:
        return _Boxes(low=low, high=high, centre=voxel + 0.5)
    # Fragments are in the order of their voxels.
    owner = flat_index(grid.fragment_voxel, grid.solid.shape)
    first, last = np.searchsorted(owner, [flat[0], flat[-1] + 1])
    for axis in range(3):
        crossing = first + np.flatnonzero(grid.fragment_axis[first:last] == axis)
        offset = grid.lattice.to_cells(grid.fragment_position[crossing])
        offset -= grid.fragment_voxel[crossing] + 0.5
        across = np.delete(offset, axis, axis=1)
        on_ray = np.abs(across).max(axis=1, initial=0) < _ON_RAY
        crossing = crossing[on_ray]
        along = offset[on_ray, axis]
        ahead = grid.fragment_normal[crossing, axis] > 0
        slot: Any = np.searchsorted(flat, owner[crossing])
        for end, is_chosen, sign in ((high, ahead, 1), (low, ~ahead, -1)):
            extent = np.clip(sign * along[is_chosen], _MIN_EXTENT, _MAX_EXTENT)
            chosen = slot[is_chosen]
            end[chosen, axis] = voxel[chosen, axis] + 0.5 + sign * extent
    return _Boxes(low=low, high=high, centre=voxel + 0.5)


def _boxes_of_fragments(grid: VoxelGrid, fragment: Int[np.ndarray, " m"]) -> _Boxes:
    """Boxes that fragments are projections of: their voxels, or those on their rays."""
    position = grid.lattice.to_cells(grid.fragment_position[fragment])
    boxes = _Boxes(low=position - 0.5, high=position + 0.5, centre=position)
    if grid.cut is None:
        return boxes
    owner = flat_index(grid.fragment_voxel[fragment], grid.solid.shape)
    flat, slot = np.unique(owner, return_inverse=True)
    of_voxel = _boxes(grid, flat).selected(slot.reshape(-1))
    axis = grid.fragment_axis[fragment].astype(int)
    offset = np.abs(position - (grid.fragment_voxel[fragment] + 0.5))
    offset[np.arange(len(axis)), axis] = 0
    on_ray = (offset.max(axis=1, initial=0) < _ON_RAY)[:, None]
    return _Boxes(
        low=np.where(on_ray, of_voxel.low, boxes.low),
        high=np.where(on_ray, of_voxel.high, boxes.high),
        centre=np.where(on_ray, of_voxel.centre, boxes.centre),
    )


def _projected(
    grid: VoxelGrid,
    fragment: Int[np.ndarray, " m"],
    boxes: _Boxes,
    points: Float[np.ndarray, "p 3"],
) -> Float[np.ndarray, "p m 3"]:
    """Points of a unit cube in the boxes of fragments, projected onto them [m]."""
    normal = grid.fragment_normal[fragment]
    axis = grid.fragment_axis[fragment].astype(int)
    rows = np.arange(len(axis))
    slope = normal[rows, axis]
    along_ray = np.zeros_like(normal)
    along_ray[rows, axis] = 1 / np.where(slope == 0, 1, slope)
    is_steep = np.abs(slope) < _MIN_SLOPE
    direction = np.where(is_steep[:, None], normal, along_ray)
    in_box = boxes.low + points[:, None] * (boxes.high - boxes.low)
    offset = (in_box - boxes.centre) * grid.pitch
    height = np.einsum("pmi,mi->pm", offset, normal)
    offset -= height[..., None] * direction
    return grid.fragment_position[fragment] + offset
