"""Skin: the nodes at the surface of a structure divided by depth, in columns."""

import math
from collections.abc import Hashable
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ...errors import InputError, require, whole_number
from ...memo.found import digest
from ...voxels.grid import VoxelGrid
from ...voxels.selection import AbstractSelection
from ..structure import AbstractVoxelStructure, ColumnLayout, Links, Nodes
from ..weights import ConductionWeights, as_weights


_RATIO = 1.5
"""Thickness of a cell over that of the next one towards the surface.

Of 1.2 to 2 it has the smallest error with 6 cells after times at which heat has gone
1/40 to 1/2 of a voxel deep.
"""

_MAX_CELLS = 32
"""The outermost of more cells would be a millionth of the innermost one."""

_MIN_LENGTH = 0.25
"""Smallest fraction of the distance from a node to a face that a skin leaves: that of
half a voxel below one fragment is 1/2."""

_PER_PENETRATION = 1 / 6
"""Largest thickness of the outermost cell over the depth sqrt(alpha t) of heat: a half
space that is heated by radiation or a flux is then within 2 % of its rise."""


class Skin(AbstractVoxelStructure):
    """A structure whose nodes at the surface are divided by depth below each fragment.

    A node at the surface gives up to half of its volume V to columns of cells, one
    below each of its fragments of area A that `on` selects, down to the depth

        D = min(L, V / (2 sum A)),

    L the distance to the node. Cells become thinner towards the surface by a constant
    ratio. The node keeps the volume left and moves to its centre, so that its links
    become shorter on the inner side; their sum from the surface to the next node stays
    the same. A voxel with one fragment is divided to half of its depth; at an edge, to
    a quarter below each of two fragments. `on` leaves out what is insulated, so that
    nothing is divided in vain. Cells conduct
    by depth alone: along the surface the node conducts for all of them, since heat that
    has gone less than a voxel deep has gone less than a voxel sideways.

    Explicit steps eliminate the columns, which spread the loads on their thin cells:
    steps follow from the volume left to the nodes, and from how deep heat goes in one.

    Raises:
        InputError: for a structure with weights or a skin, or a number of cells that is
            not 1 to 32.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> jt.Skin(jt.FullVolume(grid), cells=6).node_count
        640
    """

    grid: VoxelGrid = eqx.field(static=True, init=False)
    structure: AbstractVoxelStructure
    """Structure of the whole body."""
    cells: int = eqx.field(static=True, default=6)
    """Number of cells of each column."""
    on: AbstractSelection | None = None
    """Part of the surface; None for all of it. The number of the body is not used."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )

    def __post_init__(self):
        give = "a structure of voxels: FullVolume(grid)"
        require(
            self.structure,
            AbstractVoxelStructure,
            argument="Skin(structure=)",
            give=give,
        )
        if isinstance(self.structure, Skin):
            raise InputError("Skin(structure=): it has a skin already")
        for argument, weights in (
            ("structure", self.structure.weights),
            ("weights", self.weights),
        ):
            is_default = (
                weights.are_one
                and not weights.corrects_non_orthogonality
                and np.array_equal(weights.surface_distance, 1)
            )
            if not is_default:
                raise InputError(
                    f"Skin({argument}=): weights are fitted without a skin: leave out "
                    "one of the two"
                )
        self.grid = self.structure.grid
        self.cells = whole_number(self.cells, "Skin(cells=)")
        if self.cells > _MAX_CELLS:
            raise InputError(f"Skin(cells={self.cells}): give {_MAX_CELLS} or fewer")
        if not self.column_count:
            raise InputError(
                f"Skin(on={self.on!r}) selects no surface of its body: check its "
                "corners or its normal, which are in the body's own frame, in metres"
            )

    @staticmethod
    def cells_for(pitch: float, diffusivity: float, time: float) -> int:
        """Number of cells that resolves what has happened a time after a change.

        The outermost cell of a voxel is a sixth as thick as the depth sqrt(alpha t)
        that heat has gone, at most.

        Args:
            pitch: edge of a voxel [m].
            diffusivity: alpha = k / (rho c_p) of the material [m^2/s].
            time: shortest time after a change of the loads that matters [s].

        Raises:
            InputError: unless all are positive, or if it takes more than 32 cells.

        Example:
            >>> import jaxthermo as jt
            >>> jt.Skin.cells_for(pitch=0.02, diffusivity=5e-7, time=1.0)
            10
        """
        for name, value in (
            ("pitch", pitch),
            ("diffusivity", diffusivity),
            ("time", time),
        ):
            if not (value > 0 and math.isfinite(value)):
                raise InputError(
                    f"Skin.cells_for({name}={value!r}): give a positive one"
                )
        depth = math.sqrt(diffusivity * time)
        outermost = _PER_PENETRATION * depth
        # Of n cells in half a voxel the outermost has (r - 1) / (r^n - 1) of it.
        total = 1 + (_RATIO - 1) * (pitch / 2) / outermost
        cells = max(1, math.ceil(math.log(total) / math.log(_RATIO) - 1e-9))
        if cells > _MAX_CELLS:
            raise InputError(
                f"Skin.cells_for: a depth of {depth:.2g} m in voxels of "
                f"{pitch:g} m takes {cells} cells, more than {_MAX_CELLS}: give a "
                "finer pitch"
            )
        return cells

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return self.structure.identity

    @cached_property
    @override
    def options(self) -> Hashable:
        on = None if self.on is None else digest(self._fragments)
        return type(self), self.structure.options, self.cells, on

    @property
    def _fragments(self) -> Int[np.ndarray, " c"]:
        """Fragments that columns lie below."""
        grid = self.grid
        if self.on is None:
            return np.arange(len(grid.fragment_area))
        selected = self.on.select(grid.fragment_centres)
        return np.flatnonzero(selected)

    @property
    def column_count(self) -> int:
        """Number of fragments that columns of cells lie below."""
        return len(self._fragments)

    @property
    def _cell_count(self) -> int:
        return self.cells * self.column_count

    @property
    @override
    def node_count(self) -> int:
        return self._cell_count + self.structure.node_count

    @property
    @override
    def link_count(self) -> int:
        return self._cell_count + self.structure.link_count

    @property
    @override
    def capacity_ratio(self) -> float:
        return self.structure.capacity_ratio

    def _division(self) -> "_Division":
        return self.found(
            "division",
            lambda: _divide(self.structure, self._fragments, self.cells),
        )

    @override
    def nodes(self) -> Nodes:
        return self.found("nodes", self._nodes)

    def _nodes(self) -> Nodes:
        division = self._division()
        undivided = self.structure.nodes()
        hub = division.hub
        normal = self.grid.fragment_normal[division.fragment]
        foot = self.grid.fragment_foot[division.fragment]
        middle = division.edge[1:] / 2 + division.edge[:-1] / 2
        length = self.structure.fragment_distance[division.fragment]
        centre = undivided.centre[hub] + (length - middle)[..., None] * normal
        location = foot - middle[..., None] * normal
        return Nodes(
            centre=np.concatenate([centre.reshape(-1, 3), undivided.centre]),
            volume=np.concatenate([division.volume.reshape(-1), division.remainder]),
            level=np.concatenate(
                [np.tile(undivided.level[hub], self.cells), undivided.level]
            ),
            location=np.concatenate(
                [location.reshape(-1, 3), undivided.location + division.shift]
            ),
        )

    @override
    def links(self) -> Links:
        return self.found("links", self._links)

    def _links(self) -> Links:
        division = self._division()
        undivided = self.structure.links()
        location = self.structure.nodes().location
        first = self._cell_count
        columns = self.column_count
        thickness = np.diff(division.edge, axis=0)
        cell = np.arange(first, dtype=np.int32)
        inner = np.append(cell[columns:], first + division.hub).astype(np.int32)
        to_inner = np.concatenate([thickness[1:] / 2, division.to_hub[None]])
        step = location[undivided.dst] - location[undivided.src]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        along = step / np.where(length > 0, length, 1)
        ends = []
        for node, distance, sign in (
            (undivided.src, undivided.distance_src, 1),
            (undivided.dst, undivided.distance_dst, -1),
        ):
            nearer = sign * np.einsum("ei,ei->e", division.shift[node], along)
            ends.append(np.maximum(distance - nearer, _MIN_LENGTH * distance))
        area = np.tile(division.area, self.cells)
        return Links(
            src=np.append(cell, first + undivided.src).astype(np.int32),
            dst=np.append(inner, first + undivided.dst).astype(np.int32),
            area=np.append(area, undivided.area),
            distance_src=np.append(thickness / 2, ends[0]),
            distance_dst=np.append(to_inner, ends[1]),
        )

    @property
    @override
    def columns(self) -> ColumnLayout:
        cell = np.arange(self._cell_count, dtype=np.int32)
        return ColumnLayout(
            link=cell.reshape(self.cells, self.column_count),
            hub=self._cell_count + self._division().hub,
            are_linked=False,
        )

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        return self.found("fragment_node", self._fragment_node)

    def _fragment_node(self) -> Int[np.ndarray, " s"]:
        column = self._division().column
        undivided = self._cell_count + self.structure.fragment_node()
        return np.where(column < 0, undivided, column).astype(np.int32)

    @override
    def voxel_node(self) -> Int[np.ndarray, " v"]:
        return self.found("voxel_node", self._voxel_node)

    def _voxel_node(self) -> Int[np.ndarray, " v"]:
        node = self.structure.voxel_node()
        return np.where(node < 0, -1, node + self._cell_count).astype(np.int32)

    @override
    def sharing_node(self) -> Int[np.ndarray, " n"]:
        return self.found("sharing_node", self._sharing_node)

    def _sharing_node(self) -> Int[np.ndarray, " n"]:
        hub = self._cell_count + self._division().hub
        others = np.arange(self._cell_count, self.node_count)
        return np.append(np.tile(hub, self.cells), others)

    @override
    def shared_fraction(self) -> Float[np.ndarray, " n"]:
        undivided = np.append(np.zeros(self._cell_count), self.structure.nodes().volume)
        return self.nodes().volume / undivided[self.sharing_node()]

    @override
    def cell_centre(self) -> Float[np.ndarray, "s 3"]:
        return self.nodes().location[self.fragment_node()] + self.fragment_offset()

    @override
    def cell_depth(self) -> Float[np.ndarray, " s"]:
        return np.where(
            self._division().column < 0,
            np.minimum(self.structure.cell_depth(), self.fragment_distance),
            self.fragment_distance,
        )

    @override
    def _fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        # The outermost cell of a fragment is its node. A node that has moved towards a
        # fragment is no further from its voxel for that.
        shift = self._fragment_shift()
        normal = self.grid.fragment_normal
        towards = np.maximum(np.einsum("si,si->s", shift, normal), 0)[:, None]
        offset = self.structure.fragment_offset() - (shift - towards * normal)
        return np.where(self._division().column[:, None] < 0, offset, 0)

    @override
    def _fragment_distance(self) -> Float[np.ndarray, " s"]:
        division = self._division()
        undivided = self.structure.fragment_distance
        normal = self.grid.fragment_normal
        nearer = np.einsum("si,si->s", self._fragment_shift(), normal)
        distance = np.maximum(undivided - nearer, _MIN_LENGTH * undivided)
        outermost = division.edge[1, division.column] / 2
        return np.where(division.column < 0, distance, outermost)

    def _fragment_shift(self) -> Float[np.ndarray, "s 3"]:
        """Shift of the undivided node of each fragment [m]."""
        return self._division().shift[self.structure.fragment_node()]

    @override
    def node_at_depth(
        self,
        node: Int[np.ndarray, " q"],
        fragment: Int[np.ndarray, " q"],
        depth: Float[np.ndarray, " q"],
    ) -> Int[np.ndarray, " q"]:
        division = self._division()
        column = division.column[fragment]
        below = (column >= 0) & (self._cell_count + division.hub[column] == node)
        cell = (depth >= division.edge[1:, column]).sum(axis=0)
        in_column = below & (cell < self.cells)
        return np.where(in_column, cell * self.column_count + column, node)


class _Division(NamedTuple):
    """Columns of a structure, in the order of their hubs."""

    fragment: Int[np.ndarray, " c"]
    """Fragment of each column."""
    column: Int[np.ndarray, " s"]
    """Column of each fragment; -1 for none."""
    hub: Int[np.ndarray, " c"]
    """Node of the undivided structure that each column ends at."""
    area: Float[np.ndarray, " c"]
    """Cross-section of each column [m^2]."""
    edge: Float[np.ndarray, "m+1 c"]
    """Depths at which cells begin and end, from 0 at the surface [m]."""
    volume: Float[np.ndarray, "m c"]
    """Volume of each cell [m^3]."""
    remainder: Float[np.ndarray, " n"]
    """Volume left to each node of the undivided structure [m^3]."""
    shift: Float[np.ndarray, "n 3"]
    """Vector from each undivided node to the centre of the volume left to it [m]."""
    to_hub: Float[np.ndarray, " c"]
    """Distance from the end of each column to that centre [m]."""


def _divide(
    structure: AbstractVoxelStructure, selected: Int[np.ndarray, " c"], cells: int
) -> _Division:
    grid = structure.grid
    node = structure.fragment_node()
    node_volume = structure.nodes().volume
    count = len(node_volume)
    fragment = selected[np.argsort(node[selected], kind="stable")]
    column = np.full(len(node), -1)
    column[fragment] = np.arange(len(fragment))
    hub = node[fragment]
    area = grid.fragment_area[fragment]
    normal = grid.fragment_normal[fragment]
    length = structure.fragment_distance[fragment]
    total_area = np.bincount(hub, area, count)[hub]
    depth = np.minimum(length, node_volume[hub] / (2 * total_area))
    growth = np.cumsum(_RATIO ** np.arange(cells))
    edge = depth * np.append(0, growth / growth[-1])[:, None]
    taken = area * depth
    remainder = node_volume - np.bincount(hub, taken, count)
    # The columns' centres are at half their depth, above the node.
    moment = (taken * (length - depth / 2))[:, None] * normal
    total_moment = np.stack([np.bincount(hub, m, count) for m in moment.T], axis=1)
    shift = -total_moment / remainder[:, None]
    beyond = length - depth - np.einsum("ci,ci->c", shift[hub], normal)
    return _Division(
        fragment=fragment,
        column=column,
        hub=hub,
        area=area,
        edge=edge,
        volume=area * np.diff(edge, axis=0),
        remainder=remainder,
        shift=shift,
        to_hub=np.maximum(beyond, _MIN_LENGTH * (length - depth / 2)),
    )
