"""Several bodies as one structure, whose nodes no link joins to those of another body.

Fragments of the bodies follow one another, and so do their nodes, except for the cells
of columns: those come first, layer by layer, as in a body with columns. All positions
are in the frames of their own bodies, and those of two bodies are not comparable.
"""

from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from ..arrays import consecutive, namespace
from ..errors import InputError
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid
from .structure import AbstractStructure, ColumnLayout, Links, Nodes
from .weights import ConductionWeights


class _JoinedGrid(AbstractGrid):
    """Fragments of several bodies, each in the frame of its own body.

    The bodies have no mesh and no lattice in common.
    """

    def __init__(self, parts: tuple[AbstractGrid, ...]):
        self.parts = parts
        self.fragment_position = _joined(parts, "fragment_position")
        self.fragment_normal = _joined(parts, "fragment_normal")
        self.fragment_area = _joined(parts, "fragment_area")
        self.fragment_depth = np.concatenate([_depths(part) for part in parts])
        self.unscaled_because = ""

    @property
    @override
    def pitch(self) -> float:
        """Smallest edge of a cell of any of the bodies [m]."""
        return min(part.pitch for part in self.parts)

    @property
    @override
    def fragment_foot(self) -> Float[np.ndarray, "s 3"]:
        return _joined(self.parts, "fragment_foot")

    @property
    @override
    def fragment_centre(self) -> Float[np.ndarray, "s 3"]:
        return _joined(self.parts, "fragment_centre")

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        raise InputError("bodies that are joined have no frame in common")


def _joined(parts: tuple[AbstractGrid, ...], field: str) -> np.ndarray:
    return np.concatenate([getattr(part, field) for part in parts])


def _depths(grid: AbstractGrid) -> Float[np.ndarray, " s"]:
    if grid.fragment_depth is not None:
        return grid.fragment_depth
    return np.full(len(grid.fragment_area), grid.pitch / 2)


class _SortedLinks(NamedTuple):
    links: Links
    order: Int[np.ndarray, " e"]


class JoinedStructure(AbstractStructure):
    """Nodes, links and fragments of several structures without weights.

    All of them have columns of the same number of cells, or none.
    """

    grid: _JoinedGrid = eqx.field(static=True)
    parts: tuple[AbstractStructure, ...]
    weights: ConductionWeights = eqx.field(kw_only=True, default=ConductionWeights())

    @classmethod
    def of(cls, parts: tuple[AbstractStructure, ...]) -> "JoinedStructure":
        """Join structures whose states are lists of nodes."""
        grids = tuple(part.grid for part in parts)
        grid = found(grids, by="joined grid", find=lambda: _JoinedGrid(grids))
        return cls(grid, parts)

    @cached_property
    @override
    def identity(self) -> tuple[object, ...]:
        identities = [part.identity for part in self.parts]
        return sum(identities, ()) if all(identities) else ()

    @cached_property
    @override
    def options(self) -> Hashable:
        return type(self), *(part.options for part in self.parts)

    def nodes_of_parts(self) -> list[Int[np.ndarray, " _"]]:
        """Number of each node of each part."""
        return self.found("nodes of parts", self._nodes_of_parts)

    def _nodes_of_parts(self) -> list[Int[np.ndarray, " _"]]:
        columns = [part.columns for part in self.parts]
        links = [None if layout is None else layout.link for layout in columns]
        layers = 0 if links[0] is None else len(links[0])
        counts = [0 if link is None else link.shape[1] for link in links]
        behind = consecutive(
            part.node_count - layers * count
            for part, count in zip(self.parts, counts, strict=True)
        )
        layer = sum(counts) * np.arange(layers)[:, None]
        numbers = []
        for cells, others in zip(consecutive(counts), behind, strict=True):
            of_cells = layer + np.arange(cells.start, cells.stop)
            of_others = layers * sum(counts) + np.arange(others.start, others.stop)
            number = np.concatenate([of_cells.reshape(-1), of_others])
            numbers.append(number.astype(np.int32))
        return numbers

    def _node_order(self) -> Int[np.ndarray, " n"]:
        """Position of each node among those of all parts, one after the other."""
        return np.argsort(np.concatenate(self.nodes_of_parts()))

    @cached_property
    def fragment_slices(self) -> list[slice]:
        """Fragments of each part."""
        return consecutive(len(part.grid.fragment_area) for part in self.parts)

    @property
    @override
    def node_count(self) -> int:
        return sum(part.node_count for part in self.parts)

    @property
    @override
    def link_count(self) -> int:
        return sum(part.link_count for part in self.parts)

    @override
    def nodes(self) -> Nodes:
        nodes = [part.nodes() for part in self.parts]
        order = self.found("joined node order", self._node_order)
        volumes = [part_nodes.volume for part_nodes in nodes]
        return Nodes(
            centre=np.concatenate([part_nodes.centre for part_nodes in nodes])[order],
            # Those of a sheet follow from thicknesses, which may be traced.
            volume=namespace(volumes).concatenate(volumes)[order],
            level=np.concatenate([part_nodes.level for part_nodes in nodes])[order],
            location=np.concatenate([n.location for n in nodes])[order],
        )

    @override
    def links(self) -> Links:
        return self._sorted_links().links

    @property
    def link_order(self) -> Int[np.ndarray, " e"]:
        """Position of each link among those of all parts, one after the other."""
        return self._sorted_links().order

    def _sorted_links(self) -> "_SortedLinks":
        def join() -> _SortedLinks:
            renumbered = []
            for part, number in zip(self.parts, self.nodes_of_parts(), strict=True):
                links = part.links()
                renumbered.append(
                    links._replace(src=number[links.src], dst=number[links.dst])
                )
            links = Links(
                *(np.concatenate(column) for column in zip(*renumbered, strict=True))
            )
            order = np.argsort(links.src, kind="stable")
            return _SortedLinks(links.selected(order), order)

        return self.found("joined links", join)

    @property
    @override
    def columns(self) -> ColumnLayout | None:
        layouts = [
            layout for part in self.parts if (layout := part.columns) is not None
        ]
        if not layouts:
            return None
        rank = np.argsort(self.link_order)
        firsts = consecutive(part.link_count for part in self.parts)
        pairs = list(zip(layouts, firsts, strict=True))
        numbers = zip(layouts, self.nodes_of_parts(), strict=True)
        return ColumnLayout(
            link=np.concatenate(
                [rank[layout.link + links.start] for layout, links in pairs], axis=1
            ),
            hub=np.concatenate([number[layout.hub] for layout, number in numbers]),
            are_linked=any(layout.are_linked for layout in layouts),
        )

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        def join() -> Int[np.ndarray, " s"]:
            pairs = zip(self.parts, self.nodes_of_parts(), strict=True)
            return np.concatenate(
                [number[part.fragment_node()] for part, number in pairs]
            )

        return self.found("joined fragment nodes", join)

    @property
    @override
    def volume(self) -> float:
        return sum(part.volume for part in self.parts)

    @property
    @override
    def capacity_ratio(self) -> float:
        return float(self.nodes().volume.sum()) / self.volume

    def _of_parts(self, values: Callable[[AbstractStructure], Any]) -> np.ndarray:
        return np.concatenate([values(part) for part in self.parts])

    @override
    def cell_position(self) -> Float[np.ndarray, "n 3"]:
        position = self._of_parts(lambda part: part.cell_position())
        return position[self.found("joined node order", self._node_order)]

    @override
    def _fragment_offset(self) -> Float[np.ndarray, "s 3"]:
        return self._of_parts(lambda part: part.fragment_offset())

    @override
    def cell_centre(self) -> Float[np.ndarray, "s 3"]:
        return self._of_parts(lambda part: part.cell_centre())

    @override
    def cell_depth(self) -> Float[np.ndarray, " s"]:
        return self._of_parts(
            lambda part: np.broadcast_to(
                part.cell_depth(), part.grid.fragment_area.shape
            )
        )

    @override
    def _fragment_distance(self) -> Float[np.ndarray, " s"]:
        return self._of_parts(lambda part: part.fragment_distance)
