"""Interface of all structures: nodes, links, surface and weights of one body.

Everything downstream uses only this interface. The arrays are made once on the host, as
integers and geometry; conductances follow inside jit from these, the materials and the
weights.
"""

import abc
import dataclasses
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Float, Int, Shaped
from typing_extensions import override

from ..errors import InputError, require
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.grid import VoxelGrid
from .weights import ConductionWeights, as_weights


_T = TypeVar("_T")


class Nodes(NamedTuple):
    """Control volumes; positions in the body's frame."""

    centre: Float[np.ndarray, "n 3"]
    """Centre of the volume [m]."""
    volume: Float[Any, " n"]
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

    @property
    def length(self) -> Float[np.ndarray, " e"]:
        """Distance between the nodes, through the shared face [m]."""
        return self.distance_src + self.distance_dst

    def lengthened(self, ratio: Float[np.ndarray, " e"] | float) -> "Links":
        """Links with both distances multiplied by a ratio."""
        return self._replace(
            distance_src=self.distance_src * ratio,
            distance_dst=self.distance_dst * ratio,
        )

    def selected(self, which: np.ndarray) -> "Links":
        """Select links by mask or index."""
        return Links(*(column[which] for column in self))


class ColumnLayout(NamedTuple):
    """Columns of a structure, whose cells are its first nodes, the outermost first."""

    link: Int[np.ndarray, "m c"]
    """Link from each cell to the next one inwards, and from the last to the hub."""
    hub: Int[np.ndarray, " c"]
    """Node behind all cells that each column ends at, sorted."""
    are_linked: bool
    """True if cells have links outside their columns."""


@dataclass(frozen=True, eq=False)
class Built:
    """Arrays of a structure, computed once and cached on disk."""

    nodes: Nodes
    links: Links
    fragment_node: Int[np.ndarray, " s"]
    """Node under each surface fragment of the grid, int32."""
    voxel_node: Int[np.ndarray, " v"]
    """Node of each solid voxel in lattice order, int32; -1 for none."""


def check_grid(grid: Any, structure: str) -> None:
    """Refuse anything but a voxel grid, as the argument of a structure.

    Raises:
        InputError: with what to give instead.
    """
    give = "a voxel grid: voxelize(mesh, pitch)"
    require(grid, classes=VoxelGrid, argument=f"{structure}(grid=)", give=give)


class AbstractStructure(Module):
    """Nodes, links and surface of one body."""

    grid: eqx.AbstractVar[AbstractGrid]
    """Surface of the body."""
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

    @property
    @abc.abstractmethod
    def volume(self) -> float:
        """Volume of the body [m^3]."""

    @property
    def voxels(self) -> VoxelGrid:
        """Voxels of a solid body.

        Raises:
            InputError: for a sheet, which has none.
        """
        raise InputError(
            f"a {type(self).__name__} has no voxels: this needs a solid body, such as "
            "FullVolume(grid)"
        )

    @property
    @abc.abstractmethod
    def capacity_ratio(self) -> float:
        """Total volume of the nodes over that of the body [-]."""

    @property
    def state_shape(self) -> tuple[int, ...]:
        """Shape of the solver's state: the nodes, or the lattice with a rim."""
        return (self.node_count,)

    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Indices of every node in the state."""
        count = self.node_count
        return self.found("node_address", lambda: (np.arange(count, dtype=np.int32),))

    def address_of(self, nodes: Int[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
        """Indices of nodes in the state."""
        return tuple(index[nodes] for index in self.node_address())

    def node_values(
        self, state: Shaped[np.ndarray, "..."], sections: range | None = None
    ) -> Shaped[np.ndarray, " n"]:
        """Values of the nodes in a state on the host, in an order of all layouts.

        The layout of a state depends on the devices of a run, this order does not. With
        `sections` the state holds these sections of a sharded lattice, one after the
        other, and the nodes are those in them.
        """
        return state

    def state_of(self, values: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, "..."]:
        """State with the values of all nodes, in the order of `node_values`."""
        return values

    @property
    def device_count(self) -> int:
        """Number of devices that its state is spread over."""
        return 1

    @property
    def identity(self) -> tuple[object, ...]:
        """Objects that determine its arrays, apart from its options; none if unknown.

        Without them the arrays are computed again for every run.
        """
        return ()

    @cached_property
    def options(self) -> Hashable:
        """Its class and options, on which its arrays depend, without weights."""
        excluded = ("grid", "built")
        values = [
            getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.metadata.get("static") and field.name not in excluded
        ]
        return type(self), *values

    def found(self, by: Hashable, find: Callable[[], _T], search: str = "") -> _T:
        """Return a finding that belongs to this geometry, see `memo.found`."""
        identity = self.identity
        key = (by, self.options) if identity and by is not None else None
        return found(identity, by=key, find=find, search=search)

    @property
    def columns(self) -> ColumnLayout | None:
        """Chains of nodes through a depth that explicit steps eliminate; None for none.

        Its structure has no weights.
        """
        return None

    def for_solves(self) -> "AbstractStructure":
        """Same nodes and links in the form that is fastest in implicit solves."""
        return self

    def cell_position(self) -> Float[np.ndarray, "n 3"]:
        """Centre of each node on the lattice of its body [cells]."""
        lattice = self.grid.lattice
        return (self.nodes().centre - lattice.origin) / lattice.pitch

    def fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        """Vector from the node of each fragment to the fragment's voxel [m]."""
        return self.found("fragment_offset", self._fragment_offset)

    def _fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        grid = self.grid
        location = self.nodes().location
        voxel = grid.fragment_centre
        return voxel - location[self.fragment_node()]

    def cell_centre(self) -> Float[np.ndarray, "s 3"]:
        """Centre of the voxel under each fragment [m], or of what divides it."""
        return self.grid.fragment_centre

    def cell_depth(self) -> Float[np.ndarray, "*#s"]:
        """Depth of that centre below each fragment [m]; one number if all are equal."""
        depth = self.grid.fragment_depth
        return np.asarray(self.grid.pitch / 2) if depth is None else depth

    def node_at_depth(
        self,
        node: Int[np.ndarray, " q"],
        fragment: Int[np.ndarray, " q"],
        depth: Float[np.ndarray, " q"],
    ) -> Int[np.ndarray, " q"]:
        """Node of points in the voxels of a node, at depths below fragments [m]."""
        del fragment, depth
        return node

    @property
    def fragment_distance(self) -> Float[np.ndarray, " s"]:
        """Distance along the normal from each fragment down to its node [m]."""
        # Called on the class: a method of a module takes a pass over its leaves.
        return AbstractStructure.found(
            self, "fragment_distance", lambda: self._fragment_distance()
        )

    def _fragment_distance(self) -> Float[np.ndarray, " s"]:
        # Half a voxel to the fragment's voxel, or to where the surface is, and on from
        # there where the node is deeper; one above the voxel does not shorten the path.
        along = np.einsum("si,si->s", self.fragment_offset(), self.grid.fragment_normal)
        return self.cell_depth() + np.maximum(along, 0)


class AbstractVoxelStructure(AbstractStructure):
    """Structure of the voxels of a solid body."""

    grid: eqx.AbstractVar[VoxelGrid]
    """Voxels of the body."""

    def __check_init__(self):
        check_grid(self.grid, type(self).__name__)

    @abc.abstractmethod
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        """Node of each solid voxel in lattice order; -1 for none."""

    def sharing_node(self) -> Int[np.ndarray, " n"] | None:
        """Node of `voxel_node` whose voxels each node shares; None if each has its own.

        Voxels then count for that node, and `shared_fraction` of them for each.
        """
        return None

    def shared_fraction(self) -> Float[np.ndarray, " n"]:
        """Fraction of the volume of its voxels that each node has [-]."""
        return np.ones(self.node_count)

    @property
    @override
    def volume(self) -> float:
        return self.grid.body_volume

    @property
    @override
    def voxels(self) -> VoxelGrid:
        return self.grid


class AbstractBuiltStructure(AbstractVoxelStructure):
    """Structure whose arrays are all computed at construction."""

    grid: VoxelGrid = eqx.field(static=True)
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return self.built, self.grid

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
        return float(self.built.nodes.volume.sum() / self.grid.body_volume)
