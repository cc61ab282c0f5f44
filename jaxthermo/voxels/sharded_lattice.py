"""Sharded lattice: sections of a body, one for each device, one after the other.

A body is cut across its longest axis into sections of equal thickness. A state has them
one after the other along its first axis, each with an empty cell at both ends, so that
every device has a lattice of its own, as large as those of the others.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, Shaped

from ..errors import InputError


_OTHERS = (1, 2), (0, 2), (0, 1)
"""The two other axes of each axis."""


class ShardedLattice(NamedTuple):
    """Places of the voxels of a body in the sections of several devices."""

    axes: tuple[int, int, int]
    """Axis of the body along each axis of the lattice; the first is cut across."""
    count: int
    """Number of sections."""
    thickness: int
    """Thickness of a section [voxels]; the last has empty cells beyond the body."""
    section_shape: tuple[int, int, int]
    """Shape of each section [cells]."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the lattice [cells], less the rim of one cell around it."""
        _, y, z = self.section_shape
        return self.count * (self.thickness + 2) - 2, y, z

    def cells(self, voxel: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 3"]:
        """Cells of voxels."""
        moved = voxel[:, np.array(self.axes)].copy()
        # The rims between sections.
        moved[:, 0] += 2 * (moved[:, 0] // self.thickness)
        return moved

    def section(
        self, values: Shaped[np.ndarray, "x y z"], number: int
    ) -> Shaped[np.ndarray, "a b c"]:
        """Values of the voxels of a section and of one plane on both sides.

        0 beyond the body.
        """
        first = number * self.thickness
        along = values.transpose(self.axes)
        planes = along[max(first - 1, 0) : first + self.thickness + 1]
        rim_before = int(number == 0)
        rim_behind = self.thickness + 2 - rim_before - len(planes)
        return np.pad(planes, ((rim_before, rim_behind), (0, 0), (0, 0)))


def cut_axes(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Axes of a body of this shape in voxels: first the longest, to be cut across."""
    axis = int(np.argmax(shape))
    return axis, *_OTHERS[axis]


def sharded_lattice(solid: Bool[np.ndarray, "x y z"], count: int) -> ShardedLattice:
    """Sections of a body for a number of devices.

    Raises:
        InputError: if it has too few voxels along its longest axis.
    """
    axes = cut_axes(solid.shape)
    length, y, z = (solid.shape[axis] for axis in axes)
    thickness = -(-length // count)
    if thickness * (count - 1) >= length:
        possible = next(n for n in range(count, 0, -1) if _fills(length, n))
        raise InputError(
            f"devices={count}: the lattice is {length} voxels long, too few for a "
            f"section of equal thickness on each; give at most {possible} devices, or "
            "a finer pitch"
        )
    return ShardedLattice(
        axes=axes, count=count, thickness=thickness, section_shape=(thickness, y, z)
    )


def _fills(length: int, count: int) -> bool:
    return -(-length // count) * (count - 1) < length


def padded_places(
    section: Int[np.ndarray, " m"], count: int, size: Callable[[int], int] = int
) -> tuple[Int[np.ndarray, " m"], int]:
    """Place of each entry in a list of sections that are padded to one length.

    Entries are in the order of their sections. `size` turns the largest number of
    entries of a section into the common length, which is returned too.
    """
    section_sizes = np.bincount(section, minlength=count)
    length = size(int(section_sizes.max()))
    first = np.cumsum(section_sizes) - section_sizes
    return section * length + np.arange(len(section)) - first[section], length
