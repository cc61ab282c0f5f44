"""Voxel grid: the solid voxels of a body and its surface fragments."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry.mesh import Mesh
from .lattice import Lattice


@dataclass(frozen=True)
class LayerCounts:
    """Numbers of depth layers along x, y, z: all, and packed without duplicates."""

    peeled: tuple[int, int, int]
    packed: tuple[int, int, int]


@dataclass(frozen=True)
class ThinParts:
    """Parts thinner than a voxel along a ray, and those lost without any voxel."""

    thin_fragments: int
    thin_area: float
    """Area of the fragments on parts less than one voxel thick [m^2]."""
    lost_fragments: int
    lost_area: float
    """Area of the fragments without a solid voxel nearby [m^2]."""
    regions: tuple[dict, ...]
    """Largest thin regions: centre [m], thickness [m], area [m^2], lost fraction."""


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Solid voxels of a body, with surface fragments that have true areas.

    A fragment is the point of the mesh where the ray through a column of voxel centres
    crosses it, along the dominant axis i of its normal n; each piece of surface has
    one. Its area is pitch^2 / |n_i|, scaled to the mesh's area if that is watertight.
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
    """Dominant axis of the normal: 0, 1 or 2."""
    fragment_layer: Int[np.ndarray, "s 2"]
    """Depth layer along the dominant axis, among all and packed."""
    area_ratio: float
    """Area of the mesh over that of the unscaled fragments [-]; 1 if unreliable."""
    volume_ratio: float
    """Volume of the mesh over that of the voxels [-]; 1 if unreliable."""
    layers: LayerCounts
    thin: ThinParts
    unscaled_because: str = ""
    """Reason why the two ratios are unreliable; empty if they apply."""

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.lattice.pitch

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        """Lowest corner of the lattice [m]."""
        return self.lattice.origin

    @property
    def solid_count(self) -> int:
        """Number of solid voxels."""
        return int(np.count_nonzero(self.solid))

    @property
    def voxel_volume(self) -> float:
        """Volume of a voxel, including `volume_ratio` [m^3]."""
        return float(self.pitch**3 * self.volume_ratio)
