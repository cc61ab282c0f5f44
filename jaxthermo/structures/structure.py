"""What the heat equation is solved on: nodes, links and where the surface lies.

Every kind of structure gives the same things, so everything downstream knows only this
interface. They are made on the host, once, as integers and geometry; conductances come
later, inside jit, from these, the materials and the weights.
"""

import abc
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..voxels.grid import VoxelGrid
from .weights import ConductionWeights


class Nodes(NamedTuple):
    """The control volumes."""

    centre: Float[np.ndarray, "n 3"]
    """Of the volume, own frame [m]."""
    volume: Float[np.ndarray, " n"]
    """That the node's capacity is taken of [m^3], scaled by the grid's ratio."""
    level: Int[np.ndarray, " n"]
    """0 at the surface, counted inwards or upwards in size as the kind says."""
    place: Float[np.ndarray, "n 3"]
    """Where the node's temperature is that of the body, own frame [m]: the centre,
    unless the structure says better."""


class Links(NamedTuple):
    """Pairs of nodes that exchange heat, one entry a pair."""

    src: Int[np.ndarray, " e"]
    """Sorted, int32."""
    dst: Int[np.ndarray, " e"]
    area: Float[np.ndarray, " e"]
    """Shared face [m^2]."""
    distance_src: Float[np.ndarray, " e"]
    """From the centre of `src` to the shared face [m]."""
    distance_dst: Float[np.ndarray, " e"]
    """From the shared face to the centre of `dst` [m]."""


@dataclass(frozen=True, eq=False)
class Built:
    """A structure's arrays, as they are made once and kept on disk."""

    nodes: Nodes
    links: Links
    fragment_node: Int[np.ndarray, " s"]
    """The node under each surface fragment of the grid, int32."""
    voxel_node: Int[np.ndarray, " v"]
    """The node of each solid voxel in lattice order, int32; -1 for one in no node."""


class AbstractStructure(eqx.Module):
    """Nodes, links and surface of one body."""

    grid: eqx.AbstractVar[VoxelGrid]
    """The voxels this structure was made from."""
    weights: eqx.AbstractVar[ConductionWeights]
    """All 1: the plain two-point flux."""

    @property
    @abc.abstractmethod
    def node_count(self) -> int:
        """How many nodes there are."""

    @property
    @abc.abstractmethod
    def link_count(self) -> int:
        """How many pairs of nodes are linked."""

    @abc.abstractmethod
    def nodes(self) -> Nodes:
        """The control volumes, in node order."""

    @abc.abstractmethod
    def links(self) -> Links:
        """The links, sorted by their first node."""

    @abc.abstractmethod
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        """The node of each surface fragment of the grid."""

    @abc.abstractmethod
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        """The node of each solid voxel in lattice order; -1 for one in no node."""

    @property
    @abc.abstractmethod
    def capacity_ratio(self) -> float:
        """Volume of all nodes over the volume of the body: 1 if no capacity is lost."""

    @property
    @abc.abstractmethod
    def state_shape(self) -> tuple[int, ...]:
        """Shape of the solver's state: the nodes, or the lattice and one cell round."""

    @abc.abstractmethod
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Where every node lies in the state."""

    def for_solves(self) -> "AbstractStructure":
        """The same nodes and links, as implicit steps and steady states run fast."""
        return self

    def fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        """From the node under each fragment to the fragment's own voxel [m]."""
        grid, place = self.grid, self.nodes().place
        voxel = grid.lattice.centres(grid.fragment_voxel)
        return voxel - place[self.fragment_node()]

    def fragment_distance(self) -> Float[np.ndarray, " s"]:
        """From each fragment straight down to the level of its node [m].

        Half a voxel to the centre of the fragment's own voxel, and from there along
        the normal to the node where that is deeper.
        """
        along = np.einsum("si,si->s", self.fragment_offset(), self.grid.fragment_normal)
        return self.grid.pitch / 2 + np.maximum(along, 0)


class AbstractBuiltStructure(AbstractStructure):
    """A structure whose arrays are all made beforehand."""

    built: eqx.AbstractVar[Built]

    @property
    def node_count(self) -> int:
        """How many nodes there are."""
        return len(self.built.nodes.volume)

    @property
    def link_count(self) -> int:
        """How many pairs of nodes are linked."""
        return len(self.built.links.src)

    def nodes(self) -> Nodes:
        """The control volumes, in node order."""
        return self.built.nodes

    def links(self) -> Links:
        """The links, sorted by their first node."""
        return self.built.links

    def fragment_node(self) -> Int[np.ndarray, " s"]:
        """The node of each surface fragment of the grid."""
        return self.built.fragment_node

    def voxel_node(self) -> Int[np.ndarray, " v"]:
        """The node of each solid voxel in lattice order; -1 for one in no node."""
        return self.built.voxel_node

    @property
    def capacity_ratio(self) -> float:
        """Volume of all nodes over the volume of the body: 1 if no capacity is lost."""
        body = self.grid.solid_count * self.grid.voxel_volume
        return float(self.built.nodes.volume.sum() / body)

    @property
    def state_shape(self) -> tuple[int, ...]:
        """One value a node."""
        return (self.node_count,)

    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Where every node lies in the state."""
        return (np.arange(self.node_count, dtype=np.int32),)
