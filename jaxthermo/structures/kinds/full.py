"""Full volume: every solid voxel is a node, linked over its faces."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ...voxels.grid import VoxelGrid
from ..build.links import voxel_links
from ..structure import AbstractStructure, ConductionWeights, Links, Nodes, as_weights


# Fraction of solid voxels in the box from which a stencil solves as fast as links.
_DENSE = 0.5


class FullVolume(AbstractStructure):
    """Every solid voxel, linked to its six neighbours; the reference for all others.

    It runs as a dense masked stencil over the bounding box, or, with `stencil=False`,
    as sorted links: slower, but equal to rounding, and the reference for the stencil.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> jt.FullVolume(grid).grid.solid_count
        64
    """

    grid: VoxelGrid = eqx.field(static=True)
    stencil: bool = eqx.field(static=True, default=True)
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )

    @property
    def runs_as_stencil(self) -> bool:
        """True if a state is the lattice: no request for links, and no weights."""
        return self.stencil and self.weights.are_one

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return (self.grid,)

    @override
    def for_solves(self) -> "FullVolume":
        # A solve stores half a dozen arrays, as long as the box for a stencil.
        full = self.grid.solid_count > _DENSE * self.grid.solid.size
        return self if full else replace(self, stencil=False)

    @property
    @override
    def node_count(self) -> int:
        return self.grid.solid_count

    @property
    @override
    def link_count(self) -> int:
        return self.found("link_count", self._link_count)

    def _link_count(self) -> int:
        bodies = (np.moveaxis(self.grid.solid, axis, 0) for axis in range(3))
        shared = sum(int(np.count_nonzero(body[:-1] & body[1:])) for body in bodies)
        cut = self.grid.cut
        return shared + (0 if cut is None else int(cut.links.over_edge.sum()))

    def _numbers(self) -> Int[np.ndarray, "x y z"]:
        """Node number of each solid voxel, in C order; -1 elsewhere."""
        solid = self.grid.solid
        number = np.cumsum(solid.reshape(-1), dtype=np.int32).reshape(solid.shape) - 1
        return np.where(solid, number, -1)

    @override
    def nodes(self) -> Nodes:
        return self.found("nodes", self._nodes)

    def _nodes(self) -> Nodes:
        cells = np.argwhere(self.grid.solid)
        centre = self.grid.lattice.centres(cells)
        return Nodes(
            centre=centre,
            volume=self.grid.volume_of(np.arange(len(cells)), len(cells)),
            level=np.zeros(len(cells), np.int32),
            location=centre,
        )

    @override
    def links(self) -> Links:
        number = self._numbers
        cut = self.grid.cut
        return self.found("links", lambda: voxel_links(number(), self.grid.pitch, cut))

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        voxel, number = tuple(self.grid.fragment_voxel.T), self._numbers
        return self.found("fragment_node", lambda: number()[voxel])

    @override
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        return np.arange(self.node_count, dtype=np.int32)

    @override
    def _fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        # Exactly zero, since a fragment's voxel is its node: no gradient is needed.
        return np.zeros(self.grid.fragment_position.shape)

    @property
    @override
    def capacity_ratio(self) -> float:
        return 1.0

    @property
    @override
    def state_shape(self) -> tuple[int, ...]:
        if not self.runs_as_stencil:
            return (self.node_count,)
        # A rim of one cell, so that the stencil needs no special case at the ends.
        x, y, z = self.grid.solid.shape
        return (x + 2, y + 2, z + 2)

    @override
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        return self.found(("node_address", self.runs_as_stencil), self._node_address)

    def _node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        if not self.runs_as_stencil:
            return (np.arange(self.node_count, dtype=np.int32),)
        return tuple((i + 1).astype(np.int32) for i in np.nonzero(self.grid.solid))
