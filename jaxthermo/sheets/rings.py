"""Rings of narrow tubes and bars: nodes around them become one.

Where a tube is about as wide as a cell, a lattice cuts it lengthwise, and a coarse
surface of a few nodes around is far narrower than the tube. Nodes that close around a
tube are an annulus, of Euler characteristic 0, whose area vectors cancel. They are
joined: a tube becomes a chain of rings, as wide as its circumference.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import numbered, sorted_union
from ..geometry.vectors import row_dot
from .surface import Surface, summed_rows


_CLOSED = 0.4
"""Sum of the area vectors over the area, below which an annulus is a ring [-]."""

_BENT = 0.97
"""The same of two nodes, below which they may be on a narrow tube [-]."""

_NARROW = 0.62
"""Radius of a tube up to which rings begin: below four cells around [cells]."""

_STILL_NARROW = 0.67
"""Radius up to which rings go on along a tube [cells]."""

_CAP = 1.5
"""Area of a cap over that of its ring, below which the two are one node [-]."""

_MOST_AROUND = 6
"""Number of nodes around a tube up to which a ring goes on from another one."""


@dataclass(frozen=True, eq=False)
class _Complex:
    """Nodes of a surface as a complex: its pieces, their pairs and triples."""

    surface: Surface
    node: Int[np.ndarray, " v"]
    pitch: float

    @property
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
        third = self.surface.area[:, None] / 3 * self.surface.normal
        corners = self.node[self.surface.faces].ravel()
        return summed_rows(corners, np.repeat(third, 3, axis=0), self.count)

    @cached_property
    def moment(self) -> Float[np.ndarray, "n 3"]:
        """Sum of the positions of each node by area [m^3]."""
        weighted = self.surface.vertex_area[:, None] * self.surface.vertices
        return summed_rows(self.node, weighted, self.count)

    @cached_property
    def volume(self) -> Float[np.ndarray, " n"]:
        """Sum of the heights of its planes over the origin by area, by node [m^3]."""
        on_plane = self.surface.vertices[self.surface.faces[:, 0]]
        third = row_dot(on_plane, self.surface.normal) * self.surface.area / 3
        corners = self.node[self.surface.faces].ravel()
        return np.bincount(corners, np.repeat(third, 3), self.count)

    @cached_property
    def _corners(self) -> Int[np.ndarray, "t 3"]:
        """Nodes of each triangle, sorted."""
        return np.sort(self.node[self.surface.faces[self.surface.is_proper]], axis=1)

    @cached_property
    def _within(self) -> Bool[np.ndarray, "t 2"]:
        """True where the first two, and the last two, nodes of a triangle are one."""
        return self._corners[:, 1:] == self._corners[:, :-1]

    @cached_property
    def _ends(self) -> Int[np.ndarray, "e 2"]:
        """Nodes of each edge of the surface, once in every order."""
        return self.node[self.surface.neighbours]

    @cached_property
    def characteristic(self) -> Int[np.ndarray, " n"]:
        """Euler characteristic of each node: 1 of a disc, 0 of an annulus."""
        start, end = self._ends.T
        edges = np.bincount(start[start == end], minlength=self.count) // 2
        whole = self._corners[self._within.all(1), 0]
        triangles = np.bincount(whole, minlength=self.count)
        return np.bincount(self.node, minlength=self.count) - edges + triangles

    @cached_property
    def pairs(self) -> Int[np.ndarray, "p 2"]:
        """Nodes that an edge joins, in both orders; sorted."""
        start, end = self._ends.T
        key = sorted_union((start * self.count + end)[start != end])
        return np.stack([key // self.count, key % self.count], axis=1)

    @cached_property
    def _first_pair(self) -> Int[np.ndarray, " m"]:
        return np.searchsorted(self.pairs[:, 0], np.arange(self.count + 1))

    @cached_property
    def _terms(self) -> dict[tuple[int, ...], int]:
        """Changes of the Euler characteristic by the pairs and triples of nodes."""
        start, end = self._ends.T
        key = (start * self.count + end)[start < end]
        two = self._corners[self._within.sum(axis=1) == 1]
        filled = two[:, 0] * self.count + two[:, 2]
        signs = np.repeat([-1.0, 1.0], [len(key), len(filled)])
        used, entry = np.unique(np.concatenate([key, filled]), return_inverse=True)
        sums = np.bincount(entry, signs, len(used)).astype(np.int64)
        pairs = np.stack([used // self.count, used % self.count], axis=1)
        terms: dict[tuple[int, ...], int] = {}
        three = self._corners[~self._within.any(1)]
        triples, counts = np.unique(three, axis=0, return_counts=True)
        for rows, values in ((pairs, sums), (triples, counts)):
            keys = map(tuple, rows.tolist())
            terms.update(zip(keys, values.tolist(), strict=True))
        return terms

    def neighbours(self, members: set[int]) -> set[int]:
        """Nodes next to some nodes."""
        first = self._first_pair
        lists = [self.pairs[first[m] : first[m + 1], 1].tolist() for m in members]
        return set().union(*lists) - members

    def ratio(self, nodes: Int[np.ndarray, "k m"]) -> Float[np.ndarray, " k"]:
        """Length of the sum of area vectors over the sum of areas of m nodes [-]."""
        total = self.vector[nodes].sum(axis=1)
        return np.sqrt(row_dot(total, total)) / self.area[nodes].sum(axis=1)

    def radius(self, nodes: list[int]) -> float:
        """Mean distance of the planes of some nodes from their middle [m]."""
        area = self.area[nodes].sum()
        middle = self.moment[nodes].sum(axis=0) / area
        total = self.volume[nodes].sum() - middle @ self.vector[nodes].sum(axis=0)
        return float(abs(total) / area)

    def is_ring(self, members: set[int], largest: float) -> bool:
        """True if some nodes make up an annulus around a narrow tube.

        Args:
            members: numbers of the nodes.
            largest: radius of the tube up to which it is narrow [cells].
        """
        nodes = sorted(members)
        if self.ratio(np.array([nodes]))[0] >= _CLOSED:
            return False
        if self.radius(nodes) > largest * self.pitch:
            return False
        total = int(self.characteristic[nodes].sum())
        for i, low in enumerate(nodes):
            for j, middle in enumerate(nodes[i + 1 :], i + 1):
                total += self._terms.get((low, middle), 0)
                for high in nodes[j + 1 :]:
                    total += self._terms.get((low, middle, high), 0)
        return total == 0

    @property
    def closed(self) -> Bool[np.ndarray, " n"]:
        """Flag nodes that close around a tube."""
        ratio = self.ratio(np.arange(self.count)[:, None])
        return (ratio < _CLOSED) & (self.characteristic == 0)

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


def ring_nodes(surface: Surface, node: Int[np.ndarray, " v"]) -> Bool[np.ndarray, " n"]:
    """Flag nodes that close around a tube."""
    return _Complex(surface, node, pitch=0.0).closed


def joined_rings(
    surface: Surface, node: Int[np.ndarray, " v"], pitch: float
) -> Int[np.ndarray, " v"]:
    """Join the nodes around narrow tubes and bars.

    One to three nodes around a tube are a ring. From there rings go on along the tube.

    Args:
        surface: its triangles.
        node: node of each vertex.
        pitch: edge of a cell [m].
    """
    nodes = _Complex(surface, node, pitch)
    joined = np.arange(nodes.count)
    is_free = np.ones(nodes.count, bool)
    ends = []

    def join(ring: set[int]) -> None:
        members = sorted(ring)
        joined[members] = members[0]
        is_free[members] = False
        ends.append(ring)

    for ring in _first_rings(nodes):
        if is_free[list(ring)].all():
            join(ring)
    while ends:
        ring = ends.pop()
        beside = {member for member in nodes.neighbours(ring) if is_free[member]}
        for piece in nodes.pieces(beside):
            if len(piece) <= _MOST_AROUND and nodes.is_ring(piece, _STILL_NARROW):
                join(piece)
    _join_caps(nodes, joined, is_free)
    return numbered(joined[node]).number


def _first_rings(nodes: _Complex) -> list[set[int]]:
    """Rings of one to three nodes, the most closed ones first."""
    rings: list[set[int]] = [
        {number} for number in np.flatnonzero(nodes.closed).tolist()
    ]
    pairs = nodes.pairs[nodes.pairs[:, 0] < nodes.pairs[:, 1]]
    pairs = pairs[nodes.ratio(pairs) < _BENT].tolist()
    after: dict[int, set[int]] = {}
    for low, high in pairs:
        after.setdefault(low, set()).add(high)
    triples = [
        (low, middle, high)
        for low, middle in pairs
        for high in after[low] & after.get(middle, set())
    ]
    loops = []
    ratios = []
    for rows, size in ((pairs, 2), (triples, 3)):
        candidates = np.array(rows, np.int64).reshape(-1, size)
        ratio = nodes.ratio(candidates)
        closed = np.flatnonzero(ratio < _CLOSED)
        loops += [set(loop) for loop in candidates[closed].tolist()]
        ratios += ratio[closed].tolist()
    order = np.argsort(ratios, kind="stable")
    loops = [loops[entry] for entry in order]
    return rings + [loop for loop in loops if nodes.is_ring(loop, _NARROW)]


def _join_caps(
    nodes: _Complex, joined: Int[np.ndarray, " n"], is_free: Bool[np.ndarray, " n"]
) -> None:
    """Join small pieces with no neighbour but rings to one of them, in place."""
    rings = set(np.flatnonzero(~is_free).tolist())
    beside = nodes.neighbours(rings)
    while beside:
        piece = {beside.pop()}
        border = set(piece)
        while border and len(piece) <= _MOST_AROUND:
            border = nodes.neighbours(border) - rings - piece
            piece |= border
        beside -= piece
        if border:
            continue
        ring = joined[min(nodes.neighbours(piece) & rings)]
        if nodes.area[list(piece)].sum() < _CAP * nodes.area[joined == ring].sum():
            joined[list(piece)] = ring
