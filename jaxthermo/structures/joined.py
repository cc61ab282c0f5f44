"""Several bodies as one structure, whose nodes no link joins to those of another body.

Nodes, links and fragments of the bodies follow one another, each in the frame of its
own body: positions of two bodies are not comparable.
"""

from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from ..arrays import consecutive
from ..errors import InputError
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid
from .structure import AbstractStructure, Links, Nodes
from .weights import ConductionWeights


class JoinedGrid(AbstractGrid):
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


class JoinedStructure(AbstractStructure):
    """Nodes, links and fragments of several structures without weights."""

    grid: JoinedGrid = eqx.field(static=True)
    parts: tuple[AbstractStructure, ...]
    weights: ConductionWeights = eqx.field(kw_only=True, default=ConductionWeights())

    @classmethod
    def of(cls, parts: tuple[AbstractStructure, ...]) -> "JoinedStructure":
        """Join structures whose states are lists of nodes."""
        grids = tuple(part.grid for part in parts)
        grid = found(grids, by="joined grid", find=lambda: JoinedGrid(grids))
        return cls(grid, parts)

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        identities = [part.identity for part in self.parts]
        return sum(identities, ()) if all(identities) else ()

    @property
    @override
    def options(self) -> Hashable:
        return type(self), *(part.options for part in self.parts)

    @cached_property
    def node_slices(self) -> list[slice]:
        """Nodes of each part."""
        return consecutive(part.node_count for part in self.parts)

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
        def join() -> Nodes:
            nodes = [part.nodes() for part in self.parts]
            return Nodes(
                *(np.concatenate(column) for column in zip(*nodes, strict=True))
            )

        return self.found("joined nodes", join)

    @override
    def links(self) -> Links:
        def join() -> Links:
            shifted = []
            for part, nodes in zip(self.parts, self.node_slices, strict=True):
                links = part.links()
                start = np.int32(nodes.start)
                shifted.append(
                    links._replace(src=links.src + start, dst=links.dst + start)
                )
            return Links(
                *(np.concatenate(column) for column in zip(*shifted, strict=True))
            )

        return self.found("joined links", join)

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        def join() -> Int[np.ndarray, " s"]:
            pairs = zip(self.parts, self.node_slices, strict=True)
            return np.concatenate(
                [part.fragment_node() + np.int32(nodes.start) for part, nodes in pairs]
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
        return self._of_parts(lambda part: part.fragment_distance())
