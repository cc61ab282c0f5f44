"""Nodes of strips that are narrower than a cell, and their two borders."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from ..arrays import rank_in_group
from ..geometry.vectors import row_dot, row_length
from .node_complex import NodeComplex
from .surface import Surface, summed_rows


class Strips(NamedTuple):
    """Nodes across which a strip runs from one border to another."""

    node: Int[np.ndarray, " d"]
    borders: Float[np.ndarray, "d 2 3"]
    """Point of each node on either border, opposite each other [m]."""
    is_second: Bool[np.ndarray, " v"]
    """True for vertices of these nodes that are nearer to the second border."""


class _Arcs(NamedTuple):
    """Connected parts of the free border within a node, but no closed ones."""

    vertex: Int[np.ndarray, " b"]
    """Vertices on them."""
    arc: Int[np.ndarray, " b"]
    """Arc of each of these vertices, from 0."""
    node: Int[np.ndarray, " a"]
    """Node of each arc; sorted."""


class _Sides(NamedTuple):
    """A point on each side of a node, and the vertices of the surface there."""

    node: Int[np.ndarray, " d"]
    borders: Float[np.ndarray, "d 2 3"]
    anchors: Int[np.ndarray, " k"]
    anchor_side: Int[np.ndarray, " k"]
    """0 or 1."""


def strips(nodes: NodeComplex) -> Strips:
    """Nodes with two borders: within a strip, and at the end of one."""
    surface = nodes.surface
    node = nodes.node
    arcs = _border_arcs(surface, node)
    middles = _middles(surface, node, arcs)
    ends = _ends(nodes, arcs)
    anchors = np.concatenate([middles.anchors, ends.anchors])
    is_second = np.zeros(len(node), bool)
    if len(anchors):
        side = np.zeros(len(node), np.int64)
        side[anchors] = np.concatenate([middles.anchor_side, ends.anchor_side])
        nearest = _nearest_anchor(surface, node, anchors)
        is_second = (nearest >= 0) & (side[np.maximum(nearest, 0)] == 1)
    return Strips(
        node=np.concatenate([middles.node, ends.node]),
        borders=np.concatenate([middles.borders, ends.borders]),
        is_second=is_second,
    )


def _border_arcs(surface: Surface, node: Int[np.ndarray, " v"]) -> _Arcs:
    border = surface.border
    vertex, ends = np.unique(border, return_inverse=True)
    ends = ends.reshape(-1, 2)
    ends = ends[node[border[:, 0]] == node[border[:, 1]]]
    shape = (len(vertex), len(vertex))
    graph = coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=shape)
    count, label = connected_components(graph, directed=False)
    links = np.bincount(label[ends[:, 0]], minlength=count)
    is_open = links < np.bincount(label, minlength=count)
    arc_node = np.zeros(count, np.int64)
    arc_node[label] = node[vertex]
    order = np.flatnonzero(is_open)
    order = order[np.argsort(arc_node[order], kind="stable")]
    number = np.full(count, -1)
    number[order] = np.arange(len(order))
    on_open = is_open[label]
    return _Arcs(
        vertex=vertex[on_open], arc=number[label[on_open]], node=arc_node[order]
    )


def _middles(surface: Surface, node: Int[np.ndarray, " v"], arcs: _Arcs) -> _Sides:
    """Nodes with two arcs: the corners on each, or else its nearest point."""
    count = int(node.max()) + 1
    is_divided = np.bincount(arcs.node, minlength=count) == 2
    side = rank_in_group(arcs.node)
    area = np.bincount(node, surface.vertex_area, count)
    moment = surface.vertex_area[:, None] * surface.vertices
    mean = summed_rows(node, moment, count) / area[:, None]
    arc_of = np.full(len(node), -1)
    arc_of[arcs.vertex] = arcs.arc
    # Each edge of the border, from each of its ends: parts of it outside the node too.
    ends = np.concatenate([surface.border, surface.border[:, ::-1]])
    arc = arc_of[ends[:, 0]]
    counted = (arc >= 0) & is_divided[node[ends[:, 0]]]
    ends = ends[counted]
    arc = arc[counted]
    start = surface.vertices[ends[:, 0]]
    along = surface.vertices[ends[:, 1]] - start
    offset = mean[node[ends[:, 0]]] - start
    square = row_dot(along, along)
    fraction = np.clip(row_dot(offset, along) / np.where(square > 0, square, 1), 0, 1)
    point = start + fraction[:, None] * along
    miss = row_length(offset - fraction[:, None] * along)
    order = np.lexsort([miss, arc])
    order = order[np.diff(arc[order], prepend=-1) != 0]
    points = np.zeros((len(arcs.node), 3))
    points[arc[order]] = point[order]
    is_corner = surface.border_corners[arcs.vertex]
    corner_arc = arcs.arc[is_corner]
    corners = np.bincount(corner_arc, minlength=len(arcs.node))
    for axis, column in enumerate(surface.vertices[arcs.vertex[is_corner]].T):
        sums = np.bincount(corner_arc, column, len(arcs.node))
        points[corners > 0, axis] = sums[corners > 0] / corners[corners > 0]
    chosen = is_divided[arcs.node]
    on_chosen = chosen[arcs.arc]
    return _Sides(
        node=np.flatnonzero(is_divided),
        borders=points[chosen].reshape(-1, 2, 3),
        anchors=arcs.vertex[on_chosen],
        anchor_side=side[arcs.arc[on_chosen]],
    )


def _ends(nodes: NodeComplex, arcs: _Arcs) -> _Sides:
    """Nodes with a single arc around an end: the two corners farthest apart."""
    surface = nodes.surface
    node = nodes.node
    count = nodes.count
    corners = arcs.vertex[surface.border_corners[arcs.vertex]]
    is_end = np.bincount(node[corners], minlength=count) >= 2
    is_end &= np.bincount(arcs.node, minlength=count) == 1
    # A notch in the border of a plate has more neighbours.
    numbers = np.flatnonzero(is_end)
    degree = nodes.degrees(numbers)
    pairs = []
    for number in numbers[(degree >= 1) & (degree <= 3)]:
        members = corners[node[corners] == number]
        points = surface.vertices[members]
        gaps = np.linalg.norm(points[:, None] - points, axis=2)
        farthest = np.unravel_index(gaps.argmax(), gaps.shape)
        pairs.append([number, *members[list(farthest)]])
    ends = np.array(pairs, np.int64).reshape(-1, 3)
    return _Sides(
        node=ends[:, 0],
        borders=surface.vertices[ends[:, 1:]],
        anchors=ends[:, 1:].ravel(),
        anchor_side=np.tile([0, 1], len(ends)),
    )


def _nearest_anchor(
    surface: Surface, node: Int[np.ndarray, " v"], anchors: Int[np.ndarray, " a"]
) -> Int[np.ndarray, " v"]:
    """Nearest of some vertices in the same node, along edges; negative for none."""
    has_anchor = np.zeros(int(node.max()) + 1, bool)
    has_anchor[node[anchors]] = True
    member = np.flatnonzero(has_anchor[node])
    start, end = surface.edges_from(member)
    within = node[start] == node[end]
    start = start[within]
    end = end[within]
    length = row_length(surface.vertices[start] - surface.vertices[end])
    # Zeros are no edges to scipy.
    length += 1e-9 * length.max(initial=1e-300)
    # Of these nodes alone, since a search begins with all vertices of a graph.
    rank = np.full(len(node), -1)
    rank[member] = np.arange(len(member))
    ends = (rank[start], rank[end])
    graph = csr_array((length, ends), shape=(len(member), len(member)))
    _, _, source = dijkstra(
        graph,
        directed=False,
        indices=rank[anchors],
        min_only=True,
        return_predecessors=True,
    )
    nearest = np.full(len(node), -1)
    nearest[member] = np.where(source >= 0, member[source], -1)
    return nearest
