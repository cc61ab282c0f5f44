"""Solid voxels from depth layers, by a vote of the three axes.

Along a ray the winding number rises by one where the ray enters the surface and falls
where it leaves. A voxel is inside for an axis if the number at its centre is not zero:
overlapping closed parts unite and cavities stay hollow. A ray on which entries and
exits do not balance has passed through a hole and does not vote. Solid is what a
majority votes for, also for open meshes.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from ..arrays import stable_order
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


# Cells whose votes are counted at once: arrays of all would be several times the solid.
_CHUNK_CELLS = 2**19


class _Events(NamedTuple):
    """Changes of the winding number along the rays of one axis, sorted by x."""

    cell: tuple[np.ndarray, ...]
    sign: Int8[np.ndarray, " k"]

    @classmethod
    def of(
        cls,
        layers: DepthLayers,
        votes: Bool[np.ndarray, " p"],
        axis: int,
        length: int,
    ) -> "_Events":
        """Those of rays that vote, at the first cell behind each crossing."""
        row_axis, column_axis = pixel_axes(axis)
        behind = first_cell_behind(layers.depth)
        counts = np.flatnonzero(votes[layers.pixel] & (behind < length))
        cell: list[np.ndarray] = [np.zeros(0)] * 3
        cell[axis] = np.maximum(behind[counts], 0).astype(np.int32)
        along = np.divmod(layers.pixel[counts], layers.width)
        cell[row_axis], cell[column_axis] = (each.astype(np.int32) for each in along)
        order = stable_order(cell[0])
        sign = crossing_sign(layers)[counts][order]
        return cls(tuple(index[order] for index in cell), sign)

    def within(
        self, start: int, stop: int
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Cells, counted from the first plane, and signs in a range of planes."""
        own = slice(*np.searchsorted(self.cell[0], [start, stop]))
        x, y, z = (index[own] for index in self.cell)
        return (x - start, y, z), self.sign[own]


def fill_by_vote(
    views: Views, shape: tuple[int, int, int]
) -> Bool[np.ndarray, "x y z"]:
    """Solid voxels by majority of the votes of the three views."""
    events, cast = [], []
    for axis, layers in enumerate(views):
        rays = balanced_rays(layers)
        events.append(_Events.of(layers, rays, axis, shape[axis]))
        cast.append(_votes_cast(rays.reshape(layers.height, layers.width), axis))
    solid = np.empty(shape, bool)
    before = np.zeros(shape[1:], np.int8)
    planes = max(_CHUNK_CELLS // before.size, 1)
    for start in range(0, shape[0], planes):
        chunk = solid[start : start + planes]
        # Solid where 2 x votes for > votes cast.
        votes = np.zeros(chunk.shape, np.int8)
        for axis, each in enumerate(events):
            # int8 may wrap in between: only the final sums must fit.
            winding = np.zeros(chunk.shape, np.int8)
            cell, sign = each.within(start, start + len(chunk))
            np.add.at(winding, cell, sign)
            if axis == 0:
                winding[0] += before
            _sum_along(winding, axis)
            if axis == 0:
                before = winding[-1].copy()
            votes += winding != 0
        votes *= 2
        votes -= cast[0] + cast[1][start : start + planes]
        votes -= cast[2][start : start + planes]
        np.greater(votes, 0, out=chunk)
    return solid


def _sum_along(winding: Int8[np.ndarray, "x y z"], axis: int) -> None:
    """Running sum along an axis, in place."""
    if axis == 2:
        np.cumsum(winding, axis=2, dtype=np.int8, out=winding)
        return
    planes = np.moveaxis(winding, axis, 0)
    # Plane by plane is contiguous and several times faster than a strided cumsum.
    for k in range(1, len(planes)):
        planes[k] += planes[k - 1]


def _votes_cast(
    rays: Bool[np.ndarray, "rows columns"], axis: int
) -> Int8[np.ndarray, "u v w"]:
    """1 on rays that vote, on the lattice, with a length of 1 along the axis."""
    # Rows before columns, as the lattice has them.
    ordered = rays if pixel_axes(axis)[0] < pixel_axes(axis)[1] else rays.T
    return np.expand_dims(ordered, axis).astype(np.int8)
