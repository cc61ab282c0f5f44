"""A body's surface in patches: fragments of one cell of a grid that face one way."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
from ...voxels.lattice import Lattice


SIDES = 6
"""The ways a fragment may face: up or down its dominant axis."""

INWARD = 0.25
"""How far from the surface its voxel is looked for, in voxels."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Cubes of whole voxels, so that no fragment's square lies in two of them."""

    lattice: Lattice
    voxels: int
    """Along an edge of a cell."""

    def codes(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """One number for the cell of each surface point and the way it faces."""
        axis = np.abs(normals).argmax(1)
        rows = np.arange(len(points))
        ahead = normals[rows, axis] > 0
        at = self.lattice.to_cells(points)
        # A face between two voxels belongs to the one inside.
        at[rows, axis] -= np.where(ahead, INWARD, -INWARD)
        top = np.array(self.lattice.shape) - 1
        x, y, z = (np.clip(np.floor(at).astype(int), 0, top) // self.voxels).T
        _, ny, nz = (n // self.voxels + 1 for n in self.lattice.shape)
        return ((x * ny + y) * nz + z) * SIDES + 2 * axis + ahead


@dataclass(frozen=True, eq=False)
class Patches:
    """Which patch each fragment of a body is in, and how to tell it of other points.

    All in the body's own frame.
    """

    patch: Int[np.ndarray, " s"]
    area: Float[np.ndarray, " p"]
    """[m^2]"""
    centre: Float[np.ndarray, "p 3"]
    """[m]"""
    code: Int[np.ndarray, " p"]
    """Of each patch's cell and side, increasing."""
    cells: "Cells"

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.area)

    def of(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """The patch of other points on the surface, which need not be fragments.

        In a cell without fragments of that side it is the nearest patch.
        """
        wanted = self.cells.codes(points, normals)
        slot = np.minimum(np.searchsorted(self.code, wanted), self.count - 1)
        lost = np.flatnonzero(self.code[slot] != wanted)
        if len(lost):
            unknown, first, inverse = np.unique(
                wanted[lost], return_index=True, return_inverse=True
            )
            gap = points[lost[first], None] - self.centre
            far = np.einsum("upi,upi->up", gap, gap)
            # Any patch of the same side is nearer than those of the others.
            far += (unknown[:, None] % SIDES != self.code % SIDES) * (1 + far.max())
            slot[lost] = far.argmin(1)[inverse.reshape(-1)]
        return slot


def group(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    area: Float[np.ndarray, " s"],
    lattice: Lattice,
    most: int,
) -> Patches:
    """Patches as fine as they can be without being more than `most`.

    Args:
        position: of the fragments in the body's own frame [m].
        normal: outward at them.
        area: of them, above 0 [m^2].
        lattice: of the body's voxels.
        most: six or more; a closed surface faces all six ways.

    Raises:
        InputError: for fewer than six.
    """
    if most < 6:
        raise InputError(f"{most} patches a body: give 6 or more, such as 128")
    longest = max(lattice.shape)
    cells = Cells(lattice, longest)
    for voxels in np.unique(np.ceil(longest / np.geomspace(1.0, 64.0, 49)))[::-1]:
        finer = Cells(lattice, int(voxels))
        if len(np.unique(finer.codes(position, normal))) > most:
            break
        cells = finer
    code, patch = np.unique(cells.codes(position, normal), return_inverse=True)
    patch = patch.reshape(-1)
    total = np.bincount(patch, area, len(code))
    mean = [np.bincount(patch, area * position[:, i], len(code)) for i in range(3)]
    return Patches(patch, total, np.stack(mean, axis=1) / total[:, None], code, cells)
