"""Solid voxels from depth layers, by a vote of the three axes.

Along a ray the winding number rises by one where the ray enters the surface and falls
where it leaves. A voxel is inside for an axis if the number at its centre is not zero:
overlapping closed parts unite and cavities stay hollow. A ray on which entries and
exits do not balance has passed through a hole and does not vote. Solid is what a
majority votes for, also for open meshes.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from ..arrays import in_threads
from ..raster.fragments import DepthLayers
from .lattice import Views, pixel_axes


def first_cell_behind(depth: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of the first cell centre at or behind a depth, in units of cells."""
    return np.ceil(depth - 0.5).astype(np.int64)


def crossing_sign(layers: DepthLayers) -> Int8[np.ndarray, " k"]:
    """+1 where the ray enters the body, -1 where it leaves."""
    return np.where(layers.entering, 1, -1).astype(np.int8)


def balanced_rays(layers: DepthLayers) -> Bool[np.ndarray, " p"]:
    """Flag the pixels whose ray leaves the body as often as it enters."""
    pixels = layers.width * layers.height
    return np.bincount(layers.pixel, crossing_sign(layers), minlength=pixels) == 0


def _winding(
    layers: DepthLayers, axis: int, shape: tuple[int, int, int]
) -> Int8[np.ndarray, "x y z"]:
    """Winding number at each voxel centre along `axis`; 0 on rays without a vote."""
    row_axis, column_axis = pixel_axes(axis)
    cell = first_cell_behind(layers.depth)
    counts = np.flatnonzero(balanced_rays(layers)[layers.pixel] & (cell < shape[axis]))
    index: list = [None, None, None]
    index[axis] = np.maximum(cell[counts], 0)
    index[row_axis], index[column_axis] = np.divmod(layers.pixel[counts], layers.width)
    winding = np.zeros(shape, np.int8)
    # int8 may wrap in between: only the final sums must fit.
    np.add.at(winding, tuple(index), crossing_sign(layers)[counts])
    if axis == 2:
        return np.cumsum(winding, axis=2, dtype=np.int8, out=winding)
    planes = np.moveaxis(winding, axis, 0)
    # Plane by plane is contiguous and several times faster than a strided cumsum.
    for k in range(1, len(planes)):
        planes[k] += planes[k - 1]
    return winding


def fill_by_vote(
    views: Views, shape: tuple[int, int, int]
) -> Bool[np.ndarray, "x y z"]:
    """Solid voxels by majority of the votes of the three views."""
    # int8 throughout: the largest arrays of the voxelization set its memory.
    votes = np.zeros(shape, np.int8)
    cast = []
    votes_of = lambda axis: _winding(views[axis], axis, shape) != 0
    for axis, own in enumerate(in_threads(votes_of, range(3))):
        layers = views[axis]
        votes += own
        rays = balanced_rays(layers).reshape(layers.height, layers.width)
        # Rows before columns, as the lattice has them, with the depth axis of length 1.
        ordered = rays if pixel_axes(axis)[0] < pixel_axes(axis)[1] else rays.T
        cast.append(np.expand_dims(ordered, axis).astype(np.int8))
    # Solid where 2 x votes for > votes cast.
    votes *= 2
    for x, plane in enumerate(votes):
        plane -= cast[0][0] + cast[1][x] + cast[2][x]
    return votes > 0
