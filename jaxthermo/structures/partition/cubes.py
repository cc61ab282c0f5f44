"""Structures of cubes: nodes of 1, 2, 4, ... voxels per edge, linked level by level.

Cubes that share a face differ by at most one level, so each pair of them shares one
face of the smaller: on the lattice of each level a cube has six neighbours, and a link
needs no sum over faces of voxels. `build_blocks` on the labels of the cubes is the
simple version, to rounding.
"""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ...arrays import flat_index, sorted_union, stable_order
from ...voxels.grid import VoxelGrid
from ..structure import Built, Links, Nodes
from .links import link_distance


Levels = list[Bool[np.ndarray, "_x _y _z"]]
"""Cubes of each level l, 2^l voxels wide; [i, j, k] begins at voxel 2^l [i, j, k]."""


def octree_levels(solid: Bool[np.ndarray, "x y z"], levels: int | None) -> Levels:
    """Largest cubes that are solid together with their 26 neighbours.

    Args:
        solid: voxels of the body.
        levels: number of sizes; None for no limit.
    """
    possible = [solid]
    filled = solid
    while levels is None or len(possible) < levels:
        filled = _halve(filled)
        inner = _with_neighbours(filled)
        if not inner.any():
            break
        possible.append(inner)
    # The children of a cube could all be cubes too: they are excluded.
    chosen_levels = [possible[-1]]
    for fine, coarse in zip(possible[-2::-1], possible[:0:-1], strict=True):
        alone = fine.copy()
        for child in _children(alone, coarse.shape):
            child &= ~coarse
        chosen_levels.append(alone)
    return chosen_levels[::-1]


def _halve(filled: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "u v w"]:
    """Flag the entirely solid cells of twice the size; an odd last plane is dropped."""
    for axis in range(3):
        along = np.moveaxis(filled, axis, 0)
        pairs = along[: len(along) // 2 * 2]
        filled = np.moveaxis(pairs[::2] & pairs[1::2], 0, axis)
    return filled


def _with_neighbours(filled: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Flag the cells that are solid together with all 26 neighbours."""
    for axis in range(3):
        along = np.moveaxis(filled, axis, 0)
        inner = np.zeros_like(along)
        inner[1:-1] = along[:-2] & along[1:-1] & along[2:]
        filled = np.moveaxis(inner, 0, axis)
    return filled


def _children(fine: np.ndarray, coarse: tuple[int, ...]) -> Iterator[np.ndarray]:
    """Views of the cells of half the size, one for each of the eight in a cell."""
    u, v, w = coarse
    for i, j, k in product(range(2), repeat=3):
        yield fine[i : 2 * u : 2, j : 2 * v : 2, k : 2 * w : 2]


class _Cubes(NamedTuple):
    """Cubes of one level, by their number."""

    number: Int[np.ndarray, " k"]
    cell: Int[np.ndarray, " k"]
    """Index on the level's lattice, with a rim."""


def build_cubes(grid: VoxelGrid, levels: Levels) -> Built:
    """Build a structure whose nodes are cubes of voxels that fill the body.

    Numbered by their first voxels in lattice order.
    """
    corner, level = _corners(levels)
    first = flat_index(corner, grid.solid.shape)
    order = stable_order(first)
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    corner = corner[order]
    level = level[order]
    counts = [int(np.count_nonzero(cubes)) for cubes in levels]
    numbers_by_level = np.split(number, np.cumsum(counts)[:-1])
    labels, pairs = _linked(levels, numbers_by_level, level)
    inner = labels[1:-1, 1:-1, 1:-1]
    volume = 8.0**level
    over_edges = []
    if grid.cut is not None:
        over_faces, *over_edges = _cut_pairs(grid, inner)
        pairs.append(over_faces)
        volume += np.bincount(
            inner[tuple(grid.cut.voxel.T)], grid.cut.volume - 1, len(level)
        )
    centre = corner + 2.0 ** level[:, None] / 2
    middle = grid.lattice.origin + centre * grid.pitch
    return Built(
        nodes=Nodes(
            centre=middle,
            volume=volume * grid.voxel_volume,
            level=level,
            location=middle,
        ),
        links=_links(
            pairs, over_edges=over_edges, centre=centre, level=level, pitch=grid.pitch
        ),
        fragment_node=inner[tuple(grid.fragment_voxel.T)],
        voxel_node=inner[grid.solid],
    )


def _corners(
    levels: Levels,
) -> tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """First voxel of each cube, and its level."""
    corners = []
    level = []
    for size, cubes in enumerate(levels):
        along = np.unravel_index(np.flatnonzero(cubes), cubes.shape)
        cells = [index.astype(np.int32) << size for index in along]
        corners.append(np.stack(cells, axis=1))
        level.append(np.full(len(corners[-1]), size, np.int32))
    return np.concatenate(corners), np.concatenate(level)


class _Pairs(NamedTuple):
    """Pairs of linked nodes; entries of the same pair add up."""

    low: Int[np.ndarray, " _"]
    """Node with the lower number."""
    high: Int[np.ndarray, " _"]
    shared: Float[np.ndarray, " _"]
    """Shared area [voxel faces]."""

    @classmethod
    def of(
        cls,
        first: Int[np.ndarray, " _"],
        second: Int[np.ndarray, " _"],
        shared: Float[np.ndarray, " _"],
    ) -> "_Pairs":
        """Pairs of nodes, in either order."""
        return cls(
            low=np.minimum(first, second),
            high=np.maximum(first, second),
            shared=shared,
        )


def _linked(
    levels: Levels, numbers: list[Int[np.ndarray, " _"]], level: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, "u v w"], list[_Pairs]]:
    """Number of each voxel's cube, with a rim of -1, and pairs that share a face."""
    pairs = []
    labels = np.full((2, 2, 2), -1, np.int32)
    for size in reversed(range(len(levels))):
        cubes = levels[size]
        coarse = labels[1:-1, 1:-1, 1:-1]
        x, y, z = (length + 2 for length in cubes.shape)
        labels = np.full((x, y, z), -1, np.int32)
        within = labels[1:-1, 1:-1, 1:-1]
        for child in _children(within, coarse.shape):
            child[...] = coarse
        within[cubes] = numbers[size]
        along = np.unravel_index(np.flatnonzero(cubes), cubes.shape)
        cell = (along[0] + 1) * (y * z) + (along[1] + 1) * z + along[2] + 1
        flat = labels.reshape(-1)
        number = numbers[size]
        for jump in (y * z, z, 1):
            above = flat[cell + jump]
            below = flat[cell - jump]
            # Between cubes of one size the lower cube has the link.
            for neighbour, is_linked in (
                (above, above >= 0),
                (below, (below >= 0) & (level[below] > size)),
            ):
                linked = np.flatnonzero(is_linked)
                face = np.full(len(linked), 4.0**size)
                pairs.append(_Pairs.of(number[linked], neighbour[linked], face))
    return labels, pairs


def _cut_pairs(grid: VoxelGrid, labels: Int[np.ndarray, "x y z"]) -> list[_Pairs]:
    """Nodes linked by cut voxels, with the areas that differ from whole faces.

    First the pairs over faces, then those over edges.
    """
    assert grid.cut is not None
    node_pairs = []
    for is_edge in (False, True):
        selected = np.flatnonzero(grid.cut.links.over_edge == is_edge)
        links = grid.cut.links.selected(selected)
        first = labels[tuple(links.voxel.T)]
        second = labels[tuple((links.voxel + links.step).T)]
        apart = np.flatnonzero(first != second)
        # Conduction over an edge acts over the distance of its two voxels.
        shared = links.extra[apart] * (np.sqrt(2) if is_edge else 1.0)
        node_pairs.append(_Pairs.of(first[apart], second[apart], shared))
    return node_pairs


def _links(
    pairs: list[_Pairs],
    over_edges: list[_Pairs],
    centre: Float[np.ndarray, "n 3"],
    level: Int[np.ndarray, " n"],
    pitch: float,
) -> Links:
    """Sorted links; centres in voxels, the pitch in m."""
    size = len(level)
    src, dst, shared = (
        np.concatenate(column) for column in zip(*pairs, *over_edges, strict=True)
    )
    table = csr_array((shared, (src, dst)), (size, size))
    del src, dst, shared
    table.sum_duplicates()
    src = np.repeat(np.arange(size, dtype=np.int32), np.diff(table.indptr))
    dst = table.indices.astype(np.int32, copy=False)
    area = table.data
    # Cubes of one size over a face meet in the middle; all others are few.
    levels = level.astype(np.int8)
    src_level = levels[src]
    dst_level = levels[dst]
    unequal = np.flatnonzero(src_level != dst_level)
    if over_edges:
        low = np.concatenate([pair.low for pair in over_edges])
        high = np.concatenate([pair.high for pair in over_edges])
        key = src.astype(np.int64) * size + dst
        edge_key = np.sort(low.astype(np.int64) * size + high)
        unequal = sorted_union(unequal, np.searchsorted(key, edge_key))
    half = 2.0 ** np.arange(level.max() + 1) * (pitch / 2)
    distance_src = half[src_level]
    distance_dst = half[dst_level]
    to_src, to_dst = _distances(
        src[unequal], dst=dst[unequal], centre=centre, level=level
    )
    distance_src[unequal] = to_src * pitch
    distance_dst[unequal] = to_dst * pitch
    area *= pitch**2
    return Links(
        src=src,
        dst=dst,
        area=area,
        distance_src=distance_src,
        distance_dst=distance_dst,
    )


def _distances(
    src: Int[np.ndarray, " e"],
    dst: Int[np.ndarray, " e"],
    centre: Float[np.ndarray, "n 3"],
    level: Int[np.ndarray, " n"],
) -> Float[np.ndarray, "2 e"]:
    """Distances from two cubes to what they share [voxels]."""
    halves = 2.0 ** level[np.stack([src, dst])] / 2
    normal = halves[0] + halves[1]
    step = (centre.take(dst, axis=0) - centre.take(src, axis=0)).T
    straight = np.sqrt(np.square(step).sum(axis=0))
    # Cubes that share a face are neighbours along one axis, over an edge along two.
    over_edge = (np.abs(step) == normal).sum(axis=0) > 1
    to_face = halves * (link_distance(normal, straight) / normal)
    return np.where(over_edge, straight / 2, to_face)
