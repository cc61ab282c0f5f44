"""Links of an irregular structure: lattice faces within a level, contacts between."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..structure import Links
from .irregular_cells import LevelCells
from .voxel_assignment import Territory


class _Pairs(NamedTuple):
    """Pairs of cells, src < dst, each once, in order; lengths in voxels."""

    key: Int[np.ndarray, " k"]
    """src * number of cells + dst."""
    area: Float[np.ndarray, " k"]
    distance_src: Float[np.ndarray, " k"]
    distance_dst: Float[np.ndarray, " k"]


def irregular_links(levels: LevelCells, territory: Territory, pitch: float) -> Links:
    """All links, sorted.

    Two cells of level l that share a face of their lattice have the area (2^l h)^2 and
    half a cell on either side. All others that touch in the division of the body have
    the area of the voxel faces between them, and on either side half a cell and the
    mean gap that the division bridged.

    Args:
        levels: cells of each level, that of level l being 2^l voxels wide.
        territory: the division of the body among them.
        pitch: edge of a voxel h [m].
    """
    counts = [len(cells) for cells in levels]
    half = np.repeat(0.5 * (1 << np.arange(len(levels))), counts)
    lattice, contact = _lattice_pairs(levels, half), _contacts(territory, half)
    apart = ~np.isin(contact.key, lattice.key, assume_unique=True)
    pairs = _Pairs(
        *(
            np.concatenate([ours, theirs[apart]])
            for ours, theirs in zip(lattice, contact, strict=True)
        )
    )
    order = np.argsort(pairs.key)
    src, dst = np.divmod(pairs.key[order], max(len(half), 1))
    return Links(
        src=src.astype(np.int32),
        dst=dst.astype(np.int32),
        area=pairs.area[order] * pitch**2,
        distance_src=pairs.distance_src[order] * pitch,
        distance_dst=pairs.distance_dst[order] * pitch,
    )


def _lattice_pairs(levels: LevelCells, half: Float[np.ndarray, " n"]) -> _Pairs:
    """Cells of one level that share a face."""
    pairs, first = [np.zeros((2, 0), np.int64)], 0
    for cells in levels:
        shape = cells.max(axis=0, initial=0) + 2
        key = np.asarray(np.ravel_multi_index(tuple(cells.T), tuple(shape)))
        for stride in (shape[1] * shape[2], shape[2], 1):
            place = np.searchsorted(key, key + stride)
            here = np.flatnonzero(np.append(key, -1)[place] == key + stride)
            pairs.append(first + np.stack([here, place[here]]))
        first += len(cells)
    src, dst = np.concatenate(pairs, axis=1)
    return _Pairs(src * len(half) + dst, 4 * half[src] ** 2, half[src], half[dst])


def _contacts(territory: Territory, half: Float[np.ndarray, " n"]) -> _Pairs:
    """Cells with voxel faces between what they own."""
    sides = np.concatenate([_faces(territory, axis) for axis in range(3)], axis=1)
    owners, gaps = sides[:2].astype(np.int64), sides[2:]
    key = owners.min(axis=0) * len(half) + owners.max(axis=0)
    key, which, area = np.unique(key, return_inverse=True, return_counts=True)
    ascending = owners[0] < owners[1]
    gap_src = np.bincount(which, np.where(ascending, *gaps), len(key)) / area
    gap_dst = np.bincount(which, np.where(ascending, *gaps[::-1]), len(key)) / area
    src, dst = np.divmod(key, max(len(half), 1))
    return _Pairs(key, area.astype(float), half[src] + gap_src, half[dst] + gap_dst)


def _faces(territory: Territory, axis: int) -> Int[np.ndarray, "4 k"]:
    """Owner below and above, gap below and above, of faces across one axis."""
    owner = np.moveaxis(territory.owner, axis, 0)
    gap = np.moveaxis(territory.gap, axis, 0)
    below, above = owner[:-1], owner[1:]
    between = (below != above) & (below >= 0) & (above >= 0)
    parts = (below, above, gap[:-1], gap[1:])
    return np.stack([part[between].astype(np.int32) for part in parts])
