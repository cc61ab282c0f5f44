"""`VoxelGrid`: the solid voxels of a body and its surface fragments."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry.mesh import Mesh
from .lattice import Lattice


@dataclass(frozen=True)
class LayerCounts:
    """Depth layers along x, y, z as peeled, and after keeping each voxel once."""

    peeled: tuple[int, int, int]
    packed: tuple[int, int, int]


@dataclass(frozen=True)
class ThinParts:
    """What is thinner than a voxel along a ray, and what of it has no voxel at all."""

    thin_fragments: int
    thin_area: float
    """Area [m^2] of the fragments on parts under one voxel thick."""
    lost_fragments: int
    lost_area: float
    """Area [m^2] of the fragments that no solid voxel is near: these parts are lost."""
    places: tuple[dict, ...]
    """The largest thin places: centre [m], thickness [m], area [m^2], lost share."""


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """A body as solid voxels, with surface fragments that carry true areas.

    A fragment lies on the mesh where the ray through a column of voxel centres crosses
    it, along the dominant axis i of its normal n, so each piece of surface has one.
    Its area is pitch^2 / |n_i|, scaled to the mesh's area if the mesh is watertight.
    """

    lattice: Lattice
    solid: Bool[np.ndarray, "x y z"]
    mesh: Mesh
    fragment_position: Float[np.ndarray, "s 3"]
    """[m]"""
    fragment_normal: Float[np.ndarray, "s 3"]
    """Outward."""
    fragment_area: Float[np.ndarray, " s"]
    """True area [m^2], after scaling by `area_ratio`."""
    fragment_voxel: Int[np.ndarray, "s 3"]
    """Cell of the solid voxel each fragment belongs to."""
    fragment_axis: Int[np.ndarray, " s"]
    """Dominant axis of the normal: 0, 1 or 2."""
    fragment_layer: Int[np.ndarray, "s 2"]
    """Depth layer along the dominant axis, as peeled and as packed."""
    area_ratio: float
    """Mesh area over area of the fragments before scaling; 1 if not to be trusted."""
    volume_ratio: float
    """Mesh volume over volume of the voxels; 1 if not to be trusted."""
    layers: LayerCounts
    thin: ThinParts
    unscaled_because: str = ""
    """Why the two ratios are not to be trusted; empty if they are."""

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
        """How many voxels are solid."""
        return int(np.count_nonzero(self.solid))

    @property
    def voxel_volume(self) -> float:
        """True volume that one voxel stands for [m^3]."""
        return float(self.pitch**3 * self.volume_ratio)
