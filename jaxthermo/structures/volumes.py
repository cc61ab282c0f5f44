"""Volume of nodes within a part of space."""

import numpy as np
from jaxtyping import Float

from ..voxels.fractions import volume_fractions
from ..voxels.selection import AbstractSpace
from .kinds.sheet import Sheet
from .partition.assignment import volume_within
from .structure import AbstractStructure, AbstractVoxelStructure


def node_volumes(
    structure: AbstractStructure, space: AbstractSpace | None = None
) -> Float[np.ndarray, " n"]:
    """Volume of the part of each node in a part of space [m^3]; of all for None."""
    if isinstance(structure, Sheet):
        return structure.volume_within(space)
    # All structures but sheets have voxels.
    assert isinstance(structure, AbstractVoxelStructure)
    fraction = np.ones(structure.voxels.solid_count)
    if space is not None:
        fraction = volume_fractions(space, structure.voxels)
    return volume_within(structure, fraction)
