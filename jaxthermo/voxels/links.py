"""The connection of surface voxels (thesis 4.2), found once and kept."""

import numpy as np
from jaxtyping import Int


def surface_links(
    voxels: Int[np.ndarray, "m 3"], shape: tuple[int, int, int]
) -> Int[np.ndarray, "e 2"]:
    """Pairs of surface voxels that touch over a face, an edge or a corner (26)."""
    padded = np.array(shape) + 2
    strides = np.array([padded[1] * padded[2], padded[2], 1])
    key = (voxels + 1) @ strides
    slot = np.full(int(padded.prod()), -1, np.int32)
    slot[key] = np.arange(len(voxels), dtype=np.int32)
    offsets = np.indices((3, 3, 3)).reshape(3, -1).T - 1
    pairs = []
    # The half of the 26 neighbours that come later in lattice order.
    for jump in (offsets @ strides)[14:]:
        other = slot[key + jump]
        linked = np.flatnonzero(other >= 0)
        pairs.append(np.stack([linked.astype(np.int32), other[linked]], axis=1))
    return np.concatenate(pairs)
