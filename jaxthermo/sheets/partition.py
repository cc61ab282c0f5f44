"""Nodes of a sheet: which vertices of its triangles belong to which node."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import rank_in_group, ranks, sorted_union, unique_rows
from ..geometry.mesh import connected_labels
from ..geometry.vectors import row_dot, row_length
from .rings import joined_rings
from .surface import ROUNDING, ROUNDING_DIGITS, Surface, summed_rows


_ORIGIN = 0.4877
"""Distance from the lattice's lowest corner to the mesh's [cells].

About a half: flat faces of a box of whole cells run through the middle of cells. No
fraction of two: the middles of edges do not fall on the border between two cells.
"""

_SMALL = 0.3
"""Area of a node over its largest neighbour's below which it joins a neighbour [-]."""

_TINY = 0.1
"""The same limit after vertices have moved to the nearest node [-]."""

_FLAT = 0.97
"""Length of the sum of the area vectors of a flat node over its area, at least [-]."""

_ROUNDS = 2
"""Number of times that vertices move to the nearest node, and nodes to their middle."""

_SWEEPS = 4
"""Number of edges over which a vertex may find a nearer node, in one round."""


def cell_nodes(
    surface: Surface, lower: Float[np.ndarray, "3"], pitch: float
) -> Int[np.ndarray, " v"]:
    """Divide a surface into connected nodes about as large as a cell of a lattice.

    Nodes start as the connected parts of the surface within each cell. The lattice cuts
    corners off: parts much smaller than a neighbour join one. Then each vertex goes to
    the nearest node that it can reach along the surface, as in Lloyd's relaxation: the
    triangles between such nodes do not overlap, and cuts through a narrow strip are at
    right angles to it.

    Args:
        surface: triangles with edges of at most half a cell.
        lower: lowest corner of the mesh [m].
        pitch: edge of a cell [m].
    """
    cell = np.floor((surface.vertices - lower) / pitch + _ORIGIN).astype(np.int64)
    _, cell_number = unique_rows(cell)
    node = _connected(surface, cell_number)
    node = _without_small(surface, node, _SMALL)
    for _ in range(_ROUNDS):
        node = joined_rings(surface, node, pitch)
        node = _nearest(surface, node, node_positions(surface, node))
        node = _connected(surface, node)
    return _without_small(surface, node, _TINY)


def _connected(
    surface: Surface,
    label: Int[np.ndarray, " v"],
    among: Bool[np.ndarray, " v"] | None = None,
) -> Int[np.ndarray, " v"]:
    """Number the connected parts of equal label.

    Labels without a vertex `among` some are connected already; None for all vertices.
    """
    count = len(surface.vertices)
    if among is None:
        start, end = surface.joined_vertices.T
        within = label[start] == label[end]
        links = np.stack([start[within], end[within]]).T
        return ranks(connected_labels(count, links))
    members = np.flatnonzero(among)
    start, end = surface.edges_from(members)
    within = label[start] == label[end]
    number = np.cumsum(among) - 1
    links = np.stack([number[start[within]], number[end[within]]]).T
    lowest = members[connected_labels(len(members), links)]
    parts = label.copy()
    parts[members] = count + lowest
    return ranks(parts)


def _without_small(
    surface: Surface,
    node: Int[np.ndarray, " v"],
    limit: float,
    *,
    among: Bool[np.ndarray, " v"] | None = None,
    stays: Int[np.ndarray, " k"] | None = None,
) -> Int[np.ndarray, " v"]:
    """Join small and enclosed nodes to the neighbour that they share most edges with.

    Nodes without a vertex `among` some remain, and those of the numbers in `stays`.
    """
    # Once: a strip at a plate, narrower than a cell, would be joined node by node.
    count = int(node.max()) + 1
    area = np.bincount(node, surface.vertex_area, count)
    if among is None:
        start, end = surface.edges_across(node)
    else:
        start, end = surface.edges_from(np.flatnonzero(among))
    start = node[start]
    end = node[end]
    across = start != end
    pairs, shared = np.unique((start * count + end)[across], return_counts=True)
    source = pairs // count
    target = pairs % count
    largest = np.zeros(count)
    np.maximum.at(largest, source, area[target])
    # In the order of their areas, so that no two join each other.
    larger = (area[target] > area[source]) | (
        (area[target] == area[source]) & (target > source)
    )
    is_small = area < limit * largest
    is_small |= _are_enclosed(surface, node, np.bincount(source, minlength=count))
    candidates = np.flatnonzero(is_small[source] & larger)
    order = candidates[np.lexsort([shared[candidates], source[candidates]])]
    joined = np.arange(count)
    # The last of each source, with the most shared edges, stays.
    joined[source[order]] = target[order]
    if stays is not None:
        joined[stays] = stays
    while (joined[joined] != joined).any():
        joined = joined[joined]
    return ranks(joined[node])


def _are_enclosed(
    surface: Surface, node: Int[np.ndarray, " v"], degree: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Flag flat nodes off the border with at most two neighbours.

    Both triangles of such a node have its neighbours as corners, and lie on each other.
    """
    candidate = degree <= 2
    candidate[node[surface.border]] = False
    members = np.flatnonzero(candidate[node])
    area = np.bincount(node[members], surface.vertex_area[members], len(degree))
    vector = summed_rows(node[members], surface.vertex_vector[members], len(degree))
    return candidate & (row_length(vector) > _FLAT * area)


def with_border_nodes(
    surface: Surface,
    node: Int[np.ndarray, " v"],
    *,
    position: Float[np.ndarray, "n 3"],
    ends: Int[np.ndarray, "k 2"],
    feet: Float[np.ndarray, "k 3"],
) -> Int[np.ndarray, " v"]:
    """Give the border more nodes, between two that are too far from each other.

    Args:
        surface: its triangles.
        node: node of each vertex.
        position: position of each node [m].
        ends: two nodes at the border, for each new node.
        feet: position of the new node [m].
    """
    line = sorted_union(surface.border.ravel(), surface.creases.ravel())
    line = line[np.argsort(node[line], kind="stable")]
    # The vertices on the border of both nodes.
    between = ends.ravel()
    first = np.searchsorted(node[line], between)
    counts = np.searchsorted(node[line], between, side="right") - first
    entry = np.repeat(np.arange(len(between)), counts)
    vertex = line[np.repeat(first, counts) + rank_in_group(entry)]
    foot = entry // 2
    distance = np.linalg.norm(surface.vertices[vertex] - feet[foot], axis=1)
    present = np.linalg.norm(surface.vertices[vertex] - position[node[vertex]], axis=1)
    order = np.lexsort([distance, foot])
    order = order[np.diff(foot[order], prepend=-1) != 0]
    order = order[distance[order] < present[order]]
    new = vertex[order]
    finer = node.copy()
    finer[new] = len(position) + foot[order]
    finer = _nearest(surface, finer, np.concatenate([position, feet]))
    # Only nodes that gained or lost vertices may be small, or in several parts.
    has_changed = np.zeros(len(position) + len(feet), bool)
    has_changed[node[finer != node]] = True
    has_changed[finer[new]] = True
    among = has_changed[finer]
    finer = _connected(surface, finer, among)
    return _without_small(surface, finer, _TINY, among=among, stays=finer[new])


def _nearest(
    surface: Surface,
    node: Int[np.ndarray, " v"],
    position: Float[np.ndarray, "n 3"],
) -> Int[np.ndarray, " v"]:
    """Move vertices to the nearest node that a neighbour belongs to."""
    node = node.copy()
    start, end = surface.edges_across(node)
    for _ in range(_SWEEPS):
        across = np.flatnonzero(node[start] != node[end])
        vertex = start[across]
        offered = node[end[across]]
        points = surface.vertices.take(vertex, axis=0)
        offers = _distances(points, position.take(offered, axis=0))
        present = _distances(points, position.take(node[vertex], axis=0))
        # The nearest offer of each vertex is written last, of equal ones the first:
        # rounding does not choose between them.
        nearer = np.flatnonzero(offers < (1 - ROUNDING) * present)[::-1]
        near = np.round(offers[nearer] / offers.max(initial=1e-300), ROUNDING_DIGITS)
        nearer = nearer[np.argsort(-near, kind="stable")]
        node[vertex[nearer]] = offered[nearer]
        # A vertex has a new offer where a neighbour has moved.
        end, start = surface.edges_from(sorted_union(vertex[nearer]))
        if not len(start):
            break
    return node


def _distances(
    points: Float[np.ndarray, "k 3"], targets: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, " k"]:
    offset = points - targets
    return np.sqrt(row_dot(offset, offset))


def node_positions(
    surface: Surface, node: Int[np.ndarray, " v"]
) -> Float[np.ndarray, "n 3"]:
    """Positions of the nodes [m].

    The first of these that the node has: the mean of the corners of the free border in
    it; of the free border, by length; of the corners of creases, and of the creases; of
    its surface, by area. With the mean of the surface everywhere the border would
    shrink by half a cell, and paths over a crease would be too short.
    """
    vertices = surface.vertices
    count = int(node.max()) + 1
    position = np.zeros((count, 3))
    total = np.bincount(node, surface.vertex_area, count)[:, None]
    moment = summed_rows(node, surface.vertex_moment, count)
    np.divide(moment, total, out=position, where=total > 0)
    # Those with precedence are written last.
    weighted = []
    for ends, is_corner in (
        (surface.creases, surface.crease_corners),
        (surface.border, surface.border_corners),
    ):
        points = vertices[ends]
        half = np.linalg.norm(points[:, 1] - points[:, 0], axis=1) / 2
        halves = (3 * points + points[:, ::-1]) / 4
        weighted.append((node[ends].ravel(), np.repeat(half, 2), halves.reshape(-1, 3)))
        corners = np.flatnonzero(is_corner)
        weighted.append((node[corners], np.ones(len(corners)), vertices[corners]))
    for member, weight, points in weighted:
        total = np.bincount(member, weight, count)
        has_some = total > 0
        for axis, column in enumerate(points.T):
            sums = np.bincount(member, weight * column, count)
            position[has_some, axis] = sums[has_some] / total[has_some]
    return position
