"""Interface of all structures: nodes, links, surface and weights of one body.

Everything downstream uses only this interface. The arrays are made once on the host, as
integers and geometry; conductances follow inside jit from these, the materials and the
weights.
"""

import abc
import dataclasses
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int, Shaped
from typing_extensions import override

from ..arrays import Numbers, is_traced
from ..errors import InputError, require
from ..findings import found
from ..module import Module
from ..voxels.grid import VoxelGrid


_T = TypeVar("_T")


class ConductionWeights(Module):
    """Factors of conductances and capacities [-]; all default to the two-point flux.

    A link's conductance is w k A / L with w the product of the weights of its classes:
    a link within a level, a link between two levels, and, in addition, a link that
    touches the surface (one of its nodes has surface fragments). A capacity factor per
    level shifts heat capacity between levels; the total stays the same.

    Where nodes do not fill the body, as in a shell, each node can also represent the
    volume nearest to it: with V its volume and S that of the voxels nearest to it,
    capacities are proportional to V^(1-x) S^x, x = `nearest_capacity`. So is their
    total: at x = 1 it is the body's, even where the nodes alone would hold less.

    `non_orthogonal` corrects the two-point flux where the line between two nodes is not
    normal to their face (see `build.links`).

    Raises:
        InputError: for values out of range or lists where one number is expected.
    """

    within: Numbers = 1.0
    """Factor of links within level l; one number, or [levels]."""
    between: Numbers = 1.0
    """Factor of links between level l and a deeper one; one number, or [levels - 1]."""
    surface: Numbers = 1.0
    """Additional factor of links that touch the surface."""
    capacity: Numbers = 1.0
    """Factor of capacities in level l, before the total is restored; one number, or
    [levels]."""
    surface_distance: Numbers = 1.0
    """Factor of the distance between a surface and its node, in the surface map."""
    nearest_capacity: Numbers = 0.0
    """Exponent of the nearest voxels' volume in the capacity; usually 0 to 1."""
    non_orthogonal: Numbers = 0.0
    """Fraction of the non-orthogonal correction, 1 for all; explicit solvers only."""
    links: Numbers = 1.0
    """Additional factor of every link; one number, or [links]."""

    def __check_init__(self):
        for name, value in self.__dict__.items():
            if is_traced(value):
                continue
            try:
                numbers = np.asarray(value, float)
            except (TypeError, ValueError):
                numbers = np.full((), np.nan)
            words, low, high = _RANGES.get(name, ("of at least 0", 0.0, np.inf))
            if not (np.isfinite(numbers) & (numbers >= low) & (numbers <= high)).all():
                raise InputError(
                    f"ConductionWeights({name}={_shown(value)}): give finite numbers "
                    + words
                )
            if numbers.ndim > (1 if name in _LISTS else 0):
                raise InputError(
                    f"ConductionWeights({name}=): give one number"
                    + (f" or a list, one a {_LISTS[name]}" if name in _LISTS else "")
                )

    @property
    def are_one(self) -> bool:
        """True if links and capacities are known to have no factors."""
        values = (self.within, self.between, self.surface, self.capacity, self.links)
        known = not any(is_traced(value) for value in values)
        plain = known and all(np.all(np.asarray(value) == 1) for value in values)
        return plain and not self.uses_nearest_capacity

    @property
    def uses_nearest_capacity(self) -> bool:
        """True if `nearest_capacity` is traced or not zero."""
        return _may_act(self.nearest_capacity)

    @property
    def corrects_non_orthogonality(self) -> bool:
        """True if `non_orthogonal` is traced or not zero."""
        return _may_act(self.non_orthogonal)


def _may_act(value: Any) -> bool:
    # A traced value may be anything, so the program must include its term.
    return is_traced(value) or bool(np.asarray(value) != 0)


# Weights that may be a list, and what each entry belongs to.
_LISTS = {"within": "level", "between": "level", "capacity": "level", "links": "link"}

_RANGES = {
    "capacity": ("above 0", np.nextafter(0.0, 1.0), np.inf),
    "nearest_capacity": ("from -10 to 10", -10.0, 10.0),
    "non_orthogonal": ("from -1 to 2", -1.0, 2.0),
}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:56]}..."


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

    def lengthened(self, ratio: Float[np.ndarray, " e"] | float) -> "Links":
        """The same links with both distances multiplied by a ratio."""
        to_src, to_dst = self.distance_src * ratio, self.distance_dst * ratio
        return self._replace(distance_src=to_src, distance_dst=to_dst)


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
    require(grid, VoxelGrid, f"{structure}(grid=)", give)


class AbstractStructure(Module):
    """Nodes, links and surface of one body."""

    grid: eqx.AbstractVar[VoxelGrid]
    """Voxels of the body."""
    weights: eqx.AbstractVar[ConductionWeights]
    """Factors of conductances and capacities; the default is the two-point flux."""

    def __check_init__(self):
        check_grid(self.grid, type(self).__name__)

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

    def address_of(self, nodes: Int[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
        """Indices of some nodes in the state."""
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
    def identity(self) -> tuple[object, ...]:
        """Objects that its arrays follow from, beside its options; none if unknown.

        A structure without them finds its arrays again for every run.
        """
        return ()

    @property
    def options(self) -> Hashable:
        """Its class and options, on which its arrays depend, without weights."""
        kept = ("grid", "built")
        return type(self), *(
            getattr(self, each.name)
            for each in dataclasses.fields(self)
            if each.metadata.get("static") and each.name not in kept
        )

    def found(self, by: Hashable, find: Callable[[], _T], search: str = "") -> _T:
        """Return a finding that belongs to this geometry, see `findings.found`."""
        of = self.identity
        known = (by, self.options) if of and by is not None else None
        return found(of, known, find, search)

    def for_solves(self) -> "AbstractStructure":
        """Same nodes and links in the form that is fastest in implicit solves."""
        return self

    def fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        """Vector from the node of each fragment to the fragment's voxel [m]."""
        return self.found("fragment_offset", self._fragment_offset)

    def _fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        grid, location = self.grid, self.nodes().location
        voxel = grid.lattice.centres(grid.fragment_voxel)
        return voxel - location[self.fragment_node()]

    def fragment_distance(self) -> Float[np.ndarray, " s"]:
        """Distance along the normal from each fragment down to its node [m]."""
        return self.found("fragment_distance", self._fragment_distance)

    def _fragment_distance(self) -> Float[np.ndarray, " s"]:
        # Half a voxel to the fragment's voxel, or to where the surface is, and on from
        # there where the node is deeper; one above the voxel does not shorten the path.
        along = np.einsum("si,si->s", self.fragment_offset(), self.grid.fragment_normal)
        depth = self.grid.fragment_depth
        return (self.grid.pitch / 2 if depth is None else depth) + np.maximum(along, 0)


class AbstractBuiltStructure(AbstractStructure):
    """Structure whose arrays are all computed at construction."""

    built: eqx.AbstractVar[Built]

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

    @property
    @override
    def state_shape(self) -> tuple[int, ...]:
        return (self.node_count,)

    @override
    def node_address(self) -> tuple[Int[np.ndarray, " n"], ...]:
        count = self.node_count
        return self.found("node_address", lambda: (np.arange(count, dtype=np.int32),))


@dataclass(frozen=True, eq=False)
class FitCard:
    """Weights of one kind of structure, with the data of their fit."""

    name: str
    structure: Mapping[str, Any]
    """Kind and options of the structure, as in a config."""
    weights: ConductionWeights
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Other fitted values of the scene, by name."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each number of `scene_numbers` over all fitted cases."""
    tolerance: float = 1.2
    """Factor by which a number may lie beyond its range, or beyond the one value of a
    range without width, before `extrapolations` lists it."""
    mechanisms: tuple[str, ...] = ()
    """Mechanisms of heat transfer in these cases."""
    geometry: Mapping[str, str] = field(default_factory=dict)
    """Hash of each fitted body's geometry, by the name of its file or shape."""
    error_percent: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors of "train" and "held_out", each "default" and "fitted" [%]."""
    error_kelvin: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """The same against finer voxels, with the "reference"'s own error [K]; empty if
    the fit was compared with none."""
    surface_cells: str = ""
    """Surface cells of the voxels that were fitted; empty if they are not known."""
    origin: Mapping[str, str] = field(default_factory=dict)
    """Cases and settings of the fit, hashes and versions."""


def as_weights(given: ConductionWeights | FitCard) -> ConductionWeights:
    """Weights as given, or those of a card."""
    return given.weights if isinstance(given, FitCard) else given
