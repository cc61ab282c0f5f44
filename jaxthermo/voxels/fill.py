"""Filling: three axes vote on every voxel, so that open meshes still fill.

Along a ray the winding number rises by one where the ray enters the surface and falls
where it leaves. A voxel is inside for an axis if the number at its centre is not zero:
overlapping closed parts unite and cavities stay hollow. A ray on which entries and
exits do not balance has passed a hole and casts no vote; a voxel is solid if more than
half of the votes cast on it say so.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..raster.layers import DepthLayers


def first_cell_behind(depth: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of the first cell centre at or behind a depth, in units of cells."""
    return np.ceil(depth - 0.5).astype(np.int64)


def pixel_axes(axis: int) -> tuple[int, int]:
    """Lattice axes of the rows and columns of the view along `axis`."""
    return (axis + 1) % 3, (axis + 2) % 3


def _winding(
    layers: DepthLayers,
    entering: Bool[np.ndarray, " k"],
    axis: int,
    shape: tuple[int, int, int],
) -> Int[np.ndarray, "..."]:
    """Winding number at each voxel centre along `axis`, then the ray's end balance."""
    row_axis, column_axis = pixel_axes(axis)
    size = list(shape)
    size[axis] += 1
    winding = np.zeros(size, np.int8)
    index: list = [None, None, None]
    index[axis] = np.clip(first_cell_behind(layers.depth), 0, shape[axis])
    index[row_axis], index[column_axis] = np.divmod(layers.pixel, layers.width)
    np.add.at(winding, tuple(index), np.where(entering, 1, -1).astype(np.int8))
    if axis == 2:
        return np.cumsum(winding, axis=2, dtype=np.int8, out=winding)
    planes = np.moveaxis(winding, axis, 0)
    # Plane by plane is contiguous and several times faster than a strided cumsum.
    for k in range(1, len(planes)):
        planes[k] += planes[k - 1]
    return winding


def fill_by_vote(
    views: list[tuple[DepthLayers, Bool[np.ndarray, " k"]]],
    shape: tuple[int, int, int],
) -> Bool[np.ndarray, "x y z"]:
    """Solid voxels by a majority of the axes' votes.

    Args:
        views: for each axis its depth layers and which fragments enter the body.
        shape: voxels along x, y, z.
    """
    votes = np.zeros(shape, np.int8)
    for axis, (layers, entering) in enumerate(views):
        winding = np.moveaxis(_winding(layers, entering, axis, shape), axis, 0)
        balanced = winding[-1] == 0
        # A vote for counts +1, against -1, none 0: solid where the sum is positive.
        ballot = np.moveaxis(votes, axis, 0)
        for plane, count in zip(winding[:-1], ballot, strict=True):
            count += np.where(balanced, np.where(plane != 0, 1, -1), 0).astype(np.int8)
    return votes > 0
