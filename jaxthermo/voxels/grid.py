"""Voxel grid: the solid voxels of a body and its surface fragments, and a report."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypedDict

import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override
from wadler_lindig import TextDoc

from ..geometry.mesh import Mesh, connected_labels, part_volumes
from .abstract_grid import AbstractGrid
from .cavities import Cavities, find_cavities
from .cut_voxels import CutVoxels
from .lattice import Lattice
from .represented import Represented, RepresentedReport, represented
from .surface import surface_links, surface_voxels
from .thin_conduction import ThinBody, ThinConduction, thin_conduction
from .thin_parts import ThinParts, ThinRegion


# Smaller fractions of a body's surface are not told to face a cavity that is open.
_OPENED = 0.02


@dataclass(frozen=True)
class LayerCounts:
    """Numbers of depth layers along x, y, z: all, and packed without duplicates."""

    peeled: tuple[int, ...]
    packed: tuple[int, ...]


# Without the representation of dataclasses, which prints the first voxels.
@dataclass(frozen=True, eq=False, repr=False)
class VoxelGrid(AbstractGrid):
    """Solid voxels of a body, with surface fragments that have true areas.

    A fragment is the point of the mesh where the ray through a column of voxel centres
    crosses it. There is one on every exposed voxel face, across any axis a, with the
    area pitch^2 |n_a|, n being its normal; for a watertight mesh what rays miss or add
    is made good nearby (`cell_areas`), and the rest scaled by at most 2 %. With
    `surface_cells="dominant_axis"` only rays along the dominant axis i of the normal
    count, each piece of surface has one fragment of the area pitch^2 / |n_i|, and the
    areas are scaled by any factor.
    """

    lattice: Lattice
    solid: Bool[np.ndarray, "x y z"]
    mesh: Mesh
    fragment_position: Float[np.ndarray, "s 3"]
    """Position in the body's frame [m]."""
    fragment_normal: Float[np.ndarray, "s 3"]
    """Outward unit normal."""
    fragment_area: Float[np.ndarray, " s"]
    """True area, including `area_ratio` [m^2]."""
    fragment_voxel: Int[np.ndarray, "s 3"]
    """Cell of the solid voxel that each fragment belongs to."""
    fragment_axis: Int[np.ndarray, " s"]
    """Axis of its ray: 0, 1 or 2; the dominant one of the normal, but for crossings."""
    fragment_layer: Int[np.ndarray, "s 2"]
    """Depth layer along that axis, among all and packed; -1 where that is not the
    dominant axis of the normal, as packed layers have each piece of surface once."""
    area_ratio: float
    """Area of the mesh, but for what lies inside the body, over that of the unscaled
    fragments [-]; 1 if not applied."""
    volume_ratio: float
    """Volume of the mesh over that of the voxels [-]; 1 if not applied."""
    layers: LayerCounts
    thin: ThinParts
    unscaled_because: str = ""
    """Reason why the mesh has no volume to scale to; empty if both ratios apply. With
    overlapping parts the area is scaled, and that of an open mesh is not."""
    fragment_depth: Float[np.ndarray, " s"] | None = None
    """Distance from each fragment's voxel centre to the surface along the normal [m];
    None for half a voxel."""
    cut: CutVoxels | None = None
    """Voxels that the surface cuts; None if every voxel counts as a whole."""

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.lattice.shape))
        return (
            f"VoxelGrid({self.mesh.name!r}, {shape} voxels of {self.pitch:g} m, "
            f"{self.solid_count} solid, {len(self.fragment_area)} fragments)"
        )

    # Equinox prints what a module holds by this.
    def __pdoc__(self, **kwargs: object) -> TextDoc:
        del kwargs
        return TextDoc(repr(self))

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        """Lowest corner of the lattice [m]."""
        return self.lattice.origin

    @cached_property
    def solid_count(self) -> int:
        """Number of solid voxels."""
        return int(np.count_nonzero(self.solid))

    @property
    @override
    def fragment_centre(self) -> Float[np.ndarray, "s 3"]:
        return self.lattice.centres(self.fragment_voxel)

    @cached_property
    @override
    def fragment_foot(self) -> Float[np.ndarray, "s 3"]:
        """Point of the surface whose temperature each fragment has [m].

        Of crossings the one nearest to the voxel's centre: the crossing itself may be
        half a voxel beside it. All cells of a voxel at a plane surface have the same.
        """
        if self.fragment_depth is None:
            return self.fragment_position
        centre = self.fragment_centre
        # Not by `fragment_depth`, which is at least a tenth of a voxel.
        above = (self.fragment_position - centre) * self.fragment_normal
        return centre + above.sum(axis=1, keepdims=True) * self.fragment_normal

    def is_packed(self, axis: int) -> Bool[np.ndarray, " s"]:
        """True for the fragments that the packed layers along an axis show."""
        return (self.fragment_axis == axis) & (self.fragment_layer[:, 1] >= 0)

    @cached_property
    @override
    def cavities(self) -> Cavities | None:
        """Closed cavities of the body; None if there are none."""
        # A ray through a cavity crosses the surface four times, and two of the three
        # axes must have found the cavity empty: most bodies need no search.
        if sorted(self.layers.peeled)[1] < 4:
            return None
        return find_cavities(self.solid, self.lattice)

    @cached_property
    @override
    def fragment_cavity(self) -> Int[np.ndarray, " s"]:
        """Number of the closed cavity that each fragment faces; 0 for none."""
        if self.cavities is None:
            return np.zeros(len(self.fragment_area), int)
        return self.cavities.faced(self.fragment_position, self.fragment_normal)

    @property
    @override
    def cavity_volume(self) -> float:
        cavities = self.cavities
        if cavities is None:
            return 0.0
        return float((cavities.stop - cavities.start).sum()) * self.pitch**3

    @cached_property
    @override
    def opened_area(self) -> float:
        """Area of the mesh's closed cavities that are open in the voxels [m^2]."""
        # Only walls thinner than a voxel have holes, and few bodies have such walls.
        thin = self.thin.thin_fragments + self.thin.lost_fragments
        if sorted(self.layers.peeled)[1] < 4 or not thin:
            return 0.0
        closed = self.cavity_area
        opened = _cavity_area(self.mesh) - float(closed)
        # The areas of fragments are not exact.
        return opened if opened > _OPENED * self.mesh.area else 0.0

    @property
    def voxel_volume(self) -> float:
        """Volume of a whole voxel, including `volume_ratio` [m^3]."""
        return float(self.pitch**3 * self.volume_ratio)

    @property
    @override
    def cut_voxel_count(self) -> int:
        return 0 if self.cut is None or self.cut.is_empty else len(self.cut.voxel)

    @property
    def surface_cells(self) -> str:
        """Kind of the surface: "crossings" or "dominant_axis"."""
        return "dominant_axis" if self.cut is None else "crossings"

    @cached_property
    def solid_volumes(self) -> Float[np.ndarray, " v"] | None:
        """Volumes of the solid voxels [voxels]; None if all are whole."""
        return None if self.cut is None else self.cut.spread(self.solid)

    @cached_property
    @override
    def represented(self) -> Represented | None:
        """True against represented; None for whole voxels and meshes not closed."""
        if self.cut is None or self.unscaled_because:
            return None
        area = float(self.fragment_area.sum()) / self.area_ratio
        return represented(
            self.mesh, lattice=self.lattice, solid=self.solid, cut=self.cut, area=area
        )

    @cached_property
    @override
    def area_uncertainty(self) -> float:
        """Relative error of the area that 97 of 100 bodies do not exceed [-].

        0 where the area is the mesh's. Rays meet the edges of what is hidden by chance,
        1.5 N^(-3/4) of an area of N voxel faces. Measured on unions of boxes along the
        lattice; those in random turns have a tenth of it.
        """
        if not self.unscaled_because:
            return 0.0
        cells = float(self.fragment_area.sum()) / self.pitch**2
        return min(1.5 * cells**-0.75, 1.0) if cells else 1.0

    @cached_property
    @override
    def thin_conduction(self) -> ThinConduction | None:
        """Conduction along parts of up to two voxels; None if there are hardly any."""
        if self.cut is None or self.unscaled_because or self.solid_volumes is None:
            return None
        return thin_conduction(
            ThinBody(
                lattice=self.lattice,
                solid=self.solid,
                links=self.cut.links,
                volume=self.solid_volumes,
                fragment_voxel=self.fragment_voxel,
                fragment_foot=self.fragment_foot,
                fragment_normal=self.fragment_normal,
                fragment_area=self.fragment_area,
            )
        )

    @cached_property
    def size(self) -> float:
        """Volume of the body [whole voxels]."""
        # Without an array of all voxels, which would be the largest of a coarse run.
        missing = 0.0 if self.cut is None else float((1 - self.cut.volume).sum())
        return self.solid_count - missing

    @property
    def body_volume(self) -> float:
        """Volume of the body, including `volume_ratio` [m^3]."""
        return self.size * self.voxel_volume

    def volume_at(self, voxels: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Volumes of solid voxels [m^3]."""
        if self.cut is None:
            return np.full(len(voxels), self.voxel_volume)
        return self.cut.volumes_at(voxels, self.solid.shape) * self.voxel_volume

    def volume_of(
        self,
        group: Int[np.ndarray, " v"],
        count: int,
        fraction: Float[np.ndarray, " v"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Volumes of `count` groups of solid voxels [m^3]; -1 is in no group.

        Of each voxel a fraction counts, or all of it for None.
        """
        inside = group >= 0
        weights = None if self.solid_volumes is None else self.solid_volumes[inside]
        if fraction is not None:
            volumes = 1.0 if weights is None else weights
            weights = fraction[inside] * volumes
        return np.bincount(group[inside], weights, count) * self.voxel_volume

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points (in the body's frame) that lie in a solid voxel."""
        cells = self.lattice.to_cells(points)
        inside = (cells >= 0) & (cells < self.solid.shape)
        is_solid: Any = inside.all(1)
        voxels = np.floor(cells[is_solid]).astype(int)
        is_solid[is_solid] = self.solid[tuple(voxels.T)]
        return is_solid


def _cavity_area(mesh: Mesh) -> float:
    """Area of the parts that point inward [m^2]; 0 for an open mesh."""
    # Parts by shared vertices, which needs no list of edges: most meshes are one part.
    links = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    root_of_vertex = connected_labels(len(mesh.vertices), links)
    roots = root_of_vertex[mesh.faces[:, 0]]
    part_roots, labels = np.unique(roots, return_inverse=True)
    labels = labels.reshape(-1)
    if len(part_roots) < 2 or not mesh.is_watertight:
        return 0.0
    inward = part_volumes(mesh, labels=labels, count=len(part_roots)) < 0.0
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    is_cavity = inward[labels]
    return float(area[is_cavity].sum())


class _LayerReport(TypedDict):
    """Depth layers along one axis."""

    file_axis: str
    """Name of the axis in the mesh file."""
    peeled: int
    packed: int


class _ThinArea(TypedDict):
    """Surface on thin parts."""

    fragments: int
    area_m2: float


class _ThinReport(TypedDict):
    """Parts of less than a voxel's thickness."""

    thinner_than_a_voxel: _ThinArea
    lost_for_want_of_a_voxel: _ThinArea
    largest_places: list[ThinRegion]


class _ClosedMeshReport(TypedDict, total=False):
    """Part of the report of a closed mesh."""

    represented: RepresentedReport


class VoxelReport(_ClosedMeshReport):
    """Counts, layers, true areas and volumes, and thin parts; units in the keys."""

    pitch_m: float
    lattice_shape: list[int]
    lattice_origin_m: list[float]
    solid_voxels: int
    solid_share_of_lattice: float
    surface_voxels: int
    surface_links: int
    fragments: int
    layers: dict[str, _LayerReport]
    area_m2: dict[str, float]
    volume_m3: dict[str, float | None]
    surface_cells: str
    area_ratio: float
    volume_ratio: float
    ratios_applied: bool
    ratios_not_applied_because: str | None
    thin_parts: _ThinReport


def voxel_report(grid: VoxelGrid) -> VoxelReport:
    """Report of a grid as plain types; axes have z up."""
    surface = surface_voxels(grid.solid)
    counts = zip(grid.layers.peeled, grid.layers.packed, grid.mesh.axes, strict=True)
    thin = grid.thin
    volume = grid.mesh.volume if grid.mesh.is_watertight else None
    closed: _ClosedMeshReport = {}
    if grid.represented is not None:
        closed = {"represented": grid.represented.as_dict()}
    return VoxelReport(
        pitch_m=grid.pitch,
        lattice_shape=list(grid.lattice.shape),
        lattice_origin_m=[float(c) for c in grid.origin],
        solid_voxels=grid.solid_count,
        solid_share_of_lattice=grid.solid_count / grid.lattice.cells,
        surface_voxels=len(surface),
        surface_links=len(surface_links(surface, grid.lattice.shape)),
        fragments=len(grid.fragment_area),
        layers={
            axis: _LayerReport(file_axis=name, peeled=peeled, packed=packed)
            for axis, (peeled, packed, name) in zip("xyz", counts, strict=True)
        },
        area_m2={
            "mesh": grid.mesh.area,
            "fragments_unscaled": float(grid.fragment_area.sum() / grid.area_ratio),
        },
        volume_m3={"mesh": volume, "voxels_unscaled": grid.size * grid.pitch**3},
        surface_cells=grid.surface_cells,
        **closed,
        area_ratio=grid.area_ratio,
        volume_ratio=grid.volume_ratio,
        ratios_applied=not grid.unscaled_because,
        ratios_not_applied_because=grid.unscaled_because or None,
        thin_parts=_ThinReport(
            thinner_than_a_voxel=_ThinArea(
                fragments=thin.thin_fragments, area_m2=thin.thin_area
            ),
            lost_for_want_of_a_voxel=_ThinArea(
                fragments=thin.lost_fragments, area_m2=thin.lost_area
            ),
            largest_places=[_finite(region) for region in thin.regions],
        ),
    )


def _finite(region: ThinRegion) -> ThinRegion:
    # JSON has no infinity, which stands for an unknown thickness (no far side).
    thickness = region["thickness_m"]
    if thickness is not None and not np.isfinite(thickness):
        thickness = None
    return ThinRegion(
        centre_m=region["centre_m"],
        thickness_m=thickness,
        area_m2=region["area_m2"],
        lost_share=region["lost_share"],
    )
