"""Full volume: every solid voxel is a node, linked over its faces."""

from collections.abc import Hashable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int, Shaped
from typing_extensions import override

from ...choices import Kernels
from ...native.call import check_kernels
from ...voxels.grid import VoxelGrid
from ...voxels.sharded_lattice import ShardedLattice, cut_axes, sharded_lattice
from ..partition.links import voxel_links
from ..structure import AbstractVoxelStructure, Links, Nodes
from ..weights import ConductionWeights, as_weights


# Fraction of solid voxels in the box from which a stencil solves as fast as links.
_DENSE = 0.5


class FullVolume(AbstractVoxelStructure):
    """Every solid voxel, linked to its six neighbours; the reference for all others.

    It runs as a masked stencil over the bounding box or, with `stencil=False`, as
    sorted links: slower, but equal to rounding, they are the reference. A run on
    several devices has a section on each (`ShardedLattice`).

    With `kernels="numba"` explicit steps of one material on a CPU are loops over the
    solid voxels alone, which numba compiles (extra `native`): equal to rounding.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> jt.FullVolume(grid).grid.solid_count
        64
    """

    grid: VoxelGrid = eqx.field(static=True)
    stencil: bool = eqx.field(static=True, default=True)
    kernels: Kernels = eqx.field(static=True, default=None)
    """"numba" for explicit steps in loops that it compiles; None for those of XLA."""
    devices: int = eqx.field(static=True, default=1)
    """Number of devices over which the lattice is sharded; set by a run."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )

    def __check_init__(self):
        check_kernels(self.kernels, "FullVolume")

    @cached_property
    def runs_as_stencil(self) -> bool:
        """True if a state is a lattice: no request for links, and no weights."""
        return self.stencil and self.kernels is None and self.weights.are_one

    @cached_property
    def as_links(self) -> "FullVolume":
        """The same nodes and links without a lattice."""
        return replace(self, stencil=False) if self.stencil else self

    @property
    def sharded(self) -> ShardedLattice | None:
        """Sections of the body on several devices, where it is on more than one."""
        if self.devices == 1:
            return None
        return self.found(
            "sharded_lattice",
            find=lambda: sharded_lattice(self.grid.solid, self.devices),
        )

    @property
    @override
    def device_count(self) -> int:
        return self.devices

    @cached_property
    @override
    def options(self) -> Hashable:
        # Weights run as links: their findings have positions of nodes, not of cells.
        return super().options, self.runs_as_stencil, self.devices

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return (self.grid,)

    @override
    def for_solves(self) -> "FullVolume":
        # A solve stores half a dozen arrays, as long as the box for a stencil.
        # Only lattices are sharded.
        sparse = self.grid.solid_count <= _DENSE * self.grid.solid.size
        structure = self if self.kernels is None else replace(self, kernels=None)
        if sparse and self.devices == 1:
            return replace(structure, stencil=False)
        return structure

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
        return self.found("fragment_node", self._fragment_node)

    def _fragment_node(self) -> Int[np.ndarray, " s"]:
        solid = self.grid.solid
        voxel = self.grid.fragment_voxel
        number = np.zeros(len(voxel), np.int32)
        for x, first, in_plane in self._by_plane(voxel[:, 0]):
            # Counted plane by plane: numbers of all voxels need four times as much
            # memory as the solid.
            count = np.cumsum(solid[x], dtype=np.int32).reshape(solid[x].shape)
            number[in_plane] = first + count[tuple(voxel[in_plane, 1:].T)] - 1
        return number

    def _by_plane(self, x: Int[np.ndarray, " m"]) -> Iterator[tuple[int, int, Any]]:
        """Planes with voxels: x, the first node, and the indices of these voxels."""
        first = self._first_nodes()
        order = np.argsort(x, kind="stable")
        ends = np.searchsorted(x[order], np.arange(len(first)))
        for plane in np.flatnonzero(np.diff(ends)):
            in_plane = order[ends[plane] : ends[plane + 1]]
            yield int(plane), int(first[plane]), in_plane

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
        layout = self.sharded
        x, y, z = self.grid.solid.shape if layout is None else layout.shape
        return (x + 2, y + 2, z + 2)

    @override
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        return self.found("node_address", self._node_address)

    def _node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        return self.address_of(np.arange(self.node_count, dtype=np.int32))

    @override
    def address_of(self, nodes: Int[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
        if not self.runs_as_stencil:
            return (nodes.astype(np.int32),)
        plane = np.searchsorted(self._first_nodes(), nodes, side="right") - 1
        address = tuple(np.zeros(len(nodes), np.int32) for _ in range(3))
        for x, first, in_plane in self._by_plane(plane.astype(np.int32)):
            within = np.flatnonzero(self.grid.solid[x])[nodes[in_plane] - first]
            y, z = np.divmod(within, self.grid.solid.shape[2])
            indices = self.address_of_voxels(
                np.stack([np.full_like(y, x), y, z], axis=1)
            )
            for index, at in zip(address, indices, strict=True):
                index[in_plane] = at
        return address

    def address_of_voxels(
        self, voxel: Int[np.ndarray, "m 3"]
    ) -> tuple[Int[np.ndarray, " m"], ...]:
        """Indices of solid voxels in the state of a stencil."""
        layout = self.sharded
        cells = voxel if layout is None else layout.cells(voxel)
        # The rim of one cell.
        return tuple(np.asarray(index + 1, np.int32) for index in cells.T)

    @override
    def node_values(
        self, state: Shaped[np.ndarray, "..."], sections: range | None = None
    ) -> Shaped[np.ndarray, " n"]:
        if not self.runs_as_stencil:
            return state
        planes = [state[address] for address in self._planes(sections)]
        return np.concatenate([np.zeros(0, state.dtype), *planes])

    @override
    def state_of(self, values: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, "..."]:
        if not self.runs_as_stencil:
            return values
        state = np.zeros(self.state_shape, values.dtype)
        first = 0
        for address in self._planes():
            last = first + len(address[0])
            state[address] = values[first:last]
            first = last
        return state

    def _planes(
        self, sections: range | None = None
    ) -> Iterator[tuple[np.ndarray, ...]]:
        """Addresses in a state of the nodes of each plane across the longest axis.

        If `sections` is not None, the state has only these sections.
        """
        # Addresses of all nodes at once would need three times the memory of the state.
        solid = self.grid.solid
        sharded = self.sharded
        first_plane = 0
        axes = cut_axes(solid.shape)
        planes = range(solid.shape[axes[0]])
        if sections is not None and sharded is not None:
            planes = planes[
                sections.start * sharded.thickness : sections.stop * sharded.thickness
            ]
            first_plane = sections.start * (sharded.thickness + 2)
        for plane in planes:
            cells = np.nonzero(solid.transpose(axes)[plane])
            voxel = np.empty((len(cells[0]), 3), np.int32)
            for axis, index in zip(axes, (plane, *cells), strict=True):
                voxel[:, axis] = index
            x, y, z = self.address_of_voxels(voxel)
            yield x - first_plane, y, z

    def _first_nodes(self) -> Int[np.ndarray, " p"]:
        """Number of the first node of each plane across x; last, of all nodes."""

        def find() -> Int[np.ndarray, " p"]:
            count = np.count_nonzero(self.grid.solid, axis=(1, 2))
            return np.append(0, np.cumsum(count))

        return self.found("first_nodes", find)
