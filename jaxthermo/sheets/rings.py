"""Rings of narrow tubes and bars: nodes around them become one.

Where a tube is about as wide as a cell, a lattice cuts it lengthwise, and a coarse
surface of a few nodes around is far narrower than the tube. Nodes that close around a
tube are an annulus, of Euler characteristic 0, whose area vectors cancel. They are
joined: a tube becomes a chain of rings, as wide as its circumference.
"""

import numpy as np
from jaxtyping import Bool, Int

from ..arrays import in_sorted, rank_in_group, ranks
from .node_complex import NodeComplex
from .surface import Surface


_BENT = 0.97
"""The same of two nodes, below which they may be on a narrow tube [-]."""

_NARROW = 0.62
"""Radius of a tube up to which rings begin: below four cells around [cells]."""

_STILL_NARROW = 0.67
"""Radius up to which rings go on along a tube [cells]."""

_REST = 1.5
"""Area of what is left beside a ring over that of the ring, below which it is one node
with it [-]."""

_CAP = 0.5
"""The same of the cap of a closed end: a ring with a cap is no cap of the next ring."""

_MOST_AROUND = 6
"""Number of nodes around a tube up to which a ring goes on from another one."""


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
    nodes = NodeComplex(surface, node)
    joined = np.arange(nodes.count)
    is_free = np.ones(nodes.count, bool)
    ends = []

    def join(ring: set[int]) -> None:
        members = sorted(ring)
        joined[members] = members[0]
        is_free[members] = False
        ends.append(ring)

    for ring in _first_rings(nodes, pitch):
        if is_free[list(ring)].all():
            join(ring)
    while ends:
        ring = ends.pop()
        beside = {member for member in nodes.neighbours(ring) if is_free[member]}
        for piece in nodes.pieces(beside):
            if len(piece) > _MOST_AROUND:
                continue
            members = np.array([sorted(piece)])
            if nodes.are_rings(members, largest=_STILL_NARROW * pitch).all():
                join(piece)
    _join_caps(nodes, joined, is_free)
    return ranks(joined[node])


def _first_rings(nodes: NodeComplex, pitch: float) -> list[set[int]]:
    """Rings of one to three nodes, the most closed ones first."""
    rings: list[set[int]] = [
        {number} for number in np.flatnonzero(nodes.closed).tolist()
    ]
    pairs = nodes.pairs[nodes.pairs[:, 0] < nodes.pairs[:, 1]]
    pairs = pairs[nodes.ratio(pairs) < _BENT]
    loops = []
    ratios = []
    for candidates in (pairs, _triples(pairs, nodes.count)):
        is_ring = nodes.are_rings(candidates, largest=_NARROW * pitch)
        loops += [set(loop) for loop in candidates[is_ring].tolist()]
        ratios += nodes.ratio(candidates[is_ring]).tolist()
    return rings + [loops[entry] for entry in np.argsort(ratios, kind="stable")]


def _triples(pairs: Int[np.ndarray, "p 2"], count: int) -> Int[np.ndarray, "t 3"]:
    """Three nodes in rising order, of which each two are one of the sorted pairs."""
    low, middle = pairs.T
    first = np.searchsorted(low, middle)
    after = np.searchsorted(low, middle, side="right") - first
    entry = np.repeat(np.arange(len(pairs)), after)
    high = middle[first[entry] + rank_in_group(entry)]
    is_pair = in_sorted(low[entry] * count + high, low * count + middle)
    return np.column_stack([pairs[entry], high])[is_pair]


def _join_caps(
    nodes: NodeComplex, joined: Int[np.ndarray, " n"], is_free: Bool[np.ndarray, " n"]
) -> None:
    """Join small pieces with no neighbour but rings, in place.

    Those at an open end or between two rings join one, and so do small caps of a closed
    end. Other caps become one node.
    """
    open_ends = set(nodes.node[nodes.surface.border].ravel().tolist())
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
        beside_it = sorted(nodes.neighbours(piece) & rings)
        ring = joined[beside_it[0]]
        is_cap = piece.isdisjoint(open_ends) and (joined[beside_it] == ring).all()
        members = sorted(piece)
        share = nodes.area[members].sum() / nodes.area[joined == ring].sum()
        if share < (_CAP if is_cap else _REST):
            joined[members] = ring
        elif share < _REST:
            joined[members] = members[0]
