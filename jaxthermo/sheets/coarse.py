"""Coarse surface of a sheet: triangles whose corners are nodes, and its conductances.

Where a strip is narrower than a cell its nodes form a chain, and no triangle has three
of them. Such a node has two vertices of the coarse surface, one on each border: the
strip keeps its width. Where even so no triangle joins two neighbours (rings of a narrow
tube), they conduct by the length of the line between them over their distance.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import in_sorted, sorted_union, unique_rows
from ..geometry.mesh import edges_of
from ..geometry.vectors import row_dot, row_length, triangle_normals
from .borders import obtuse_feet
from .node_complex import NodeComplex
from .partition import node_positions, with_border_nodes
from .strips import strips
from .surface import Surface, summed_rows
from .tufted import triangle_weights


_MAX_FLIPS = 10
"""Rounds of flips of edges that unfold triangles."""

_FOLDED = 0.5
"""Sum of the area vectors of a node over its area, from which it is an arc [-]."""

_FLAT = 0.02
"""The same, below which a node has no direction [-]."""

_MIN_GAP = 0.15
"""Distance of an additional node on the border to its neighbours [cells]."""

_MAX_BORDER_ROUNDS = 4
"""Rounds of additional nodes on the border."""


class SheetLinks(NamedTuple):
    """Conductances along the surface: one entry for a pair of nodes and a part."""

    src: Int[np.ndarray, " l"]
    """Node; sorted."""
    dst: Int[np.ndarray, " l"]
    """Node; larger than `src`."""
    part: Int[np.ndarray, " l"]
    """Part of the mesh that conducts."""
    weight: Float[np.ndarray, " l"]
    """Conductance over the sum of conductivity times thickness of the part [-]; > 0."""


class CoarseSurface(NamedTuple):
    """Triangles between nodes."""

    position: Float[np.ndarray, "c 3"]
    """Position of each coarse vertex [m]."""
    node: Int[np.ndarray, " c"]
    """Node of each coarse vertex: a node may have two."""
    vertex: Int[np.ndarray, " v"]
    """Coarse vertex of each vertex of the surface."""
    triangles: Int[np.ndarray, "t 3"]
    """Coarse vertices of each triangle."""
    part: Int[np.ndarray, " t"]
    """Part of the mesh of each triangle."""
    is_ring: Bool[np.ndarray, " n"]
    """True for nodes that close around a tube: no triangle has them."""

    @property
    def node_position(self) -> Float[np.ndarray, "n 3"]:
        """Position of each node, the mean of its coarse vertices [m]."""
        total = np.bincount(self.node)
        return summed_rows(self.node, self.position, len(total)) / total[:, None]


class DividedSurface(NamedTuple):
    """Nodes of a surface, and the coarse surface that they span."""

    node: Int[np.ndarray, " v"]
    """Node of each vertex of the surface."""
    coarse: CoarseSurface


def divided_surface(
    surface: Surface, node: Int[np.ndarray, " v"], pitch: float
) -> DividedSurface:
    """Span the coarse surface of some nodes, with more of them where a border needs it.

    Where a border has fewer nodes than the surface next to it, a triangle at the border
    is obtuse, and its conductances cannot all be positive.
    """
    coarse = _coarse_surface(surface, node)
    for _ in range(_MAX_BORDER_ROUNDS):
        ends = [np.zeros((0, 2), np.int64)]
        feet = [np.zeros((0, 3))]
        for part in np.unique(coarse.part):
            triangles = coarse.triangles[coarse.part == part]
            new = obtuse_feet(coarse.position, triangles)
            gaps = coarse.position[new.ends] - new.position[:, None]
            is_apart = np.linalg.norm(gaps, axis=2).min(1) > _MIN_GAP * pitch
            ends.append(coarse.node[new.ends[is_apart]])
            feet.append(new.position[is_apart])
        finer = with_border_nodes(
            surface,
            node,
            position=coarse.node_position,
            ends=np.concatenate(ends),
            feet=np.concatenate(feet),
        )
        if finer.max() <= node.max():
            break
        node = finer
        coarse = _coarse_surface(surface, node)
    return DividedSurface(node=node, coarse=coarse)


def _coarse_surface(surface: Surface, node: Int[np.ndarray, " v"]) -> CoarseSurface:
    position = node_positions(surface, node)
    count = len(position)
    nodes = NodeComplex(surface, node)
    is_ring = nodes.closed
    position[~is_ring] += _rises(nodes, position)[~is_ring]
    narrow = strips(nodes)
    position[narrow.node] = narrow.borders[:, 0]
    position = np.concatenate([position, narrow.borders[:, 1]])
    second = np.full(count, -1)
    second[narrow.node] = count + np.arange(len(narrow.node))
    vertex = np.where(narrow.is_second, second[node], node)
    first, second, third = vertex.take(surface.corners)
    different = np.flatnonzero((first != second) & (second != third) & (third != first))
    # Rings are joined by lines, see `_chain_weights`: a triangle has half their width.
    in_ring = is_ring[node.take(surface.corners.take(different, axis=1))].any(axis=0)
    different = different[~in_ring]
    corners = vertex[surface.proper[different]]
    proper = surface.proper_number[different]
    # The lowest corner first: both sides of a flattened tube stay.
    turn = (corners.argmin(1)[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(corners, turn, axis=1)
    rows = np.concatenate([corners, surface.part[proper, None]], axis=1)
    rows, number = unique_rows(rows)
    vector = surface.area[proper, None] * surface.normal[proper]
    normal = summed_rows(number, vector, len(rows))
    return CoarseSurface(
        position=position,
        node=np.concatenate([np.arange(count), narrow.node]),
        vertex=vertex,
        triangles=_unfolded(position, rows[:, :3], part=rows[:, 3], normal=normal),
        part=rows[:, 3],
        is_ring=is_ring,
    )


def _rises(
    nodes: NodeComplex, position: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Ways of the nodes to points whose distances are those along the surface [m].

    The mean of a curved surface lies below it, and chords are shorter than arcs. With
    the sum S of the area vectors, m = |S|/A, and the mean height h of the planes of the
    triangles over the position, a node moves by h/m along S: chords of equal arcs of a
    circle are then as long as the arcs. Around the edge of a thin body it moves by h,
    as far as the edge is deep.
    """
    total = nodes.vector
    length = np.sqrt(row_dot(total, total))
    mean_height = (nodes.volume - row_dot(position, total)) / nodes.area
    closed = length / nodes.area
    rise = mean_height / np.where(closed > _FOLDED, closed, 1.0)
    return (
        total * np.where(closed > _FLAT, rise / np.maximum(length, 1e-300), 0)[:, None]
    )


def _unfolded(
    position: Float[np.ndarray, "c 3"],
    triangles: Int[np.ndarray, "t 3"],
    *,
    part: Int[np.ndarray, " t"],
    normal: Float[np.ndarray, "t 3"],
) -> Int[np.ndarray, "t 3"]:
    """Flip edges of triangles that lie upside down on a neighbour.

    Args:
        position: positions of the coarse vertices [m].
        triangles: their corners.
        part: part of each triangle; edges between two parts stay.
        normal: normal of the surface that each triangle stands for.
    """
    triangles = triangles.copy()
    for _ in range(_MAX_FLIPS):
        turned = triangle_normals(position[triangles])
        folded = row_dot(turned, normal) < 0
        if not folded.any():
            break
        edges = edges_of(triangles)
        pairs = np.concatenate([edges.pairs, edges.pairs[:, ::-1]])
        pairs = pairs[folded[pairs[:, 0] // 3]]
        own = pairs[:, 0] // 3
        neighbour = pairs[:, 1] // 3
        a = edges.start[pairs[:, 0]]
        b = edges.end[pairs[:, 0]]
        c = triangles[own, (pairs[:, 0] + 2) % 3]
        d = triangles[neighbour, (pairs[:, 1] + 2) % 3]
        first = np.stack([a, d, c], axis=1)
        second = np.stack([d, b, c], axis=1)
        valid = (edges.start[pairs[:, 1]] == b) & (c != d)
        valid &= part[own] == part[neighbour]
        mean = normal[own] + normal[neighbour]
        for new in (first, second):
            valid &= row_dot(triangle_normals(position[new]), mean) > 0
        candidates = np.flatnonzero(valid)
        ends = np.stack([c[candidates], d[candidates]], axis=1)
        candidates = candidates[~edges.joins(ends)]
        # Each triangle is flipped once in a round.
        for triangle in (own, neighbour):
            _, earliest = np.unique(triangle[candidates], return_index=True)
            candidates = candidates[np.sort(earliest)]
        both = np.intersect1d(own[candidates], neighbour[candidates])
        candidates = candidates[~np.isin(own[candidates], both)]
        if not len(candidates):
            break
        triangles[own[candidates]] = first[candidates]
        triangles[neighbour[candidates]] = second[candidates]
    return triangles


def surface_links(
    surface: Surface, node: Int[np.ndarray, " v"], coarse: CoarseSurface
) -> SheetLinks:
    """Conductances between nodes along the surface of each part."""
    count = int(node.max()) + 1
    parts = int(surface.part.max()) + 1
    keys = []
    weights = []
    for number in np.unique(surface.part):
        triangles = coarse.triangles[coarse.part == number]
        pairs = triangle_weights(coarse.position, triangles)
        src = coarse.node[pairs.src]
        dst = coarse.node[pairs.dst]
        chain = _chain_weights(surface, node, coarse=coarse, part=int(number))
        first = np.concatenate([src, chain[0]])
        second = np.concatenate([dst, chain[1]])
        pair = np.minimum(first, second) * count + np.maximum(first, second)
        keys.append((pair * parts + number)[first != second])
        weight = np.concatenate([pairs.weight, chain[2]])
        weights.append(weight[first != second])
    key, entry = np.unique(np.concatenate(keys), return_inverse=True)
    weight = np.bincount(entry, np.concatenate(weights), len(key))
    pair = key // parts
    return SheetLinks(
        src=pair // count, dst=pair % count, part=key % parts, weight=weight
    )


def _chain_weights(
    surface: Surface,
    node: Int[np.ndarray, " v"],
    *,
    coarse: CoarseSurface,
    part: int,
) -> tuple[Int[np.ndarray, " l"], Int[np.ndarray, " l"], Float[np.ndarray, " l"]]:
    """Pairs of nodes that no coarse triangle joins, and their conductances [-].

    The line between two nodes runs through the middles of edges. Its length at right
    angles to their distance l, over l, is the conductance between them.
    """
    count = int(node.max()) + 1
    first, second, third = node[surface.faces.T]
    is_mixed = ((first != second) | (second != third)) & (surface.part == part)
    mixed = np.flatnonzero(is_mixed)
    faces = surface.faces[mixed]
    normal = surface.normal[mixed]
    corners = node[faces]
    joined = np.sort(coarse.node[coarse.triangles[coarse.part == part]], axis=1)
    known = sorted_union(
        *(joined[:, i] * count + joined[:, j] for i, j in ((0, 1), (0, 2), (1, 2)))
    )
    sources = []
    targets = []
    lines = []
    for apex in range(3):
        base = (apex + 1) % 3
        last = (apex + 2) % 3
        alone = np.flatnonzero(corners[:, base] == corners[:, last])
        end = surface.vertices.take(faces[alone, last], axis=0)
        along = end - surface.vertices.take(faces[alone, base], axis=0)
        sources.append(corners[alone, apex])
        targets.append(corners[alone, base])
        lines.append(np.cross(along, normal[alone]) / 2)
    source = np.concatenate(sources)
    target = np.concatenate(targets)
    line = np.concatenate(lines)
    line = np.where((source < target)[:, None], line, -line)
    key = np.minimum(source, target) * count + np.maximum(source, target)
    alone = ~in_sorted(key, known)
    key, entry = np.unique(key[alone], return_inverse=True)
    line = line[alone]
    across = summed_rows(entry, line, len(key))
    length = np.bincount(entry, row_length(line), len(key))
    src = key // count
    dst = key % count
    position = coarse.node_position
    along = position[dst] - position[src]
    distance = np.linalg.norm(along, axis=1)
    distance = np.maximum(distance, 1e-3 * length)
    # A line that closes or turns back joins its nodes all the same.
    least = np.where(coarse.is_ring[src] | coarse.is_ring[dst], 0.01, 0.25) * length
    width = np.maximum(row_dot(across, along) / distance, least)
    return src, dst, width / distance
