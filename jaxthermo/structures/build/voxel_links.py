"""Links between single voxels: as those of any groups, but found without a sort."""

import numpy as np
from jaxtyping import Int

from ..structure import Links


def voxel_links(labels: Int[np.ndarray, "x y z"], pitch: float) -> Links:
    """One link per shared face, of area pitch^2, half a pitch on either side.

    Args:
        labels: rank of each labelled voxel in lattice order; -1 for the others.
        pitch: edge of a voxel [m].
    """
    # One voxel more at the upper ends, so that the next along an axis always exists.
    padded = np.pad(labels, (0, 1), constant_values=-1)
    _, y, z = padded.shape
    flat = padded.reshape(-1)
    voxel = np.flatnonzero(flat >= 0)
    # Along z, y and x: for each voxel in rising order.
    after = np.stack([flat[voxel + jump] for jump in (1, z, y * z)], axis=1)
    linked = after >= 0
    own = np.arange(len(voxel), dtype=np.int32)
    dst = after[linked]
    half = np.full(len(dst), pitch / 2)
    return Links(
        src=np.repeat(own, np.count_nonzero(linked, axis=1)),
        dst=dst,
        area=np.full(len(dst), pitch**2),
        distance_src=half,
        distance_dst=half,
    )
