"""Links of single voxels that the surface cuts, for a stencil of whole ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...voxels.grid import VoxelGrid


# Open areas nearer to whole faces are whole but for rounding [voxel faces].
_WHOLE = 1e-12


class _CutLinks(NamedTuple):
    """Voxels that are cut or linked through less or more than a voxel face."""

    voxel: Int[np.ndarray, "m 3"]
    """In lattice order."""
    src: Int[np.ndarray, " e"]
    """First of these voxels of each link, sorted."""
    dst: Int[np.ndarray, " e"]
    axis: Int[np.ndarray, " e"]
    open_area: Float[np.ndarray, " e"]
    """[voxel faces]"""


def cut_links(grid: VoxelGrid) -> _CutLinks:
    """Links of the cut voxels of a grid to each other and to whole ones."""
    cut = grid.cut
    if cut is None:
        none = np.zeros(0, np.int64)
        return _CutLinks(np.zeros((0, 3), np.int64), none, none, none, np.zeros(0))
    padded = np.pad(grid.solid, 1)
    flat = np.asarray(np.ravel_multi_index(tuple(cut.voxel.T + 1), padded.shape))
    own, solid = np.full(padded.size, -1, np.int32), padded.reshape(-1)
    own[flat] = np.arange(len(flat))
    _, y, z = padded.shape
    low, high, axes, areas = [], [], [], []
    for axis, jump in enumerate((y * z, z, 1)):
        # Every voxel with the next one, and those before that are not cut themselves.
        before = flat - jump
        before = before[solid[before] & (own[before] < 0)]
        first = np.concatenate([flat[solid[flat + jump]], before])
        opened = np.append(cut.open_area[:, axis], 1.0)
        area = (opened[own[first]] + opened[own[first + jump]]) / 2
        kept = np.abs(area - 1) > _WHOLE
        low.append(first[kept])
        high.append(first[kept] + jump)
        axes.append(np.full(np.count_nonzero(kept), axis))
        areas.append(area[kept])
    src, dst, axis, area = map(np.concatenate, (low, high, axes, areas))
    node = np.unique(np.concatenate([flat, src, dst]))
    order = np.lexsort([dst, src])
    return _CutLinks(
        voxel=np.stack(np.unravel_index(node, padded.shape), axis=1) - 1,
        src=np.searchsorted(node, src[order]).astype(np.int32),
        dst=np.searchsorted(node, dst[order]).astype(np.int32),
        axis=axis[order],
        open_area=area[order],
    )
