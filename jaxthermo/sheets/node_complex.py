"""Nodes of a surface as a complex: their sums over the surface, pairs and triples."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_union
from ..geometry.vectors import row_dot
from .surface import Surface, summed_rows


CLOSED = 0.4
"""Sum of the area vectors over the area, below which an annulus is a ring [-]."""


_LAST = np.iinfo(np.int64).max


class _Terms(NamedTuple):
    """Changes of the Euler characteristic by sets of nodes that the surface joins."""

    key: Int[np.ndarray, " k"]
    """Number of each set; sorted, and closed by one that no set has."""
    value: Int[np.ndarray, " k"]
    """Change by each set, and 0."""

    @staticmethod
    def counted(key: Int[np.ndarray, " k"], value: Int[np.ndarray, " k"]) -> "_Terms":
        """Terms of some sets, sorted by their numbers."""
        return _Terms(key=np.append(key, _LAST), value=np.append(value, 0))

    def entry(self, key: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Index of each set: the last one where the surface does not join its nodes."""
        entry = np.searchsorted(self.key, key)
        return np.where(self.key[entry] == key, entry, len(self.key) - 1)


@dataclass(frozen=True, eq=False)
class NodeComplex:
    """Nodes of a surface, of which each is a part of it."""

    surface: Surface
    node: Int[np.ndarray, " v"]
    """Node of each vertex of the surface."""

    @cached_property
    def count(self) -> int:
        """Number of nodes."""
        return int(self.node.max()) + 1

    @cached_property
    def area(self) -> Float[np.ndarray, " n"]:
        """Area of each node [m^2]."""
        return np.bincount(self.node, self.surface.vertex_area, self.count)

    @cached_property
    def vector(self) -> Float[np.ndarray, "n 3"]:
        """Sum of the normals of each node by area [m^2]."""
        return summed_rows(self.node, self.surface.vertex_vector, self.count)

    @cached_property
    def moment(self) -> Float[np.ndarray, "n 3"]:
        """Sum of the positions of each node by area [m^3]."""
        weighted = self.surface.vertex_area[:, None] * self.surface.vertices
        return summed_rows(self.node, weighted, self.count)

    @cached_property
    def volume(self) -> Float[np.ndarray, " n"]:
        """Sum of the heights of its planes over the origin by area, by node [m^3]."""
        return np.bincount(self.node, self.surface.vertex_volume, self.count)

    @cached_property
    def _corners(self) -> Int[np.ndarray, "3 t"]:
        """Nodes of each triangle."""
        return self.node.take(self.surface.corners)

    @cached_property
    def _ends(self) -> Int[np.ndarray, "2 e"]:
        """Nodes of each edge of the surface."""
        return self.node.take(self.surface.joined_vertices.T)

    @cached_property
    def characteristic(self) -> Int[np.ndarray, " n"]:
        """Euler characteristic of each node: 1 of a disc, 0 of an annulus."""
        return self._characteristic(np.ones(self.count, bool))

    def _characteristic(self, which: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Euler characteristic of some nodes; 0 of others."""
        is_member = which[self.node]
        member = np.flatnonzero(is_member)
        corners = self.surface.corners
        corners = corners.take(np.flatnonzero(is_member[corners[0]]), axis=1)
        first, second, third = self.node.take(corners)
        whole = np.flatnonzero((first == second) & (second == third))
        low, high = self.surface.joined_vertices.T
        at_member = np.flatnonzero(is_member[low])
        start = self.node[low[at_member]]
        within = np.flatnonzero(start == self.node[high[at_member]])
        vertices = np.bincount(self.node[member], minlength=self.count)
        edges = np.bincount(start[within], minlength=self.count)
        triangles = np.bincount(first[whole], minlength=self.count)
        return vertices - edges + triangles

    @cached_property
    def _mixed(self) -> Int[np.ndarray, "t 3"]:
        """Nodes of the triangles with more than one, sorted."""
        first, second, third = self._corners
        is_mixed = np.flatnonzero((first != second) | (second != third))
        corners = self._corners.take(is_mixed, axis=1)
        low = corners.min(axis=0)
        high = corners.max(axis=0)
        # Contiguous by columns, which are read one by one.
        return np.stack([low, corners.sum(axis=0) - low - high, high]).T

    @cached_property
    def _pair_terms(self) -> _Terms:
        start, end = self._ends
        across = np.flatnonzero(start != end)
        start = start[across]
        end = end[across]
        key = np.minimum(start, end) * self.count + np.maximum(start, end)
        key, edges = np.unique(key, return_counts=True)
        is_filled = (self._mixed[:, 1:] == self._mixed[:, :-1]).any(axis=1)
        filled = self._mixed[is_filled] @ [self.count, 0, 1]
        triangles = np.bincount(np.searchsorted(key, filled), minlength=len(key))
        return _Terms.counted(key, triangles - edges)

    @cached_property
    def _triple_terms(self) -> _Terms:
        is_triple = (self._mixed[:, 1:] != self._mixed[:, :-1]).all(axis=1)
        key = self._triple_key(self._mixed[is_triple])
        key, triangles = np.unique(key, return_counts=True)
        return _Terms.counted(key, triangles)

    def _triple_key(self, nodes: Int[np.ndarray, "k 3"]) -> Int[np.ndarray, " k"]:
        # Not from three numbers of nodes, whose product may be too long.
        pair = self._pair_terms.entry(nodes @ [self.count, 1, 0])
        return pair * self.count + nodes[:, 2]

    @cached_property
    def pairs(self) -> Int[np.ndarray, "p 2"]:
        """Nodes that an edge joins, in both orders; sorted."""
        forward = self._pair_terms.key[:-1]
        low, high = np.divmod(forward, self.count)
        key = sorted_union(forward, high * self.count + low)
        return np.stack(np.divmod(key, self.count), axis=1)

    def degrees(self, nodes: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        """Number of nodes that some nodes are joined to along the surface."""
        is_asked = np.zeros(self.count, bool)
        is_asked[nodes] = True
        start, end = self.surface.edges_from(np.flatnonzero(is_asked[self.node]))
        start = self.node[start]
        end = self.node[end]
        across = start != end
        joined = sorted_union(start[across] * self.count + end[across])
        return np.bincount(joined // self.count, minlength=self.count)[nodes]

    @cached_property
    def _first_pair(self) -> Int[np.ndarray, " m"]:
        return np.searchsorted(self.pairs[:, 0], np.arange(self.count + 1))

    def neighbours(self, members: set[int]) -> set[int]:
        """Nodes next to some nodes."""
        first = self._first_pair
        lists = [self.pairs[first[m] : first[m + 1], 1].tolist() for m in members]
        return set().union(*lists) - members

    def ratio(self, nodes: Int[np.ndarray, "k m"]) -> Float[np.ndarray, " k"]:
        """Length of the sum of area vectors over the sum of areas of m nodes [-]."""
        total = self.vector[nodes].sum(axis=1)
        return np.sqrt(row_dot(total, total)) / self.area[nodes].sum(axis=1)

    def radius(self, nodes: Int[np.ndarray, "k m"]) -> Float[np.ndarray, " k"]:
        """Mean distance of the planes of m nodes from their middle [m]."""
        area = self.area[nodes].sum(axis=1)
        middle = self.moment[nodes].sum(axis=1) / area[:, None]
        to_origin = row_dot(middle, self.vector[nodes].sum(axis=1))
        return np.abs(self.volume[nodes].sum(axis=1) - to_origin) / area

    def are_rings(
        self, nodes: Int[np.ndarray, "k m"], largest: float
    ) -> Bool[np.ndarray, " k"]:
        """Flag sets of m nodes that make up an annulus around a narrow tube.

        Args:
            nodes: numbers of the nodes of each set, sorted.
            largest: radius of the tube up to which it is narrow [m].
        """
        flags = (self.ratio(nodes) < CLOSED) & (self.radius(nodes) <= largest)
        narrow = nodes[flags]
        total = self.characteristic[narrow].sum(axis=1)
        size = nodes.shape[1]
        for columns in combinations(range(size), 2):
            entry = self._pair_terms.entry(narrow[:, columns] @ [self.count, 1])
            total += self._pair_terms.value[entry]
        for columns in combinations(range(size), 3):
            entry = self._triple_terms.entry(self._triple_key(narrow[:, columns]))
            total += self._triple_terms.value[entry]
        flags[flags] = total == 0
        return flags

    @cached_property
    def closed(self) -> Bool[np.ndarray, " n"]:
        """Flag nodes that close around a tube."""
        has_turned = self.ratio(np.arange(self.count)[:, None]) < CLOSED
        return has_turned & (self._characteristic(has_turned) == 0)

    def pieces(self, nodes: set[int]) -> list[set[int]]:
        """Connected pieces of some nodes."""
        waiting = set(nodes)
        pieces = []
        while waiting:
            piece = {waiting.pop()}
            border = set(piece)
            while border:
                border = self.neighbours(border) & waiting
                piece |= border
                waiting -= border
            pieces.append(piece)
        return pieces
