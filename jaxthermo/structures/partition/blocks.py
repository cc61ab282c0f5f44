"""Labels of voxels, and the structure whose nodes are the labelled groups.

A label volume has the node of every voxel, -1 for none. Nodes are numbered in the
lattice order of their first voxels, so that neighbours are close in memory.
"""

import numpy as np
from jaxtyping import Bool, Int
from skimage import measure

from ...host_memory import require_memory
from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_voxels
from ..structure import Built, Nodes
from .links import block_links, voxel_links


# Peak of `voxel_layers`: numbers, the padded body, the shell and exposed voxels.
_BYTES_PER_LAYER_CELL = np.dtype(np.int32).itemsize + 3 * np.dtype(bool).itemsize


def index_type(shape: tuple[int, ...]) -> np.dtype:
    """Smallest of int32 and int64 that can index all cells of a lattice."""
    return np.promote_types(np.int32, np.min_scalar_type(-int(np.prod(shape))))


def number_by_first_voxel(
    first: Int[np.ndarray, "x y z"],
) -> tuple[Int[np.ndarray, "x y z"], Int[np.ndarray, " n"]]:
    """Number nodes from 0 in the order of their first voxels.

    From the index, in lattice order, of the first voxel of each voxel's node (-1 for no
    node); returns the labels, and the index of the first voxel of each node.
    """
    flat = first.reshape(-1)
    covered = np.flatnonzero(flat >= 0)
    first_voxel = flat[covered]
    is_first = first_voxel == covered
    # The running count is right at first voxels, and only there it is read.
    number = np.zeros(len(flat), np.int32)
    number[covered] = np.cumsum(is_first, dtype=np.int32) - 1
    labels = np.full(len(flat), -1, np.int32)
    labels[covered] = number[first_voxel]
    return labels.reshape(first.shape), covered[is_first]


def build_blocks(
    grid: VoxelGrid, labels: Int[np.ndarray, "x y z"], level: Int[np.ndarray, " n"]
) -> Built:
    """Build a structure whose nodes are groups of voxels.

    Every number below n occurs among the labels, and every voxel with a fragment has
    one; -1 is no node.
    """
    covered = np.flatnonzero(labels.reshape(-1) >= 0)
    node = labels.reshape(-1)[covered]
    voxels = np.bincount(node, minlength=len(level))
    cell = np.unravel_index(covered, labels.shape)
    total = [np.bincount(node, index, len(level)) for index in cell]
    centre = np.stack(total, axis=1) / voxels[:, None] + 0.5
    volume = voxels * grid.voxel_volume
    if grid.cut is not None:
        volume = grid.volume_of(labels[grid.solid], len(level))
    # Single voxels need no sort of shared faces.
    if np.array_equal(node, np.arange(len(level))):
        links = voxel_links(labels, grid.pitch, grid.cut)
    else:
        links = block_links(labels, centre=centre, pitch=grid.pitch, cut=grid.cut)
    middle = grid.lattice.origin + centre * grid.pitch
    return Built(
        nodes=Nodes(
            centre=middle,
            volume=volume,
            level=level.astype(np.int32),
            location=middle,
        ),
        links=links,
        fragment_node=labels[tuple(grid.fragment_voxel.T)],
        voxel_node=labels[grid.solid].astype(np.int32),
    )


def block_parts(
    solid: Bool[np.ndarray, "x y z"], factor: int
) -> Int[np.ndarray, "x y z"]:
    """Divide the voxels into connected parts of cubic blocks.

    A block has factor^3 voxels, fewer at the upper ends of the lattice; its parts are
    connected over voxel faces without leaving the block.

    Returns:
        For each voxel the index of the first voxel of its part; -1 for empty voxels.
    """
    edge = np.minimum(factor, solid.shape)
    blocks = -(-np.array(solid.shape) // edge)
    padded = np.pad(solid, [(0, n) for n in blocks * edge - solid.shape])
    split = np.stack([blocks, edge], 1).reshape(-1)
    # [blocks along x, y, z, voxels of a block along x, y, z]
    inside = padded.reshape(split).transpose(0, 2, 4, 1, 3, 5)
    first = np.zeros(padded.shape, index_type(padded.shape))
    first_inside = first.reshape(split).transpose(0, 2, 4, 1, 3, 5)

    strides = np.array([solid.shape[1] * solid.shape[2], solid.shape[2], 1])
    corner = _lattice_sum(blocks, edge * strides).astype(first.dtype)
    within = _lattice_sum(edge, strides).astype(first.dtype)
    # Most blocks are full or empty; only mixed ones need connected parts.
    full = inside.all((3, 4, 5))
    first_inside[...] = np.where(full, corner, -1)[..., None, None, None]
    mixed = inside.any((3, 4, 5)) & ~full
    voxel = corner[mixed][:, None, None, None] + within
    first_inside[mixed] = _first_of_parts(inside[mixed], voxel)
    x, y, z = solid.shape
    return np.ascontiguousarray(first[:x, :y, :z])


def count_blocks(solid: Bool[np.ndarray, "x y z"], factor: int) -> int:
    """Number of blocks with solid voxels: at most that of their parts."""
    for axis, length in enumerate(solid.shape):
        solid = np.logical_or.reduceat(solid, range(0, length, factor), axis)
    return int(np.count_nonzero(solid))


def _lattice_sum(
    counts: Int[np.ndarray, "3"], strides: Int[np.ndarray, "3"]
) -> Int[np.ndarray, "i j k"]:
    """Linear index i s_x + j s_y + k s_z of all (i, j, k) below the counts."""
    x, y, z = (np.arange(n) * stride for n, stride in zip(counts, strides, strict=True))
    return x[:, None, None] + y[:, None] + z


def _first_of_parts(
    solid: Bool[np.ndarray, "m i j k"], voxel: Int[np.ndarray, "m i j k"]
) -> Int[np.ndarray, "m i j k"]:
    """Lowest of `voxel` in each connected part of each block; -1 where empty."""
    # All blocks stacked, separated by empty planes, so that one labelling serves all.
    stack = np.pad(solid, [(0, 0), (1, 0), (0, 0), (0, 0)])
    label = measure.label(stack.reshape(-1, *solid.shape[2:]), connectivity=1)
    label = np.asarray(label).reshape(stack.shape)[:, 1:][solid]
    index = voxel[solid]
    lowest = np.zeros(label.max(initial=0) + 1, index.dtype)
    # Indices rise within a block: written backwards, the lowest one remains.
    lowest[label[::-1]] = index[::-1]
    result = np.full(solid.shape, -1, index.dtype)
    result[solid] = lowest[label]
    return result


def voxel_layers(grid: VoxelGrid, max_layers: int) -> Int[np.ndarray, "x y z"]:
    """Number the layers of voxels from 0 at the surface; -1 outside and deeper.

    Layer 0 is `shell_voxels`, layer i + 1 the remaining face neighbours of layer i.
    """
    needed = _BYTES_PER_LAYER_CELL * grid.solid.size
    require_memory(needed, "numbering layers of voxels", "use a coarser pitch")
    # A rim of empty voxels, so that no jump to a neighbour wraps around.
    padded = np.pad(grid.solid, 1)
    _, y, z = padded.shape
    unreached = padded.reshape(-1)
    layer = np.full(unreached.shape, -1, np.int32)
    first = tuple(shell_voxels(grid).T + 1)
    front = np.asarray(np.ravel_multi_index(first, padded.shape))
    unreached[front] = False
    layer[front] = 0
    for number in range(1, max_layers):
        reached = []
        for jump in (-y * z, -z, -1, 1, z, y * z):
            neighbour = front + jump
            neighbour = neighbour[unreached[neighbour]]
            unreached[neighbour] = False
            reached.append(neighbour)
        front = np.concatenate(reached)
        if not len(front):
            break
        layer[front] = number
    return layer.reshape(padded.shape)[1:-1, 1:-1, 1:-1]


def shell_voxels(grid: VoxelGrid) -> Int[np.ndarray, "m 3"]:
    """Voxels with an open face or a surface fragment, in lattice order."""
    exposed = surface_voxels(grid.solid)
    in_shell = np.zeros(grid.solid.shape, bool)
    in_shell[tuple(exposed.T)] = True
    in_shell[tuple(grid.fragment_voxel.T)] = True
    return np.argwhere(in_shell)
