"""Patches of a body's surface: fragments of one grid cell that face one side.

Fragments that face a closed cavity never share a patch with those that face outward.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...geometry.mesh import Mesh, Pose
from ...voxels.cavities import Cavities
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

    @property
    def period(self) -> int:
        """Difference between the codes of one cavity and those of the next."""
        return _SIDES * int(np.prod([n // self.voxels + 1 for n in self.lattice.shape]))

    def codes(
        self,
        points: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        rooms: Int[np.ndarray, " n"],
    ) -> Int[np.ndarray, " n"]:
        """Number that identifies the room, cell and side of each surface point."""
        axis = np.abs(normals).argmax(1)
        rows = np.arange(len(points))
        ahead = normals[rows, axis] > 0
        at = self.lattice.to_cells(points)
        # A face between two voxels belongs to the inner one.
        at[rows, axis] -= np.where(ahead, _INWARD, -_INWARD)
        top = np.array(self.lattice.shape) - 1
        x, y, z = (np.clip(np.floor(at).astype(int), 0, top) // self.voxels).T
        _, ny, nz = (n // self.voxels + 1 for n in self.lattice.shape)
        code = ((x * ny + y) * nz + z) * _SIDES + 2 * axis + ahead
        return code + self.period * rooms


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patch of each fragment of a body, in the body's frame."""

    patch: Int[np.ndarray, " s"]
    area: Float[np.ndarray, " p"]
    """[m^2]"""
    centre: Float[np.ndarray, "p 3"]
    """[m]"""
    code: Int[np.ndarray, " p"]
    """Room, cell and side of each patch, increasing."""
    cells: _Cells
    cavities: Cavities | None
    room: Int[np.ndarray, " r"]
    """Room of the outside, 0, and of each cavity: the small ones count as outside."""

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.area)

    @property
    def enclosed(self) -> Bool[np.ndarray, " p"]:
        """True for patches in a closed cavity."""
        return self.code >= self.cells.period

    def patch_of(
        self,
        points: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        cavity: Int[np.ndarray, " n"] | None = None,
    ) -> Int[np.ndarray, " n"]:
        """Patch of each point on the surface; the nearest in a cell without patches.

        `cavity` is the number of the cavity that each point faces; None if all points
        face outward.
        """
        rooms = np.zeros(len(points), int) if cavity is None else self.room[cavity]
        code = self.cells.codes(points, normals, rooms)
        slot = np.minimum(np.searchsorted(self.code, code), self.count - 1)
        missing = np.flatnonzero(self.code[slot] != code)
        if len(missing):
            unknown, first, inverse = np.unique(
                code[missing], return_index=True, return_inverse=True
            )
            gap = points[missing[first], None] - self.centre
            far = np.einsum("upi,upi->up", gap, gap)
            # Patches of the same room take precedence over those of other rooms, and
            # in a room those of the same side.
            apart = 1 + far.max()
            period = self.cells.period
            far += (unknown[:, None] % _SIDES != self.code % _SIDES) * apart
            far += (unknown[:, None] // period != self.code // period) * (2 * apart)
            slot[missing] = far.argmin(1)[inverse.reshape(-1)]
        return slot


class PatchedBody(NamedTuple):
    """Body with the patches of its surface."""

    vertices: Float[np.ndarray, "v 3"]
    """World [m]."""
    faces: Int[np.ndarray, "f 3"]
    """Counter-clockwise seen from outside."""
    patches: _Patches
    pose: Pose = Pose()

    @classmethod
    def of_mesh(cls, mesh: Mesh, patches: _Patches, pose: Pose) -> "PatchedBody":
        """A mesh in the body's frame at a place in the world."""
        # Scanners leave strays far away, which are no part of what a view shows.
        used = np.zeros(len(mesh.vertices), bool)
        used[mesh.faces.reshape(-1)] = True
        number = np.cumsum(used) - 1
        vertices = pose.to_world(mesh.vertices[used])
        return cls(vertices, number[mesh.faces], patches, pose)


def group_patches(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    area: Float[np.ndarray, " s"],
    lattice: Lattice,
    max_patches: int,
    cavities: Cavities | None = None,
) -> _Patches:
    """Finest patches of a body whose number does not exceed `max_patches`.

    Positions [m], unit normals and areas above 0 [m^2] are those of its fragments, in
    the body's frame. Each closed cavity may have six more.

    Raises:
        InputError: for fewer than six: a closed surface faces all six sides.
    """
    if max_patches < 6:
        raise InputError(f"{max_patches} patches a body: give 6 or more, such as 128")
    room = np.zeros(1, int)
    rooms = np.zeros(len(area), int)
    if cavities is not None:
        cavity = cavities.faced(position, normal)
        room = _rooms(np.bincount(cavity, area, cavities.count + 1), max_patches)
        rooms = room[cavity]
    max_patches += _SIDES * int(room.max())
    longest = max(lattice.shape)
    cells = _Cells(lattice, longest)
    for voxels in np.unique(np.ceil(longest / np.geomspace(1.0, 64.0, 49)))[::-1]:
        finer = _Cells(lattice, int(voxels))
        if len(np.unique(finer.codes(position, normal, rooms))) > max_patches:
            break
        cells = finer
    codes = cells.codes(position, normal, rooms)
    code, patch = np.unique(codes, return_inverse=True)
    patch = patch.reshape(-1)
    total = np.bincount(patch, area, len(code))
    mean = [np.bincount(patch, area * position[:, i], len(code)) for i in range(3)]
    centre = np.stack(mean, axis=1) / total[:, None]
    return _Patches(
        patch=patch,
        area=total,
        centre=centre,
        code=code,
        cells=cells,
        cavities=cavities,
        room=room,
    )


def _rooms(area: Float[np.ndarray, " c"], max_patches: int) -> Int[np.ndarray, " c"]:
    """Number of the room of the outside, 0, and of each cavity, by area [m^2]."""
    # Voxels of a folded surface may enclose very many tiny cavities: the largest have
    # patches of their own, no more than the outside has.
    largest = np.argsort(-area[1:], kind="stable")[: max_patches // _SIDES] + 1
    room = np.zeros(len(area), int)
    room[largest] = np.arange(1, len(largest) + 1)
    return room
