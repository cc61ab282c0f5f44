"""Both faces of a sheet: the fragments of its surface."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree
from typing_extensions import override
from wadler_lindig import TextDoc

from ..arrays import Numbered, numbered
from ..geometry.mesh import Mesh
from ..geometry.vectors import row_length, triangle_normals, unit_vectors
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.fragment_pieces import FragmentPieces
from ..voxels.lattice import Lattice
from ..voxels.selection import FACES, AbstractSelection, AbstractSpace, SurfaceSamples
from .cells import SheetCells
from .insides import SheetInsides, find_insides
from .surface import corner_thirds


FRONT = FACES.index("front")
BACK = FACES.index("back")

# Edge of a square within a fragment, over that of one of its area.
_INSCRIBED = 0.8

_AHEAD = 1e-6
"""Distance from the surface at which a point is on one side of it, over the diagonal of
the mesh [-]."""


class SheetThirds(NamedTuple):
    """Thirds of triangles, nearest to each of their corners: one face of a sheet."""

    position: Float[np.ndarray, "n 3"]
    """Centroids [m]."""
    area: Float[np.ndarray, " n"]
    """[m^2]"""


# Without the representation of dataclasses, which prints the first nodes.
@dataclass(frozen=True, eq=False, repr=False)
class SheetGrid(AbstractGrid):
    """Cells of a surface whose two faces both have fragments.

    Those of the front come first, those of the back follow in the same order: at the
    same positions and with opposite normals.
    """

    is_two_sided: ClassVar[bool] = True

    mesh: Mesh
    lattice: Lattice
    cells: SheetCells
    fragment_position: Float[np.ndarray, "s 3"]
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    fragment_surface_cell: Int[np.ndarray, " s"]
    """Cell of the surface that each fragment is a piece of."""
    fragment_part: Int[np.ndarray, " s"]
    """Part of the mesh that each fragment is on."""
    part_names: tuple[str, ...] = ()
    """Names of the parts; empty for a mesh without."""
    fragment_depth: Float[np.ndarray, " s"] | None = None
    unscaled_because: str = ""
    has_adiabatic_back: bool = False
    """True if only terms that name the back act on it."""

    def __repr__(self) -> str:
        return (
            f"SheetGrid({self.mesh.name!r}, {self.cells.node_count} cells of "
            f"{self.pitch:g} m, {len(self.fragment_area)} fragments)"
        )

    # Equinox prints what a module holds by this.
    def __pdoc__(self, **kwargs: object) -> TextDoc:
        del kwargs
        return TextDoc(repr(self))

    @cached_property
    @override
    def fragment_foot(self) -> Float[np.ndarray, "s 3"]:
        # Not the middle of the fragment: nodes at a free border are on it.
        return self.cells.position[self.fragment_surface_cell]

    @property
    @override
    def fragment_centre(self) -> Float[np.ndarray, "s 3"]:
        return self.fragment_foot

    @cached_property
    @override
    def fragment_edge(self) -> Float[np.ndarray, " s"]:
        # A square within the fragment, whatever its shape: light does not come around
        # the border of a sheet.
        inscribed = _INSCRIBED * np.sqrt(self.fragment_area)
        return np.minimum(inscribed, self.pitch)

    @cached_property
    @override
    def fragment_face(self) -> Int[np.ndarray, " s"]:
        return np.repeat([FRONT, BACK], len(self.fragment_area) // 2)

    @cached_property
    @override
    def pieces(self) -> FragmentPieces:
        front = self.cells.fragments.pieces
        back = front.fragment + len(self.cells.fragments.area)
        return FragmentPieces(
            fragment=np.concatenate([front.fragment, back]),
            normal=np.concatenate([front.normal, -front.normal]),
            share=np.tile(front.share, 2),
        )

    @cached_property
    @override
    def adiabatic(self) -> Bool[np.ndarray, " s"] | None:
        return self.fragment_face == BACK if self.has_adiabatic_back else None

    @cached_property
    @override
    def cavities(self) -> SheetInsides | None:
        # The few faces that the many triangles are pieces of.
        return find_insides(self.cells.welded.vertices, self.cells.welded.faces)

    @cached_property
    @override
    def fragment_cavity(self) -> Int[np.ndarray, " s"]:
        if self.cavities is None:
            return np.zeros(len(self.fragment_area), int)
        # Fragments combine pieces of triangles: their centres are near the surface, but
        # not on it. The nearest triangle of like normal is.
        cells = self.cells
        corners = cells.vertices[cells.faces]
        normal = unit_vectors(triangle_normals(corners))
        centre = np.concatenate([corners.mean(axis=1), self.pitch * normal], axis=1)
        half = len(self.fragment_area) // 2
        front = np.concatenate(
            [self.fragment_position[:half], self.pitch * self.fragment_normal[:half]],
            axis=1,
        )
        _, triangle = KDTree(centre).query(front)
        return self._cavity_ahead(np.asarray(triangle)).T.reshape(-1)

    @property
    @override
    def cavity_volume(self) -> float:
        # Gauss's theorem, from the middle of the mesh; the winding does not say on
        # which side of a face the inside is.
        mesh = self.mesh
        corners = mesh.vertices[mesh.faces[self.traced_faces]] - mesh.bounds.mean(
            axis=0
        )
        front, back = (self.face_space // 2 > 0).T
        outward = back.astype(int) - front
        return float((outward * np.linalg.det(corners)).sum() / 6)

    @property
    @override
    def why_open(self) -> str:
        border = self.cells.border
        return f"its mesh has a border of {border:.3g} m: close it, or give `weld`"

    @property
    @override
    def fragment_space(self) -> Int[np.ndarray, " s"]:
        return 2 * self.fragment_cavity + self.fragment_face

    @cached_property
    def _origins(self) -> Numbered:
        """Faces of the mesh that the triangles of the cells are pieces of."""
        return numbered(self.cells.face_origin)

    @property
    def traced_faces(self) -> Int[np.ndarray, " f"]:
        """Faces of the mesh that are surface: others are double or have no area."""
        return self._origins.value

    @property
    def traced_face(self) -> Int[np.ndarray, " t"]:
        """Rank among `traced_faces` of the face that each triangle is a piece of."""
        return self._origins.number

    @cached_property
    def face_space(self) -> Int[np.ndarray, "f 2"]:
        """Space, as in `fragment_space`, on both sides of each of `traced_faces`."""
        return 2 * self._cavity_ahead(self._origins.first) + [FRONT, BACK]

    def _cavity_ahead(self, triangle: Int[np.ndarray, " t"]) -> Int[np.ndarray, "t 2"]:
        """Number of the cavity in front of and behind triangles of the cells."""
        if self.cavities is None:
            return np.zeros((len(triangle), 2), int)
        corners = self.cells.vertices[self.cells.faces[triangle]]
        size = np.linalg.norm(np.ptp(self.mesh.bounds, axis=0))
        ahead = _AHEAD * size * unit_vectors(triangle_normals(corners))
        centre = corners.mean(axis=1)
        at = self.cavities.at(np.concatenate([centre + ahead, centre - ahead]))
        return at.reshape(2, -1).T

    @override
    def selected_fraction(
        self, selection: AbstractSelection
    ) -> Float[np.ndarray, " s"]:
        fragments = self.cells.fragments
        front = fragments.of_corner.ravel()
        fragment = np.concatenate([front, front + len(fragments.area)])
        thirds = self.thirds
        samples = SurfaceSamples(
            fragments=self.fragment_centres,
            fragment=fragment,
            points=np.concatenate([thirds.position, thirds.position])[None],
        )
        (is_selected,) = selection.contains_samples(samples)
        area = np.tile(thirds.area, 2) * is_selected
        selected_area = np.bincount(fragment, area, len(self.fragment_area))
        return selected_area / self.fragment_area

    def cell_fractions(self, space: AbstractSpace) -> Float[np.ndarray, " n"]:
        """Fraction of each cell of the surface that lies in a part of space."""
        count = self.cells.node_count
        area = self.fragment_area * self.selected_fraction(space)
        both_faces = np.bincount(self.fragment_surface_cell, area, count)
        return both_faces / (2 * self.cells.area.sum(axis=1))

    def fragments_at(
        self,
        points: Float[np.ndarray, "k 3"],
        *,
        triangle: Int[np.ndarray, " k"],
        is_back: Bool[np.ndarray, " k"],
    ) -> Int[np.ndarray, " k"]:
        """Fragment of each point [m] of a triangle of the cells, on either face."""
        corners = self.cells.vertices[self.cells.faces[triangle]]
        normal = triangle_normals(corners)
        to_corner = corners - points[:, None]
        # Twice the areas of the triangles opposite to each corner: its barycentric
        # coordinate is the largest in the third that is nearest to it.
        opposite = np.cross(to_corner[:, [1, 2, 0]], to_corner[:, [2, 0, 1]])
        third = np.einsum("kci,ki->kc", opposite, normal).argmax(axis=1)
        front = self.cells.fragments.of_corner[triangle, third]
        return front + np.where(is_back, len(self.cells.fragments.area), 0)

    @cached_property
    def thirds(self) -> SheetThirds:
        """Thirds of the triangles of the cells."""
        cells = self.cells
        position = corner_thirds(cells.vertices, cells.faces).reshape(-1, 3)
        return SheetThirds(position=position, area=np.repeat(cells.face_area / 3, 3))

    @cached_property
    def fragment_reach(self) -> float:
        """Largest distance of a point of the surface from its fragment [m]."""
        cells = self.cells
        corners = [cells.vertices.take(vertex, axis=0) for vertex in cells.faces.T]
        centroid = (corners[0] + corners[1] + corners[2]) / 3
        reach = 0.0
        for number, fragment in enumerate(cells.fragments.of_corner.T):
            position = cells.fragments.position.take(fragment, axis=0)
            corner = corners[number]
            following = (corner + corners[(number + 1) % 3]) / 2
            preceding = (corner + corners[(number + 2) % 3]) / 2
            # A third is convex: one of its corners is the farthest point.
            for point in (corner, following, centroid, preceding):
                reach = max(reach, float(row_length(point - position).max()))
        return reach

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        # A wall has no inside that a point could be in.
        return np.zeros(len(points), bool)


def sheet_grid(
    mesh: Mesh,
    cells: SheetCells,
    part_names: tuple[str, ...] = (),
    has_adiabatic_back: bool = False,
) -> SheetGrid:
    """Fragments of both faces of the cells of a surface."""
    front = cells.fragments
    normal = front.normal
    return SheetGrid(
        mesh=mesh,
        lattice=Lattice.around(mesh, cells.pitch),
        cells=cells,
        fragment_position=np.concatenate([front.position, front.position]),
        fragment_normal=np.concatenate([normal, -normal]),
        fragment_area=np.concatenate([front.area, front.area]),
        fragment_surface_cell=np.concatenate([front.node, front.node]),
        fragment_part=np.concatenate([front.part, front.part]),
        part_names=part_names,
        has_adiabatic_back=has_adiabatic_back,
    )
