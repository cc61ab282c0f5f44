"""What the heat equation is solved on: nodes, links and the surface map.

Every kind of structure gives the same three things, so everything downstream knows only
this interface. They are made on the host, once, as integers and geometry; conductances
come later, inside jit, from these and the materials.
"""

import abc
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..voxels.grid import VoxelGrid


class Nodes(NamedTuple):
    """The control volumes."""

    centre: Float[np.ndarray, "n 3"]
    """[m]"""
    volume: Float[np.ndarray, " n"]
    """True volume [m^3], after scaling by the grid's volume ratio."""
    level: Int[np.ndarray, " n"]
    """0 at the finest size, one more for each doubling."""


class Links(NamedTuple):
    """Pairs of nodes that exchange heat, one entry a pair."""

    src: Int[np.ndarray, " e"]
    dst: Int[np.ndarray, " e"]
    area: Float[np.ndarray, " e"]
    """Shared face [m^2]."""
    distance: Float[np.ndarray, " e"]
    """Between the centres [m]."""


class AbstractStructure(abc.ABC):
    """Nodes, links and surface map of one body."""

    grid: VoxelGrid
    """The voxels this structure was made from."""

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

    @property
    @abc.abstractmethod
    def dense(self) -> Bool[np.ndarray, "x y z"] | None:
        """Cells that are nodes (in C order) if a stencil can run this; else None."""

    @property
    def state_shape(self) -> tuple[int, ...]:
        """Shape of the solver's state: the nodes, or the lattice and one cell round."""
        if self.dense is None:
            return (self.node_count,)
        x, y, z = self.dense.shape
        return (x + 2, y + 2, z + 2)

    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Where every node lies in the state."""
        if self.dense is None:
            return (np.arange(self.node_count, dtype=np.int32),)
        return tuple((index + 1).astype(np.int32) for index in np.nonzero(self.dense))

    def fragment_address(self) -> tuple[Int[np.ndarray, " s"], ...]:
        """Where the node of every surface fragment lies in the state, in its order.

        The solver's scatters and its stable step count on that order.
        """
        if self.dense is None:
            return (self.fragment_node().astype(np.int32),)
        return tuple((self.grid.fragment_voxel.T + 1).astype(np.int32))
