"""Surface fragments of a body, whatever divides it: voxels, or cells of a thin wall.

Terms, cameras and contacts ask for nothing else of a body's shape.
"""

import abc
from functools import cached_property
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry.mesh import Mesh
from ..shown import html_of
from .cavities import AbstractCavities
from .fragment_pieces import FragmentPieces
from .lattice import Lattice
from .represented import Represented
from .selection import AbstractSelection, FragmentCentres
from .thin_conduction import ThinConduction


class AbstractGrid(abc.ABC):
    """Mesh of a body, and the fragments of its surface with their true areas."""

    is_two_sided: ClassVar[bool] = False
    """True if both sides of every triangle are surfaces: those of a thin wall."""

    mesh: Mesh
    lattice: Lattice
    """Cells around the mesh."""
    fragment_position: Float[np.ndarray, "s 3"]
    """Position in the body's frame [m]."""
    fragment_normal: Float[np.ndarray, "s 3"]
    """Outward unit normal."""
    fragment_area: Float[np.ndarray, " s"]
    """True area [m^2]."""
    fragment_depth: Float[np.ndarray, " s"] | None
    """Distance from the surface down to `fragment_centre` along the normal [m]; None
    for half the pitch."""
    unscaled_because: str
    """Reason why areas and volume are not those of the mesh; empty if they are."""

    def _repr_html_(self) -> str:
        return html_of(self)

    @property
    def pitch(self) -> float:
        """Edge of a cell [m]."""
        return self.lattice.pitch

    @property
    def fragment_edge(self) -> float | Float[np.ndarray, " s"]:
        """Edge of a square that each fragment covers [m]: the pitch, for voxels."""
        return self.pitch

    @property
    @abc.abstractmethod
    def fragment_foot(self) -> Float[np.ndarray, "s 3"]:
        """Point of the surface whose temperature each fragment has [m]."""

    @property
    @abc.abstractmethod
    def fragment_centre(self) -> Float[np.ndarray, "s 3"]:
        """Centre of the voxel, or place in the wall, below each fragment [m]."""

    @property
    def fragment_face(self) -> Int[np.ndarray, " s"] | None:
        """Side of a thin wall: 0 at its front, 1 at its back; None for a solid."""
        return None

    @property
    def pieces(self) -> FragmentPieces | None:
        """Pieces of the fragments; None where each of them is plane."""
        return None

    @property
    def adiabatic(self) -> Bool[np.ndarray, " s"] | None:
        """Fragments on which only terms that name them act; None for none."""
        return None

    def reached_by(
        self, selection: AbstractSelection | None
    ) -> Bool[np.ndarray, " s"] | None:
        """Fragments on which a term on a selection may act; None for all of them."""
        if self.adiabatic is None:
            return None
        reached = ~self.adiabatic
        if selection is not None:
            reached |= selection.named(self.fragment_centres)
        return reached

    @property
    def fragment_centres(self) -> FragmentCentres:
        """All that a selection asks of the fragments."""
        return FragmentCentres(
            position=self.fragment_position,
            normal=self.fragment_normal,
            face=self.fragment_face,
        )

    @property
    def cavities(self) -> AbstractCavities | None:
        """Closed cavities of the body; None if there are none."""
        return None

    @property
    def fragment_cavity(self) -> Int[np.ndarray, " s"]:
        """Number of the closed cavity that each fragment faces; 0 for none."""
        return np.zeros(len(self.fragment_area), int)

    @property
    def fragment_space(self) -> Int[np.ndarray, " s"]:
        """Number of the space in front of each fragment.

        Each cavity is a space, and so is each face of a thin wall.
        """
        return self.fragment_cavity

    @cached_property
    def cavity_area(self) -> float:
        """Area of the fragments in closed cavities [m^2]."""
        return float(self.fragment_area[self.fragment_cavity > 0].sum())

    @property
    def cavity_volume(self) -> float:
        """Volume of all closed cavities [m^3]."""
        return 0.0

    @property
    def why_open(self) -> str:
        """Remedy for a body that has no closed cavity and needs one."""
        return "it has no cavity: make it hollow, or a Sheet"

    @property
    def opened_area(self) -> float:
        """Area of the mesh's closed cavities that are open in the cells [m^2]."""
        return 0.0

    @property
    def represented(self) -> Represented | None:
        """True against represented volume and area; None where they are equal."""
        return None

    @property
    def area_uncertainty(self) -> float:
        """Relative error of the area that 97 of 100 bodies do not exceed [-]."""
        return 0.0

    @property
    def thin_conduction(self) -> ThinConduction | None:
        """Conduction along parts too thin for the cells; None if there are none."""
        return None

    @property
    def cut_voxel_count(self) -> int:
        """Number of voxels that the surface cuts."""
        return 0

    def selected_fraction(
        self, selection: AbstractSelection
    ) -> Float[np.ndarray, " s"]:
        """Fraction of each fragment that is selected; that of a solid by its voxels."""
        return selection.select(self.fragment_centres).astype(float)

    @abc.abstractmethod
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points (in the body's frame) that lie in its solid."""
