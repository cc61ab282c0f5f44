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
from .links import block_links, joined_links


# Cells of a slab: larger ones are no faster.
_SLAB_CELLS = 2**23

# Arrays at the peak of a build [bytes], by the sizes of their numbers.
_FLAG = np.dtype(bool).itemsize
_INDEX = np.dtype(np.int32).itemsize
_KEY = np.dtype(np.int64).itemsize
_NUMBER = np.dtype(np.float64).itemsize

# Cells of a slab: first voxels, numbers, labels, padded labels and pairs of them; flags
# of the solid and of shared faces. With cut voxels also open areas and their indices.
_BYTES_PER_CELL = 5 * _INDEX + 2 * _FLAG
_BYTES_PER_CUT_CELL = _BYTES_PER_CELL + _KEY + _NUMBER

# Solid voxels of a slab: keys, order and planes of faces. With cut voxels also volumes,
# and open areas across three axes, joined and sorted.
_BYTES_PER_FACE = 2 * _KEY + _INDEX
_BYTES_PER_CUT_FACE = _BYTES_PER_FACE + 7 * _NUMBER

# Position, normal, area and depth of fragments in a slab, their voxels (as stored and
# counted from the slab's first), axis, layers and selection.
_BYTES_PER_FRAGMENT = 8 * _NUMBER + 3 * _INDEX + 5 * _KEY + 2 * _FLAG

# Nodes of voxels in all slabs together, with a flag for each that is in a node.
_BYTES_PER_VOXEL = _INDEX + 2 * _FLAG

# Centre, location, volume and level of a node and about three links, in slabs, joined
# and sorted.
_BYTES_PER_LINK = 2 * _INDEX + 3 * _NUMBER
_BYTES_PER_NODE = 3 * (7 * _NUMBER + _INDEX + 3 * _BYTES_PER_LINK)


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
    starts = []
    slabs = []
    between = []
    below = None
    for planes in _block_slabs(grid.solid.shape, factor):
        labels, level = slab_of(planes)
        starts.append(planes.start)
        slabs.append(build_blocks(_within(grid, planes), labels, level))
        if below is not None:
            links = _links_between(
                grid,
                start=planes.start,
                ends=np.stack([below, labels[0]]),
                low=slabs[-2],
                high=slabs[-1],
            )
            between.append(links)
        # A copy, so that the other planes are freed.
        below = labels[-1].copy()
    if len(slabs) == 1:
        return slabs[0]
    return _joined(grid, starts=starts, slabs=slabs, between=between)


def _bytes(grid: VoxelGrid, factor: int, nodes: float) -> int:
    """Estimate of the peak memory of a build, besides the grid's own [bytes]."""
    largest = 0
    total = 0
    is_cut = grid.cut is not None
    per_cell = _BYTES_PER_CUT_CELL if is_cut else _BYTES_PER_CELL
    per_voxel = _BYTES_PER_CUT_FACE if is_cut else _BYTES_PER_FACE
    for planes in _block_slabs(grid.solid.shape, factor):
        solid = grid.solid[planes]
        voxels = np.count_nonzero(solid)
        total += 1
        largest = max(largest, per_cell * solid.size + per_voxel * voxels)
    fragments = _BYTES_PER_FRAGMENT * len(grid.fragment_area) / total
    joined = _BYTES_PER_VOXEL * grid.solid_count + _BYTES_PER_NODE * nodes
    return int(largest + fragments + joined)


def _within(grid: VoxelGrid, planes: slice) -> VoxelGrid:
    """Planes of a grid, with their fragments."""
    if planes.stop - planes.start == grid.lattice.shape[0]:
        return grid
    start = planes.start
    shape = (planes.stop - start, *grid.lattice.shape[1:])
    corner = grid.lattice.origin + np.array([start, 0, 0]) * grid.pitch
    x = grid.fragment_voxel[:, 0]
    is_within = (x >= start) & (x < planes.stop)
    arrays = ["position", "normal", "area", "voxel", "axis", "layer"]
    names = [f"fragment_{name}" for name in arrays]
    cut = None
    if grid.cut is not None:
        names = [*names, "fragment_depth"]
        cut = grid.cut.within(planes)
    fragment_arrays: dict[str, Any] = {
        name: getattr(grid, name)[is_within] for name in names
    }
    fragment_arrays["fragment_voxel"] = fragment_arrays["fragment_voxel"] - [
        start,
        0,
        0,
    ]
    return replace(
        grid,
        lattice=Lattice(shape=shape, origin=corner, pitch=grid.pitch),
        solid=grid.solid[planes],
        cut=cut,
        **fragment_arrays,
    )


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
    # Faces within one of the two planes belong to the links of its slab.
    crossing = links.selected((links.src < count) & (links.dst >= count))
    return crossing._replace(dst=crossing.dst - np.int32(count))


def _joined(
    grid: VoxelGrid, starts: list[int], slabs: list[Built], between: list[Links]
) -> Built:
    counts = [len(built.nodes.volume) for built in slabs]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    links = [
        _numbered_from(built.links, src=start, dst=start)
        for built, start in zip(slabs, first[:-1], strict=True)
    ]
    links += [
        _numbered_from(crossing, src=low, dst=high)
        for crossing, low, high in zip(between, first[:-2], first[1:-1], strict=True)
    ]
    links = joined_links(links)
    order = np.lexsort([links.dst, links.src])
    nodes = zip(*(built.nodes for built in slabs), strict=True)
    # Fragments keep their order within a slab.
    slab = np.searchsorted(starts, grid.fragment_voxel[:, 0], side="right") - 1
    fragment_node = np.zeros(len(slab), np.int32)
    fragment_node[np.argsort(slab, kind="stable")] = _numbers(
        [built.fragment_node for built in slabs], first
    )
    return Built(
        nodes=Nodes(*(np.concatenate(column) for column in nodes)),
        links=links.selected(order),
        fragment_node=fragment_node,
        voxel_node=_numbers([built.voxel_node for built in slabs], first),
    )


def _numbered_from(links: Links, src: np.int32, dst: np.int32) -> Links:
    return links._replace(src=links.src + src, dst=links.dst + dst)


def _numbers(
    nodes_by_slab: list[Int[np.ndarray, " _"]], first: Int[np.ndarray, " _"]
) -> Int[np.ndarray, " _"]:
    """Nodes of all slabs in one array, from the nodes in each slab; -1 stays."""
    numbers = np.concatenate(nodes_by_slab)
    ends = np.cumsum([len(nodes) for nodes in nodes_by_slab])
    # Views: copies would be the largest arrays of a large body.
    for nodes, number in zip(np.split(numbers, ends[:-1]), first[:-1], strict=True):
        nodes[nodes >= 0] += number
    return numbers
