"""Layers of voxels from the surface inwards."""

import numpy as np
from jaxtyping import Int

from ...voxels.grid import VoxelGrid
from ..kinds.shell import shell_voxels


def voxel_layers(grid: VoxelGrid, most: int) -> Int[np.ndarray, "x y z"]:
    """Number of the layer of each voxel, 0 at the surface; -1 outside and deeper.

    Layer 0 are the solid voxels with an empty face neighbour, and the few others that
    carry a fragment; layer i + 1 are the face neighbours of layer i not yet reached.

    Args:
        grid: the body.
        most: how many layers to take off.
    """
    padded = np.pad(grid.solid, 1)
    _, y, z = padded.shape
    waiting = padded.reshape(-1)
    layer = np.full(waiting.shape, -1, np.int32)
    first = tuple(shell_voxels(grid).T + 1)
    front = np.asarray(np.ravel_multi_index(first, padded.shape))
    waiting[front] = False
    layer[front] = 0
    for number in range(1, most):
        reached = []
        for jump in (-y * z, -z, -1, 1, z, y * z):
            near = front + jump
            near = near[waiting[near]]
            waiting[near] = False
            reached.append(near)
        front = np.concatenate(reached)
        if not len(front):
            break
        layer[front] = number
    return layer.reshape(padded.shape)[1:-1, 1:-1, 1:-1]
