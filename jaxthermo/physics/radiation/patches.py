"""Patches of a body's surface: fragments of one grid cell that face one side.

Fragments that face different spaces never share a patch: the outside, a closed cavity,
or the other face of a thin wall.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from ...errors import InputError
from ...geometry.mesh import Pose
from ...memo.found import found
from ...sheets.sheet_grid import SheetGrid
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.cavities import Cavities
from ...voxels.lattice import Lattice
from .patch_codes import CodedPatches, PatchesByCode


# Sides that a fragment may face: up or down its dominant axis.
_SIDES = 6

# Number of patches of all bodies, over the largest one of a body.
_SHARED = 10

# Sizes of cells between one and twice that size.
_CELL_SIZES = 8

# Part of an area that is rounding.
_ROUNDING = 1e-5

# Lines across a patch of mean area.
_LINES_ACROSS_PATCH = 2.0

# Distance below the surface at which its voxel is looked up, in voxels.
_INWARD = 0.25

# Edge of a cell that finds the patches of a thin wall, over the pitch.
_CELL = 1 / 8


@dataclass(frozen=True, eq=False)
class _Cells:
    """Grid of cubes of whole voxels; no fragment's square lies in two of them."""

    lattice: Lattice
    voxels: int
    """Number of voxels along an edge of a cell."""

    @property
    def period(self) -> int:
        """Difference between the codes of one room and those of the next."""
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

    def centres(self, code: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Centre of the cell of each code [m]."""
        _, ny, nz = (n // self.voxels + 1 for n in self.lattice.shape)
        cell = code % self.period // _SIDES
        index = np.stack([cell // (ny * nz), cell // nz % ny, cell % nz], axis=1)
        edge = self.lattice.pitch * self.voxels
        return np.asarray(self.lattice.origin) + (index + 0.5) * edge


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
    """Closed cavities between voxels."""
    room: Int[np.ndarray, " r"]
    """Room of each space, see `AbstractGrid.fragment_space`: 0 for the outside and for
    small spaces, which count as outside."""
    is_enclosed: Bool[np.ndarray, " r"]
    """True for spaces in a closed cavity."""
    is_touched: Bool[np.ndarray, " p"]
    """True for patches that touch another body: lines across no gap meet them, too."""

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.area)

    @property
    def enclosed(self) -> Bool[np.ndarray, " p"]:
        """True for patches in a closed cavity."""
        enclosed_rooms = self.room[self.is_enclosed & (self.room > 0)]
        return np.isin(self.code // self.cells.period, enclosed_rooms)

    def nearest(self, code: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Nearest patch of cells and sides that have none.

        Patches of the same room take precedence over those of other rooms, and in a
        room those of the same side.
        """
        apart = 1.0 + float(np.linalg.norm(np.ptp(self.centre, axis=0)))

        # In further dimensions sides and rooms are farther apart than any two patches.
        def placed(at: np.ndarray, code: np.ndarray) -> np.ndarray:
            side = np.eye(_SIDES)[code % _SIDES]
            room = code // self.cells.period
            return np.column_stack([at, apart * side, 2 * apart * room])

        tree = found(
            (self.code,),
            "patches by side and room",
            lambda: KDTree(placed(self.centre, self.code)),
        )
        _, patch = tree.query(placed(self.cells.centres(code), code))
        return np.asarray(patch)


class _ThinWall(NamedTuple):
    """Patches of both sides of a thin wall, by cells of its faces.

    A face with the corners a, b, c is divided along a - b and along a - c. A cell has
    the patches of the fragment at its middle: fragments reach over the borders of a
    lattice's cells.
    """

    corner: Float[np.ndarray, "f 3"]
    """a of each face in the body's frame [m]."""
    to_cells: Float[np.ndarray, "f 2 3"]
    """From a way from a to numbers of cells along both edges [1/m]."""
    count: Int[np.ndarray, "f 2"]
    """Number of cells along both edges."""
    first: Int[np.ndarray, " f"]
    """First cell of each face; those along a - c follow each other."""
    patch: Int[np.ndarray, "2 n"]
    """Patch of the front and of the back of each cell."""
    face_space: Int[np.ndarray, "f 2"]
    """Space in front of and behind each face."""

    @classmethod
    def of_grid(cls, grid: SheetGrid, patch: Int[np.ndarray, " s"]) -> "_ThinWall":
        """Cells of a sheet's faces, from the patch of each of its fragments."""
        triangles = grid.mesh.vertices[grid.mesh.faces[grid.traced_faces]]
        edges = triangles[:, 1:] - triangles[:, :1]
        length = np.linalg.norm(edges, axis=2)
        count = np.ceil(length / (_CELL * grid.pitch)).astype(np.int64)
        size = count.prod(axis=1)
        first = np.cumsum(size) - size
        face = np.repeat(np.arange(len(size)), size)
        row, column = np.divmod(np.arange(len(face)) - first[face], count[face, 1])
        middle = (np.stack([row, column], axis=1) + 0.5) / count[face]
        points = triangles[face, 0] + np.einsum("ki,kij->kj", middle, edges[face])
        third = _nearest_thirds(grid, points, face)
        fragment = grid.cells.fragments.of_corner.ravel()[third]
        back = fragment + len(grid.cells.fragments.area)
        return cls(
            corner=triangles[:, 0],
            to_cells=count[:, :, None] * np.linalg.pinv(edges).swapaxes(1, 2),
            count=count,
            first=first,
            patch=np.stack([patch[fragment], patch[back]]),
            face_space=grid.face_space,
        )

    def patches_at(
        self, points: Float[np.ndarray, "k 3"], face: Int[np.ndarray, " k"]
    ) -> Int[np.ndarray, "2 k"]:
        """Patches of points on faces of the body, at its front and at its back."""
        way = points - self.corner[face]
        at = np.floor(np.einsum("kij,kj->ki", self.to_cells[face], way))
        row, column = np.clip(at.astype(np.int64), 0, self.count[face] - 1).T
        return self.patch[:, self.first[face] + row * self.count[face, 1] + column]


def _nearest_thirds(
    grid: SheetGrid, points: Float[np.ndarray, "k 3"], face: Int[np.ndarray, " k"]
) -> Int[np.ndarray, " k"]:
    """Nearest third of a triangle of a face's cells to each point on the face."""
    position = grid.thirds.position
    # In a fourth dimension faces are farther apart than anything on one of them: leaves
    # of a wall may be close to each other.
    apart = 2 * float(np.linalg.norm(np.ptp(position, axis=0))) + 1.0
    tree = KDTree(np.column_stack([position, np.repeat(apart * grid.traced_face, 3)]))
    _, third = tree.query(np.column_stack([points, apart * face]))
    return np.asarray(third)


class PatchedBody(NamedTuple):
    """Body with the patches of its surface."""

    vertices: Float[np.ndarray, "v 3"]
    """World [m]."""
    faces: Int[np.ndarray, "f 3"]
    """Counter-clockwise seen from outside."""
    patches: _Patches
    pose: Pose = Pose()
    wall: _ThinWall | None = None
    """Pieces of a thin wall; None for a solid."""

    @property
    def has_rooms(self) -> bool:
        """True for a solid whose closed cavities have patches of their own."""
        return self.wall is None and bool(self.patches.room.any())

    def line_spacing(self, lines: int | None) -> float:
        """Distance between lines that sample its view factors [m].

        `lines` of them are across the body; None for two across a patch.
        """
        if lines is not None:
            return float(np.ptp(self.vertices, axis=0).max()) / lines
        return float(np.sqrt(self.patches.area.mean())) / _LINES_ACROSS_PATCH

    @classmethod
    def of_grid(
        cls, grid: AbstractGrid, patches: _Patches, pose: Pose
    ) -> "PatchedBody":
        """The mesh of a body at a place in the world."""
        mesh = grid.mesh
        mesh_faces = mesh.faces
        wall = None
        if isinstance(grid, SheetGrid):
            mesh_faces = mesh_faces[grid.traced_faces]
            wall = _ThinWall.of_grid(grid, patches.patch)
        # Scanners leave strays far away, which are no part of what a view shows.
        used = np.zeros(len(mesh.vertices), bool)
        used[mesh_faces.reshape(-1)] = True
        number = np.cumsum(used) - 1
        return cls(
            vertices=pose.to_world(mesh.vertices[used]),
            faces=number[mesh_faces],
            patches=patches,
            pose=pose,
            wall=wall,
        )


class SolidPatches(NamedTuple):
    """Patches of all solids of a scene, for points on any of them."""

    bodies: tuple[PatchedBody, ...]
    """All bodies of the scene."""
    first: Int[np.ndarray, " b"]
    """First patch of each body."""
    body: Int[np.ndarray, " f"]
    """Body of each face of all bodies."""
    to_cells: Float[np.ndarray, "3 3 b"]
    """From positions [m] to cells of each body: by coordinate, axis of the cells, and
    body."""
    shift: Float[np.ndarray, "3 f"]
    """Cell of the world's origin, by the faces of all bodies."""
    top: Float[np.ndarray, "3 b"]
    """Cell of the last voxel of each body."""
    stride: Float[np.ndarray, "3 b"]
    """Difference between the codes of neighbouring cells of each body."""
    period: Int[np.ndarray, " b"]
    """Difference between the codes of one room and those of the next."""
    base: Int[np.ndarray, " f"]
    """Smallest code of each face."""
    lowest: Int[np.ndarray, " b"]
    """Smallest code of each body."""
    by_code: PatchesByCode

    @classmethod
    def of_bodies(
        cls, bodies: tuple[PatchedBody, ...], normal: Float[np.ndarray, "f 3"]
    ) -> "SolidPatches":
        """Patches of bodies, whose faces have these normals in the world."""
        first = np.cumsum([0, *(body.patches.count for body in bodies[:-1])])
        base = []
        shift = []
        codes = [np.empty(0, int)]
        numbers = [np.empty(0, int)]
        lowest_codes = []
        faces = np.cumsum([0, *(len(body.faces) for body in bodies)])
        lowest = 0
        to_cells = [_to_cells(body) for body in bodies]
        for n, body in enumerate(bodies):
            local = body.pose.rotate_back(normal[faces[n] : faces[n + 1]])
            rows = np.arange(len(local))
            axis = np.abs(local).argmax(1)
            ahead = local[rows, axis] > 0
            base.append(lowest + 2 * axis + ahead)
            cells = body.patches.cells
            origin = body.pose.to_world(np.asarray(cells.lattice.origin, float))
            at = np.tile(-(origin @ to_cells[n]), (len(local), 1))
            # A face between two voxels belongs to the inner one.
            at[rows, axis] -= np.where(ahead, _INWARD, -_INWARD) / cells.voxels
            shift.append(at)
            lowest_codes.append(lowest)
            if body.wall is None:
                codes.append(body.patches.code + lowest)
                numbers.append(first[n] + np.arange(body.patches.count))
                lowest += cells.period * (int(body.patches.room.max(initial=0)) + 1)
        grids = [body.patches.cells for body in bodies]
        counts = np.array([_counts(grid) for grid in grids], float)
        shapes = np.array([grid.lattice.shape for grid in grids])
        voxels = np.array([grid.voxels for grid in grids])
        z = counts[:, 2]
        return cls(
            bodies=bodies,
            first=first,
            body=np.repeat(np.arange(len(bodies)), np.diff(faces)),
            to_cells=np.stack(to_cells, axis=2),
            shift=np.concatenate(shift).T.copy(),
            top=((shapes - 0.5) / voxels[:, None]).T.copy(),
            stride=_SIDES * np.stack([counts[:, 1] * z, z, np.ones_like(z)]),
            period=np.array([grid.period for grid in grids]),
            base=np.concatenate(base),
            lowest=np.array(lowest_codes),
            by_code=PatchesByCode(
                CodedPatches(np.concatenate(codes), np.concatenate(numbers))
            ),
        )

    def of_faces(self, corners: Float[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " f"]:
        """Patch of each face that lies in one cell and one space; -1 for others."""
        is_simple = [b.wall is None and not b.has_rooms for b in self.bodies]
        face = np.flatnonzero(np.array(is_simple)[self.body])
        # A cell is convex, so that a triangle lies in that of its corners.
        codes = np.stack(
            [self._codes(corners[face, corner], face) for corner in range(3)]
        )
        in_one_cell = (codes[1:] == codes[0]).all(axis=0)
        within = face[in_one_cell]
        patch = np.full(len(corners), -1)
        patch[within] = self._patches(codes[0, in_one_cell], self.body[within])
        return patch

    def at(
        self,
        points: Float[np.ndarray, "n 3"],
        face: Int[np.ndarray, " n"],
        space: Int[np.ndarray, " n"],
    ) -> Int[np.ndarray, " n"]:
        """Number of the patch of points on faces of solids, world [m].

        `space` is the number of the space of its body that each point faces.
        """
        body = self.body[face]
        code = self._codes(points, face)
        enclosed = np.flatnonzero(space)
        for within in np.unique(body[enclosed]):
            inside = enclosed[body[enclosed] == within]
            room = self.bodies[within].patches.room[space[inside]]
            code[inside] += self.period[within] * room
        return self._patches(code, body)

    def _codes(
        self, points: Float[np.ndarray, "n 3"], face: Int[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """Code of the cell and side of points that face the outside."""
        body = self.body[face]
        coordinates = np.ascontiguousarray(points.T)
        code = self.base[face]
        for axis in range(3):
            at = self.shift[axis][face]
            for row in range(3):
                at += coordinates[row] * self.to_cells[row, axis][body]
            cell = np.floor(np.clip(at, 0, self.top[axis][body]))
            code += (cell * self.stride[axis][body]).astype(int)
        return code

    def _patches(
        self, code: Int[np.ndarray, " n"], body: Int[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """Patch of each code; cells without one have the nearest patch."""

        def nearest(missing: Int[np.ndarray, " m"]) -> CodedPatches:
            unknown, first = np.unique(code[missing], return_index=True)
            within = body[missing[first]]
            patch = np.zeros(len(unknown), int)
            for number in np.unique(within):
                lost = within == number
                patches = self.bodies[number].patches
                local = patches.nearest(unknown[lost] - self.lowest[number])
                patch[lost] = self.first[number] + local
            return CodedPatches(unknown, patch)

        return self.by_code.patches(code, nearest)


def _to_cells(body: PatchedBody) -> Float[np.ndarray, "3 3"]:
    """Matrix from the right of positions to units of cells of a body [1/m]."""
    cells = body.patches.cells
    edge = cells.lattice.pitch * cells.voxels
    return np.asarray(body.pose.rotation, float) / edge


def _counts(cells: _Cells) -> list[int]:
    """Number of cells along each axis."""
    return [n // cells.voxels + 1 for n in cells.lattice.shape]


def group_patches(
    grid: AbstractGrid, *, area: Float[np.ndarray, " s"], max_patches: int
) -> _Patches:
    """Finest patches of a body whose number does not exceed `max_patches`.

    Each closed cavity, and the back of thin walls, may have six more.

    Args:
        grid: surface of the body.
        area: of its fragments that other surfaces see, above 0 [m^2].
        max_patches: number of patches.

    Raises:
        InputError: for fewer than six: a closed surface faces all six sides.
    """
    if max_patches < 6:
        raise InputError(f"{max_patches} patches a body: give 6 or more, such as 128")
    position = grid.fragment_position
    normal = grid.fragment_normal
    lattice = grid.lattice
    sides = 2 if grid.is_two_sided else 1
    cavities = 0 if grid.cavities is None else grid.cavities.count
    space = grid.fragment_space
    room = _rooms(np.bincount(space, area, sides * (cavities + 1)), max_patches)
    rooms = room[space]
    max_patches += _SIDES * int(room.max())
    longest = max(lattice.shape)
    cells = _Cells(lattice, longest)
    steps = int(np.ceil(_CELL_SIZES * np.log2(longest))) + 1
    divisions = 2.0 ** (np.arange(steps) / _CELL_SIZES)
    for voxels in np.unique(np.ceil(longest / divisions))[::-1]:
        finer = _Cells(lattice, int(voxels))
        if len(np.unique(finer.codes(position, normal, rooms))) > max_patches:
            break
        cells = finer
    codes = cells.codes(position, normal, rooms)
    code, patch = np.unique(codes, return_inverse=True)
    patch = patch.reshape(-1)
    total = np.bincount(patch, area, len(code))
    full_area = np.bincount(patch, grid.fragment_area, len(code))
    mean = [np.bincount(patch, area * position[:, i], len(code)) for i in range(3)]
    centre = np.stack(mean, axis=1) / total[:, None]
    return _Patches(
        patch=patch,
        area=total,
        centre=centre,
        code=code,
        cells=cells,
        cavities=grid.cavities if isinstance(grid.cavities, Cavities) else None,
        room=room,
        is_enclosed=np.arange(len(room)) >= sides,
        is_touched=total < full_area * (1 - _ROUNDING),
    )


def shares_of_patches(
    area: Float[np.ndarray, " b"], max_patches: int
) -> Int[np.ndarray, " b"]:
    """Largest number of patches of each body, from its area [m^2].

    All bodies have at most `_SHARED` times the largest number, shared by area, and each
    at least one for every side.
    """
    share = _SHARED * max_patches * area / area.sum()
    return np.clip(share.astype(int), min(_SIDES, max_patches), max_patches)


def _rooms(area: Float[np.ndarray, " c"], max_patches: int) -> Int[np.ndarray, " c"]:
    """Room of each space, from the areas in them [m^2]; 0 for the first space."""
    # Voxels of a folded surface may enclose very many tiny cavities: the largest have
    # patches of their own, no more than the outside has.
    largest = np.argsort(-area[1:], kind="stable")[: max_patches // _SIDES] + 1
    room = np.zeros(len(area), int)
    room[largest] = np.arange(1, len(largest) + 1)
    return room
