"""The full volume: every solid voxel is a node, linked over its faces."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from ..voxels.grid import VoxelGrid
from .structure import AbstractStructure, Links, Nodes


@dataclass(frozen=True, eq=False)
class FullVolume(AbstractStructure):
    """Every solid voxel, linked to its six neighbours; the reference for all others.

    It runs as a dense masked stencil over the bounding box, or, with `stencil=False`,
    as sorted links: slower, the same to rounding, and the stencil's tested reference.
    """

    grid: VoxelGrid
    stencil: bool = True

    @property
    def node_count(self) -> int:
        """How many voxels are solid."""
        return self.grid.solid_count

    @property
    def link_count(self) -> int:
        """How many pairs of solid voxels share a face."""
        return sum(int(np.count_nonzero(pair)) for pair in self._shared_faces())

    def _shared_faces(self):
        """For each axis: which voxels and their next ones along it are both solid."""
        for axis in range(3):
            body = np.moveaxis(self.grid.solid, axis, 0)
            yield np.moveaxis(body[:-1] & body[1:], 0, axis)

    def _numbers(self) -> Int[np.ndarray, "x y z"]:
        """Node number of each solid voxel, in C order; meaningless elsewhere."""
        solid = self.grid.solid
        return (np.cumsum(solid.reshape(-1)) - 1).reshape(solid.shape)

    def nodes(self) -> Nodes:
        """The solid voxels."""
        cells = np.argwhere(self.grid.solid)
        return Nodes(
            centre=self.grid.lattice.centres(cells),
            volume=np.full(len(cells), self.grid.voxel_volume),
            level=np.zeros(len(cells), np.int32),
        )

    def links(self) -> Links:
        """One link per shared face, of area pitch^2 over a distance of one pitch."""
        number = self._numbers()
        src, dst = [], []
        for axis, shared in enumerate(self._shared_faces()):
            along = np.moveaxis(number, axis, 0)
            both = np.moveaxis(shared, axis, 0)
            src.append(along[:-1][both])
            dst.append(along[1:][both])
        first, second = np.concatenate(src), np.concatenate(dst)
        order = np.lexsort([second, first])
        return Links(
            src=first[order].astype(np.int32),
            dst=second[order].astype(np.int32),
            area=np.full(len(order), self.grid.pitch**2),
            distance=np.full(len(order), self.grid.pitch),
        )

    def fragment_node(self) -> Int[np.ndarray, " s"]:
        """The voxel of each fragment, as a node number."""
        return self._numbers()[tuple(self.grid.fragment_voxel.T)]

    @property
    def dense(self) -> Bool[np.ndarray, "x y z"] | None:
        """The solid voxels, unless the general link operator was asked for."""
        return self.grid.solid if self.stencil else None
