"""The full volume: every solid voxel is a node, linked over its faces."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ...voxels.grid import VoxelGrid
from ..build.links import voxel_links
from ..fit_card import as_weights
from ..structure import AbstractStructure, Links, Nodes
from ..weights import ConductionWeights


DENSE = 0.5
"""Share of solid voxels in the box from which a stencil solves as fast as links."""


class FullVolume(AbstractStructure):
    """Every solid voxel, linked to its six neighbours; the reference for all others.

    It runs as a dense masked stencil over the bounding box, or, with `stencil=False`,
    as sorted links: slower, the same to rounding, and the stencil's tested reference.
    """

    grid: VoxelGrid = eqx.field(static=True)
    stencil: bool = eqx.field(static=True, default=True)
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )

    @property
    def runs_as_stencil(self) -> bool:
        """Whether a state is the lattice: not if links were asked for, or weighted."""
        return self.stencil and self.weights.are_one

    def for_solves(self) -> "FullVolume":
        """As links, unless most of the bounding box is solid.

        A solve keeps half a dozen arrays, which are as long as the box for a stencil.
        """
        full = self.grid.solid_count > DENSE * self.grid.solid.size
        return self if full else replace(self, stencil=False)

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
        """Node number of each solid voxel, in C order; -1 elsewhere."""
        solid = self.grid.solid
        number = np.cumsum(solid.reshape(-1), dtype=np.int32).reshape(solid.shape) - 1
        return np.where(solid, number, -1)

    def nodes(self) -> Nodes:
        """The solid voxels."""
        cells = np.argwhere(self.grid.solid)
        centre = self.grid.lattice.centres(cells)
        return Nodes(
            centre=centre,
            volume=np.full(len(cells), self.grid.voxel_volume),
            level=np.zeros(len(cells), np.int32),
            place=centre,
        )

    def links(self) -> Links:
        """One link per shared face, of area pitch^2 over a distance of one pitch."""
        return voxel_links(self._numbers(), self.grid.pitch)

    def fragment_node(self) -> Int[np.ndarray, " s"]:
        """The voxel of each fragment, as a node number."""
        return self._numbers()[tuple(self.grid.fragment_voxel.T)]

    def voxel_node(self) -> Int[np.ndarray, " v"]:
        """Every solid voxel is a node."""
        return np.arange(self.node_count, dtype=np.int32)

    def fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        """None: a fragment's voxel is its node."""
        return np.zeros(self.grid.fragment_position.shape)

    @property
    def capacity_ratio(self) -> float:
        """All of the body is there."""
        return 1.0

    @property
    def state_shape(self) -> tuple[int, ...]:
        """The lattice and one cell round it, or the nodes."""
        if not self.runs_as_stencil:
            return (self.node_count,)
        x, y, z = self.grid.solid.shape
        return (x + 2, y + 2, z + 2)

    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Where every node lies in the state."""
        if not self.runs_as_stencil:
            return (np.arange(self.node_count, dtype=np.int32),)
        return tuple((i + 1).astype(np.int32) for i in np.nonzero(self.grid.solid))
