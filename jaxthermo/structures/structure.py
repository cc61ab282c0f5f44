"""Interface of all structures: nodes, links and the surface of one body.

Everything downstream uses only this interface. The arrays are made once on the host, as
integers and geometry; conductances follow inside jit from these, the materials and the
weights.
"""

import abc
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ..voxels.grid import VoxelGrid
from .weights import ConductionWeights


class Nodes(NamedTuple):
    """Control volumes; positions in the body's frame."""

    centre: Float[np.ndarray, "n 3"]
    """Centre of the volume [m]."""
    volume: Float[np.ndarray, " n"]
    """Volume for the heat capacity [m^3], including the grid's `volume_ratio`."""
    level: Int[np.ndarray, " n"]
    """0 at the surface, rising inwards or with the size, depending on the kind."""
    location: Float[np.ndarray, "n 3"]
    """Point that has the node's temperature [m]; often the centre."""


class Links(NamedTuple):
    """Pairs of nodes that exchange heat, one entry per pair."""

    src: Int[np.ndarray, " e"]
    """First node, int32, sorted."""
    dst: Int[np.ndarray, " e"]
    area: Float[np.ndarray, " e"]
    """Shared face [m^2]."""
    distance_src: Float[np.ndarray, " e"]
    """Distance from `src` to the shared face [m]."""
    distance_dst: Float[np.ndarray, " e"]
    """Distance from the shared face to `dst` [m]."""


@dataclass(frozen=True, eq=False)
class Built:
    """Arrays of a structure, computed once and cached on disk."""

    nodes: Nodes
    links: Links
    fragment_node: Int[np.ndarray, " s"]
    """Node under each surface fragment of the grid, int32."""
    voxel_node: Int[np.ndarray, " v"]
    """Node of each solid voxel in lattice order, int32; -1 for none."""


class AbstractStructure(eqx.Module):
    """Nodes, links and surface of one body."""

    grid: eqx.AbstractVar[VoxelGrid]
    """Voxels of the body."""
    weights: eqx.AbstractVar[ConductionWeights]
    """Factors of conductances and capacities; the default is the two-point flux."""

    @property
    @abc.abstractmethod
    def node_count(self) -> int:
        """Number of nodes."""

    @property
    @abc.abstractmethod
    def link_count(self) -> int:
        """Number of links."""

    @abc.abstractmethod
    def nodes(self) -> Nodes:
        """Control volumes, in node order."""

    @abc.abstractmethod
    def links(self) -> Links:
        """Links, sorted by their first node."""

    @abc.abstractmethod
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        """Node of each surface fragment of the grid."""

    @abc.abstractmethod
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        """Node of each solid voxel in lattice order; -1 for none."""

    @property
    @abc.abstractmethod
    def capacity_ratio(self) -> float:
        """Total volume of the nodes over that of the body [-]."""

    @property
    @abc.abstractmethod
    def state_shape(self) -> tuple[int, ...]:
        """Shape of the solver's state: the nodes, or the lattice with a rim."""

    @abc.abstractmethod
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Indices of every node in the state."""

    def for_solves(self) -> "AbstractStructure":
        """Same nodes and links in the form that is fastest in implicit solves."""
        return self

    def fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        """Vector from the node of each fragment to the fragment's voxel [m]."""
        grid, location = self.grid, self.nodes().location
        voxel = grid.lattice.centres(grid.fragment_voxel)
        return voxel - location[self.fragment_node()]

    def fragment_distance(self) -> Float[np.ndarray, " s"]:
        """Distance along the normal from each fragment down to its node [m]."""
        # Half a voxel to the fragment's voxel, and on from there where the node is
        # deeper; a node above that voxel does not shorten the path.
        along = np.einsum("si,si->s", self.fragment_offset(), self.grid.fragment_normal)
        return self.grid.pitch / 2 + np.maximum(along, 0)


class AbstractBuiltStructure(AbstractStructure):
    """Structure whose arrays are all computed at construction."""

    built: eqx.AbstractVar[Built]

    @property
    @override
    def node_count(self) -> int:
        return len(self.built.nodes.volume)

    @property
    @override
    def link_count(self) -> int:
        return len(self.built.links.src)

    @override
    def nodes(self) -> Nodes:
        return self.built.nodes

    @override
    def links(self) -> Links:
        return self.built.links

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        return self.built.fragment_node

    @override
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        return self.built.voxel_node

    @property
    @override
    def capacity_ratio(self) -> float:
        body = self.grid.solid_count * self.grid.voxel_volume
        return float(self.built.nodes.volume.sum() / body)

    @property
    @override
    def state_shape(self) -> tuple[int, ...]:
        return (self.node_count,)

    @override
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        return (np.arange(self.node_count, dtype=np.int32),)
