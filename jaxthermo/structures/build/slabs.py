"""Structures of blocks, built slab by slab along x.

A slab is a range of planes of the lattice that no node goes beyond. Each is built by
`build_blocks` from its own planes, and linked to the one before over the plane between
them: only arrays of a slab are made, not of the whole lattice. Numbers of nodes,
volumes, areas and links are those of `build_blocks` on the whole lattice; positions and
distances are equal to rounding, and exactly where one slab is enough.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from ...host_memory import require_memory
from ...voxels.grid import VoxelGrid
from ...voxels.lattice import Lattice
from ..structure import Built, Links, Nodes
from .blocks import block_parts, build_blocks
from .links import block_links


# Cells of a slab: larger ones are no faster.
_SLAB_CELLS = 2**23

# Peak of the build, measured with a ball and up to 1000-high voxels of a statue:
# labels, parts and faces of a slab, for each cell and solid voxel, and its fragments;
# the node of every voxel, while slabs are joined; nodes with their links.
_SLAB_BYTES, _BYTES_PER_FRAGMENT = (22, 20), 130
# The same with volumes and open areas of cut voxels.
_CUT_SLAB_BYTES = 38, 72
_BYTES_PER_VOXEL, _BYTES_PER_NODE = 6, 450


def _block_slabs(shape: tuple[int, ...], factor: int) -> Iterator[slice]:
    """Ranges of planes along x, each of whole layers of blocks of factor^3 voxels."""
    layers = max(_SLAB_CELLS // (factor * shape[1] * shape[2]), 1)
    for start in range(0, shape[0], layers * factor):
        yield slice(start, min(start + layers * factor, shape[0]))


def count_parts(solid: Bool[np.ndarray, "x y z"], factor: int) -> int:
    """Number of the parts of `block_parts`."""
    count = 0
    for planes in _block_slabs(solid.shape, factor):
        first = block_parts(solid[planes], factor).reshape(-1)
        count += int(np.count_nonzero(first == np.arange(len(first))))
    return count


class Slab(NamedTuple):
    """Nodes of a slab, numbered from 0."""

    labels: Int[np.ndarray, "x y z"]
    """Node of each voxel; -1 for none."""
    level: Int[np.ndarray, " n"]


def build_slabs(
    grid: VoxelGrid, factor: int, surface_nodes: int, slab_of: Callable[[slice], Slab]
) -> Built:
    """Build a structure whose nodes are groups of voxels, each within one slab.

    Otherwise as `build_blocks`; numbers of nodes continue from slab to slab.

    Args:
        grid: of the body.
        factor: edge of the largest groups [voxels], at whose multiples slabs end.
        surface_nodes: number of nodes besides those of whole blocks, for the memory.
        slab_of: gives the nodes in a range of planes along x.

    Raises:
        InputError: if the arrays would not fit into memory.
    """
    nodes = grid.solid_count / factor**3 + surface_nodes
    task = f"building a structure of {grid.solid_count} voxels"
    require_memory(_bytes(grid, factor, nodes), task, "use a coarser pitch")
    starts, parts, between = [], [], []
    below = None
    for planes in _block_slabs(grid.solid.shape, factor):
        labels, level = slab_of(planes)
        starts.append(planes.start)
        parts.append(build_blocks(_within(grid, planes), labels, level))
        if below is not None:
            ends = np.stack([below, labels[0]])
            between.append(_links_between(grid, planes.start, ends, *parts[-2:]))
        # A copy: the other planes are not needed any more.
        below = labels[-1].copy()
    return (
        parts[0]
        if len(parts) == 1
        else _joined(grid, starts=starts, parts=parts, between=between)
    )


def _bytes(grid: VoxelGrid, factor: int, nodes: float) -> int:
    """Estimate of the peak memory of a build, besides the grid's own [bytes]."""
    largest, total = 0, 0
    per_cell, per_voxel = _SLAB_BYTES if grid.cut is None else _CUT_SLAB_BYTES
    for planes in _block_slabs(grid.solid.shape, factor):
        solid = grid.solid[planes]
        voxels, total = np.count_nonzero(solid), total + 1
        largest = max(largest, per_cell * solid.size + per_voxel * voxels)
    fragments = _BYTES_PER_FRAGMENT * len(grid.fragment_area) / total
    own = _BYTES_PER_VOXEL * grid.solid_count + _BYTES_PER_NODE * nodes
    return int(largest + fragments + own)


def _within(grid: VoxelGrid, planes: slice) -> VoxelGrid:
    """Planes of a grid, with their fragments."""
    if planes.stop - planes.start == grid.lattice.shape[0]:
        return grid
    start, shape = planes.start, (planes.stop - planes.start, *grid.lattice.shape[1:])
    corner = grid.lattice.origin + np.array([start, 0, 0]) * grid.pitch
    x = grid.fragment_voxel[:, 0]
    chosen = (x >= start) & (x < planes.stop)
    arrays = ["position", "normal", "area", "voxel", "axis", "layer"]
    names = [f"fragment_{name}" for name in arrays]
    cut = None
    if grid.cut is not None:
        names, cut = [*names, "fragment_depth"], grid.cut.within(planes)
    own: dict[str, Any] = {name: getattr(grid, name)[chosen] for name in names}
    own["fragment_voxel"] = own["fragment_voxel"] - [start, 0, 0]
    lattice = Lattice(shape, corner, grid.pitch)
    return replace(grid, lattice=lattice, solid=grid.solid[planes], cut=cut, **own)


def _links_between(
    grid: VoxelGrid, start: int, ends: Int[np.ndarray, "2 y z"], low: Built, high: Built
) -> Links:
    """Links from a slab to the next one, which begins at plane `start`.

    From the labels of the planes on either side; `src` is numbered in the lower slab,
    `dst` in the upper one.
    """
    count = len(low.nodes.volume)
    labels = ends + np.array([0, count]).reshape(2, 1, 1) * (ends >= 0)
    corner = grid.lattice.origin + np.array([start - 1, 0, 0]) * grid.pitch
    centre = np.concatenate([low.nodes.centre, high.nodes.centre])
    cut = None if grid.cut is None else grid.cut.within(slice(start - 1, start + 1))
    links = block_links(
        labels, centre=(centre - corner) / grid.pitch, pitch=grid.pitch, cut=cut
    )
    # Faces within one of the two planes belong to links of its own slab.
    across = (links.src < count) & (links.dst >= count)
    kept = Links(*(array[across] for array in links))
    return kept._replace(dst=kept.dst - np.int32(count))


def _joined(
    grid: VoxelGrid, starts: list[int], parts: list[Built], between: list[Links]
) -> Built:
    counts = [len(part.nodes.volume) for part in parts]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    own = zip(parts, first[:-1], strict=True)
    links = [_numbered_from(part.links, start, start) for part, start in own]
    ends = zip(between, first[:-2], first[1:-1], strict=True)
    links += [_numbered_from(each, low, high) for each, low, high in ends]
    every = [np.concatenate(each) for each in zip(*links, strict=True)]
    order = np.lexsort([every[1], every[0]])
    nodes = zip(*(part.nodes for part in parts), strict=True)
    # Fragments keep their order within a slab.
    slab = np.searchsorted(starts, grid.fragment_voxel[:, 0], side="right") - 1
    fragment_node = np.zeros(len(slab), np.int32)
    fragment_node[np.argsort(slab, kind="stable")] = _numbers(
        [part.fragment_node for part in parts], first
    )
    return Built(
        nodes=Nodes(*(np.concatenate(each) for each in nodes)),
        links=Links(*(array[order] for array in every)),
        fragment_node=fragment_node,
        voxel_node=_numbers([part.voxel_node for part in parts], first),
    )


def _numbered_from(links: Links, src: np.int32, dst: np.int32) -> Links:
    return links._replace(src=links.src + src, dst=links.dst + dst)


def _numbers(
    parts: list[Int[np.ndarray, " _"]], first: Int[np.ndarray, " _"]
) -> Int[np.ndarray, " _"]:
    """Nodes of all slabs in one array, from the nodes of each; -1 stays."""
    numbers = np.concatenate(parts)
    ends = np.cumsum([len(part) for part in parts])
    # Views: with ten million voxels copies would be the largest arrays.
    for own, number in zip(np.split(numbers, ends[:-1]), first[:-1], strict=True):
        own[own >= 0] += number
    return numbers
