"""Patches of a body's surface: fragments of one grid cell that face one side."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
from ...voxels.lattice import Lattice


# Sides that a fragment may face: up or down its dominant axis.
_SIDES = 6

# Distance below the surface at which its voxel is looked up, in voxels.
_INWARD = 0.25


@dataclass(frozen=True, eq=False)
class _Cells:
    """Grid of cubes of whole voxels; no fragment's square lies in two of them."""

    lattice: Lattice
    voxels: int
    """Number of voxels along an edge of a cell."""

    def codes(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """Number that identifies the cell and side of each surface point."""
        axis = np.abs(normals).argmax(1)
        rows = np.arange(len(points))
        ahead = normals[rows, axis] > 0
        at = self.lattice.to_cells(points)
        # A face between two voxels belongs to the inner one.
        at[rows, axis] -= np.where(ahead, _INWARD, -_INWARD)
        top = np.array(self.lattice.shape) - 1
        x, y, z = (np.clip(np.floor(at).astype(int), 0, top) // self.voxels).T
        _, ny, nz = (n // self.voxels + 1 for n in self.lattice.shape)
        return ((x * ny + y) * nz + z) * _SIDES + 2 * axis + ahead


@dataclass(frozen=True, eq=False)
class Patches:
    """Patch of each fragment of a body, in the body's frame."""

    patch: Int[np.ndarray, " s"]
    area: Float[np.ndarray, " p"]
    """[m^2]"""
    centre: Float[np.ndarray, "p 3"]
    """[m]"""
    code: Int[np.ndarray, " p"]
    """Cell and side of each patch, increasing."""
    cells: _Cells

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.area)

    def patch_of(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """Patch of any points on the surface; the nearest one in a cell without any."""
        code = self.cells.codes(points, normals)
        slot = np.minimum(np.searchsorted(self.code, code), self.count - 1)
        missing = np.flatnonzero(self.code[slot] != code)
        if len(missing):
            unknown, first, inverse = np.unique(
                code[missing], return_index=True, return_inverse=True
            )
            gap = points[missing[first], None] - self.centre
            far = np.einsum("upi,upi->up", gap, gap)
            # Patches of the same side take precedence over those of other sides.
            far += (unknown[:, None] % _SIDES != self.code % _SIDES) * (1 + far.max())
            slot[missing] = far.argmin(1)[inverse.reshape(-1)]
        return slot


def group_patches(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    area: Float[np.ndarray, " s"],
    lattice: Lattice,
    max_patches: int,
) -> Patches:
    """Finest patches of a body whose number does not exceed `max_patches`.

    Positions [m], unit normals and areas above 0 [m^2] are those of its fragments, in
    the body's frame.

    Raises:
        InputError: for fewer than six: a closed surface faces all six sides.
    """
    if max_patches < 6:
        raise InputError(f"{max_patches} patches a body: give 6 or more, such as 128")
    longest = max(lattice.shape)
    cells = _Cells(lattice, longest)
    for voxels in np.unique(np.ceil(longest / np.geomspace(1.0, 64.0, 49)))[::-1]:
        finer = _Cells(lattice, int(voxels))
        if len(np.unique(finer.codes(position, normal))) > max_patches:
            break
        cells = finer
    code, patch = np.unique(cells.codes(position, normal), return_inverse=True)
    patch = patch.reshape(-1)
    total = np.bincount(patch, area, len(code))
    mean = [np.bincount(patch, area * position[:, i], len(code)) for i in range(3)]
    return Patches(patch, total, np.stack(mean, axis=1) / total[:, None], code, cells)
