"""Surface fragments from depth layers, each with its voxel.

Thesis 4.2 keeps a fragment in the view along the dominant axis of its normal. The ray
grid of that view cuts the surface into pieces of area pitch^2 / |n_i| (the thesis' own
pitch^2 gives only 83 % of a sphere's area, exposed voxel faces 150 %).
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry.mesh import Mesh
from ..raster.fragments import SNAP, DepthLayers
from .fill import balanced_rays, crossing_sign, first_cell_behind
from .lattice import pixel_axes


# Rounding of depths [cells], and how far in the view the point is whose depth a
# crossing has, as corners are snapped [cells].
_ROUNDED = 1e-4
_SNAPPED = math.sqrt(0.5) / SNAP

# Largest difference of depths that snapping explains [cells]: steeper sheets have
# hardly any area in the view.
_MAX_DIFFERENCE = 0.1


def positions(layers: DepthLayers, axis: int) -> Float[np.ndarray, "k 3"]:
    """Positions of the crossings of a view along an axis [cells]."""
    row_axis, column_axis = pixel_axes(axis)
    row, column = np.divmod(layers.pixel, layers.width)
    position = np.empty((len(layers.pixel), 3))
    position[:, row_axis] = row + 0.5
    position[:, column_axis] = column + 0.5
    position[:, axis] = layers.depth
    return position


def hidden_inside(
    layers: DepthLayers, slope: Float[np.ndarray, " f"]
) -> Bool[np.ndarray, " k"]:
    """Flag crossings that are no surface of the body, where parts overlap or touch.

    Sheets at one depth are one surface: of a group that leads into the body, or out of
    it, a single crossing is left; of one with the body on both sides none.

    Args:
        layers: crossings of the rays along one axis.
        slope: |n_a| of every triangle along that axis.
    """
    if not len(layers.pixel):
        return np.zeros(0, bool)
    step = crossing_sign(layers).astype(np.int64)
    # Balanced rays sum to zero, so one running sum serves all of them; a ray through a
    # hole is left out, and nothing on it is hidden.
    balanced = balanced_rays(layers)[layers.pixel]
    winding = np.cumsum(np.where(balanced, step, 0))
    is_new = np.append(True, ~_same_depth(layers, slope))
    group = np.cumsum(is_new) - 1
    start = np.flatnonzero(is_new)
    last = np.append(start[1:], len(winding)) - 1
    before = (winding - step)[start]
    after = winding[last]
    changes_sides = (before != 0) != (after != 0)
    hidden = (changes_sides | ((before != 0) & (after != 0)))[group] & balanced
    # The first crossing of a group that leads to where the ray is after all of them.
    direction = np.where(changes_sides, after - before, 0)
    leading = np.flatnonzero(step * direction[group] > 0)
    is_first = np.diff(group[leading], prepend=-1) != 0
    hidden[leading[is_first]] = False
    return hidden


def _same_depth(
    layers: DepthLayers, slope: Float[np.ndarray, " f"]
) -> Bool[np.ndarray, " pairs"]:
    """Flag crossings whose successor on the ray has the same depth, but for errors."""
    apart = np.diff(layers.depth)
    is_same = (np.diff(layers.pixel) == 0) & (apart <= _MAX_DIFFERENCE)
    near = np.flatnonzero(is_same)
    pair_slope = slope[layers.triangle[np.stack([near, near + 1])]]
    # In depth the error in the view is as much larger as the sheet is steep.
    steepness = np.sqrt(np.maximum(1 - np.square(pair_slope), 0)) / np.maximum(
        pair_slope, 1e-9
    )
    is_same[near] = apart[near] <= _ROUNDED + _SNAPPED * steepness.sum(axis=0)
    return is_same


def selected(layers: DepthLayers, keep: Bool[np.ndarray, " k"]) -> DepthLayers:
    """Select crossings by mask."""
    # Layers keep their original numbers.
    arrays = ("pixel", "depth", "triangle", "entering", "layer")
    return replace(layers, **{name: getattr(layers, name)[keep] for name in arrays})


def thickness_behind(layers: DepthLayers) -> Float[np.ndarray, " k"]:
    """Depth of the body behind each crossing [cells]; inf where it has no far side."""
    entering = layers.entering
    partner = np.arange(len(entering)) + np.where(entering, 1, -1)
    partner = np.clip(partner, 0, max(len(entering) - 1, 0))
    paired = (layers.pixel[partner] == layers.pixel) & (entering[partner] != entering)
    return np.where(paired, np.abs(layers.depth[partner] - layers.depth), np.inf)


def joined_columns(tables: list[Any]) -> Iterator[np.ndarray]:
    """Columns of several NamedTuples, one after the other.

    The list is emptied: each column is freed as soon as it is joined.
    """
    rows = [list(table) for table in tables]
    tables.clear()
    while rows[0]:
        yield np.concatenate([row.pop(0) for row in rows])


class AxisFragments(NamedTuple):
    """Fragments of the view along one axis, sorted by pixel and depth."""

    position: Float[np.ndarray, "s 3"]
    """Position [cells]."""
    triangle: Int[np.ndarray, " s"]
    ray: Int[np.ndarray, " s"]
    """Number of the ray, counted over all three views."""
    layer: Int[np.ndarray, " s"]
    """Depth layer in the view."""
    inward_cell: Int[np.ndarray, "s 3"]
    """First cell on the ray whose centre lies inside."""
    thickness: Float[np.ndarray, " s"]
    """Distance along the ray to the other side of the body [cells]."""


def face_axes(mesh: Mesh) -> tuple[Float[np.ndarray, "f 3"], Int[np.ndarray, " f"]]:
    """Outward normal of each face and its dominant axis; -1 for a face without area."""
    vectors = mesh.area_vectors
    length = np.linalg.norm(vectors, axis=1)
    normal = vectors / np.where(length > 0, length, 1)[:, None]
    return normal, np.where(length > 0, dominant_axis(normal), -1)


def dominant_axis(normal: Float[np.ndarray, "s 3"]) -> Int[np.ndarray, " s"]:
    """Axis along which each normal is longest, the first of several."""
    # As by `argmax`, which is slow along an axis of length three.
    x, y, z = np.abs(normal.T)
    return np.where((x >= y) & (x >= z), 0, np.where(y >= z, 1, 2))


def axis_fragments(
    layers: DepthLayers,
    normals: Float[np.ndarray, "f 3"],
    dominant: Int[np.ndarray, " f"],
    axis: int,
    first_ray: int,
) -> tuple[AxisFragments, Int[np.ndarray, " h"]]:
    """Surface fragments of one view, and the triangles of those hidden inside.

    A fragment counts in the view along the dominant axis of its triangle; `first_ray`
    is the number of this view's first ray among those of all views.
    """
    hidden = hidden_inside(layers, np.abs(normals[:, axis]))
    inside = layers.triangle[hidden]
    outer = selected(layers, ~hidden)
    on_axis = dominant[outer.triangle] == axis
    thickness = thickness_behind(outer)[on_axis]
    outer = selected(outer, on_axis)
    position = positions(outer, axis)
    cell = position.astype(np.int32)
    behind = first_cell_behind(outer.depth)
    cell[:, axis] = np.where(outer.entering, behind, behind - 1)
    fragments = AxisFragments(
        position=position,
        triangle=outer.triangle.astype(np.int32),
        ray=outer.pixel + first_ray,
        layer=outer.layer.astype(np.int32),
        inward_cell=cell,
        thickness=thickness,
    )
    return fragments, inside[dominant[inside] == axis]


def attach_to_solid(
    solid: Bool[np.ndarray, "x y z"],
    position: Float[np.ndarray, "s 3"],
    inward_cell: Int[np.ndarray, "s 3"],
) -> tuple[Int[np.ndarray, "s 3"], Bool[np.ndarray, " s"]]:
    """Assign each fragment to a solid voxel; flag those without one nearby as lost."""
    # The first cell inward is solid wherever the body is a voxel thick. Elsewhere the
    # nearest solid voxel within two cells is taken.
    last = np.subtract(solid.shape, 1).astype(inward_cell.dtype)
    cell = np.clip(inward_cell, 0, last)
    stray = np.flatnonzero(~solid[tuple(cell.T)])
    lost = np.zeros(len(cell), bool)
    # Few at a time: all could need more memory than the voxels.
    for first in range(0, len(stray), _CHUNK):
        chunk = stray[first : first + _CHUNK]
        cell[chunk], lost[chunk] = _nearest_solid(solid, position[chunk], cell[chunk])
    return cell, lost


# Cells whose surroundings are searched at once.
_CHUNK = 2**10


def _nearest_solid(
    solid: Bool[np.ndarray, "x y z"],
    position: Float[np.ndarray, "k 3"],
    start: Int[np.ndarray, "k 3"],
) -> tuple[Int[np.ndarray, "k 3"], Bool[np.ndarray, " k"]]:
    """Solid voxel nearest to each position, within two cells of a start.

    Where there is none, the start is returned and flagged.
    """
    candidate = []
    squared = []
    within = []
    for axis, length in enumerate(solid.shape):
        along = start[:, axis, None] + np.arange(-2, 3)
        squared.append((along + 0.5 - position[:, axis, None]) ** 2)
        within.append((along >= 0) & (along < length))
        candidate.append(np.clip(along, 0, length - 1))
    # Every combination of the three axes.
    x, y, z = _spread(squared)
    distance = x + y + z
    x, y, z = _spread(within)
    distance[~(solid[_spread(candidate)] & x & y & z)] = np.inf
    flat = distance.reshape(len(start), -1)
    best = flat.argmin(axis=1)
    lost = np.isinf(flat[np.arange(len(start)), best])
    nearest = start + np.stack(np.unravel_index(best, (5, 5, 5)), axis=1) - 2
    return np.where(lost[:, None], start, nearest), lost


def _spread(columns: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Rows of numbers along x, y and z, each along an axis of its own."""
    x, y, z = columns
    return x[:, :, None, None], y[:, None, :, None], z[:, None, None]


def surface_voxels(solid: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "m 3"]:
    """Solid voxels with an empty face neighbour, in lattice order."""
    exposed = np.zeros(solid.shape, bool)
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        open_side = np.moveaxis(exposed, axis, 0)
        open_side[1:] |= ~body[:-1]
        open_side[:-1] |= ~body[1:]
        open_side[[0, -1]] = True
    exposed &= solid
    return np.argwhere(exposed)


def surface_links(
    voxels: Int[np.ndarray, "m 3"], shape: tuple[int, int, int]
) -> Int[np.ndarray, "e 2"]:
    """Pairs of voxels that touch over a face, an edge or a corner (thesis 4.2)."""
    # A rim of one cell, so that no jump to a neighbour wraps around.
    padded = np.array(shape) + 2
    strides = np.array([padded[1] * padded[2], padded[2], 1])
    key = (voxels + 1) @ strides
    slot = np.full(int(padded.prod()), -1, np.int32)
    slot[key] = np.arange(len(voxels), dtype=np.int32)
    offsets = np.indices((3, 3, 3)).reshape(3, -1).T - 1
    pairs = []
    # The half of the 26 neighbours that come later in lattice order.
    for jump in (offsets @ strides)[14:]:
        neighbour = slot[key + jump]
        linked = np.flatnonzero(neighbour >= 0)
        pairs.append(np.stack([linked.astype(np.int32), neighbour[linked]], axis=1))
    return np.concatenate(pairs)
