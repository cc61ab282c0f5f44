"""Nodes of a sheet: connected parts of its surface within the cells of a lattice.

1. The triangles are welded, and cut until no edge is longer than half a cell.
2. A node is a connected part of the surface within one cell: two sheets in one cell are
   two nodes. Areas are those of the mesh, exactly.
3. Triangles with corners in three nodes form a coarse surface. Its Laplacian gives the
   conductances (see `tufted`).
4. Each triangle gives each of its corners' nodes a third of its area, with its normal:
   the fragments of one face of the sheet.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import unique_rows
from ..errors import InputError, positive_length
from ..geometry.mesh import Mesh, edges_of
from ..geometry.vectors import row_dot, unit_vectors
from .split import split_long_edges, split_obtuse_borders
from .tufted import PairWeights, triangle_weights
from .weld import DEFAULT_WELD, WeldedMesh, open_seams, shared_area, weld_mesh


_ORIGIN = 0.4877
"""Distance from the lattice's lowest corner to the mesh's [cells].

About a half: flat faces of a box of whole cells run through the middle of cells. No
fraction of two: the middles of edges do not fall on the border between two cells.
"""

_CORNER = np.cos(np.radians(30))
"""Cosine of the turn from which a border has a corner."""

_SEAM = 1e-3
"""Distance of two borders that were perhaps one, over the diagonal of the mesh [-]."""

_MAX_SPREAD = np.cos(np.radians(5))
"""Cosine of the angle within which normals are merged into one fragment."""


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


class SheetFragments(NamedTuple):
    """Pieces of one face of the sheet: one node, one part and nearly one normal."""

    node: Int[np.ndarray, " s"]
    """Node; sorted."""
    position: Float[np.ndarray, "s 3"]
    """Mean position by area [m]."""
    normal: Float[np.ndarray, "s 3"]
    """Unit normal of the front."""
    area: Float[np.ndarray, " s"]
    """Area [m^2]; the areas of a node and part add up to `SheetCells.area`."""
    part: Int[np.ndarray, " s"]
    """Part of the mesh."""
    of_corner: Int[np.ndarray, "t 3"]
    """Fragment of the third of every triangle that is nearest to each corner."""


@dataclass(frozen=True, eq=False)
class SheetCells:
    """Nodes, links and fragments of a surface, before it has a thickness."""

    pitch: float
    """Edge of a cell [m]."""
    position: Float[np.ndarray, "n 3"]
    """Position of each node [m]: on the free border, if it has some of it."""
    area: Float[np.ndarray, "n p"]
    """Area of each node by part of the mesh [m^2]; sums to that of the mesh."""
    links: SheetLinks
    fragments: SheetFragments
    vertices: Float[np.ndarray, "v 3"]
    """Positions of the corners of the triangles [m]."""
    faces: Int[np.ndarray, "t 3"]
    """Vertices of each triangle. Two may be equal where welding collapsed a face."""
    face_area: Float[np.ndarray, " t"]
    """Area of the mesh that each triangle stands for [m^2]."""
    face_origin: Int[np.ndarray, " t"]
    """Face of the mesh that each triangle is a piece of."""
    vertex_node: Int[np.ndarray, " v"]
    """Node of each vertex."""
    border: float
    """Length of the free border [m]; 0 for a closed surface."""
    open_seams: float
    """Length of the free border next to another one that was perhaps the same [m]."""
    welded_vertices: int
    """Number of vertices that were welded to another one."""
    double_faces: int
    """Number of dropped faces with the corners of another face."""
    degenerate_faces: int
    """Number of dropped faces without area."""
    cut_edges: int
    """Number of cuts of edges at a vertex that lies on them."""

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.position)


class _Triangles(NamedTuple):
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]
    area: Float[np.ndarray, " t"]
    origin: Int[np.ndarray, " t"]
    part: Int[np.ndarray, " t"]
    normal: Float[np.ndarray, "t 3"]


def sheet_cells(
    mesh: Mesh,
    *,
    pitch: float | int,
    weld: float | int | None = None,
    nodes: Literal["cells", "vertices"] = "cells",
    face_part: Int[np.ndarray, " f"] | None = None,
) -> SheetCells:
    """Divide a surface into nodes with areas, conductances and fragments.

    Args:
        mesh: any triangles: open, closed, not manifold, or not joined at all.
        pitch: edge of the cells [m].
        weld: distance within which vertices are welded, and edges are cut at vertices
            [m]; by default 1e-5 of the diagonal of the mesh.
        nodes: "cells", or "vertices" for the mesh's own vertices as nodes.
        face_part: part of the mesh that each face belongs to, from 0.

    Raises:
        InputError: for a mesh without area, or lengths that are not positive.
    """
    pitch = positive_length("Sheet(pitch=)", pitch)
    lower, upper = mesh.bounds if len(mesh.faces) else np.zeros((2, 3))
    size = float(np.linalg.norm(upper - lower))
    tolerance = DEFAULT_WELD * size
    if weld is not None:
        tolerance = positive_length("Sheet(weld=)", weld)
    if not mesh.area > 0:
        raise InputError("Sheet(mesh=): its faces have no area: give a surface")
    if face_part is None:
        face_part = np.zeros(len(mesh.faces), np.int64)
    welded = weld_mesh(mesh, tolerance)
    if not len(welded.faces):
        raise InputError(
            f"Sheet(weld={tolerance:g} m): no face is left of a mesh of {size:g} m: "
            "give a shorter length"
        )
    triangles = _split(mesh, welded, face_part=face_part, pitch=pitch, nodes=nodes)
    vertex_node = _vertex_nodes(triangles, lower, pitch=pitch, nodes=nodes)
    position = triangles.vertices
    if nodes == "cells":
        position = _positions(triangles, vertex_node)
    parts = int(face_part.max(initial=0)) + 1
    corner_node = vertex_node[triangles.faces]
    key = corner_node * parts + triangles.part[:, None]
    area = np.bincount(
        key.ravel(), np.repeat(triangles.area / 3, 3), len(position) * parts
    )
    edges = edges_of(triangles.faces)
    along = triangles.vertices[edges.end] - triangles.vertices[edges.start]
    is_border = edges.uses[edges.edge] == 1
    return SheetCells(
        pitch=pitch,
        position=position,
        area=area.reshape(-1, parts),
        links=_links(position, corner_node, triangles.part),
        fragments=_fragments(triangles, corner_node),
        vertices=triangles.vertices,
        faces=triangles.faces,
        face_area=triangles.area,
        face_origin=triangles.origin,
        vertex_node=vertex_node,
        border=float(np.linalg.norm(along[is_border], axis=1).sum()),
        open_seams=open_seams(triangles.vertices, triangles.faces, _SEAM * size),
        welded_vertices=welded.welded_vertices,
        double_faces=welded.double_faces,
        degenerate_faces=welded.degenerate_faces,
        cut_edges=welded.cut_edges,
    )


def _split(
    mesh: Mesh,
    welded: WeldedMesh,
    *,
    face_part: Int[np.ndarray, " f"],
    pitch: float,
    nodes: str,
) -> _Triangles:
    piece = np.arange(len(welded.faces))
    if nodes == "cells":
        vertices, faces, piece = split_long_edges(
            welded.vertices, faces=welded.faces, origin=piece, longest=pitch / 2
        )
    else:
        vertices, faces, piece = split_obtuse_borders(
            welded.vertices, faces=welded.faces, origin=piece
        )
    origin = welded.face_origin[piece]
    return _Triangles(
        vertices=vertices,
        faces=faces,
        area=shared_area(vertices, faces=faces, parent=piece, area=welded.face_area),
        origin=origin,
        part=face_part[origin],
        normal=unit_vectors(mesh.area_vectors)[origin],
    )


def _vertex_nodes(
    triangles: _Triangles,
    lower: Float[np.ndarray, "3"],
    *,
    pitch: float,
    nodes: str,
) -> Int[np.ndarray, " v"]:
    """Number the connected parts of the surface within each cell."""
    count = len(triangles.vertices)
    if nodes == "vertices":
        return np.arange(count)
    cell = np.floor((triangles.vertices - lower) / pitch + _ORIGIN).astype(np.int64)
    _, cell_number = unique_rows(cell)
    edges = edges_of(triangles.faces)
    within = cell_number[edges.start] == cell_number[edges.end]
    ends = (edges.start[within], edges.end[within])
    graph = coo_array((np.ones(len(ends[0]), bool), ends), shape=(count, count))
    _, node = connected_components(graph, directed=False)
    return node.astype(np.int64)


def _positions(
    triangles: _Triangles, vertex_node: Int[np.ndarray, " v"]
) -> Float[np.ndarray, "n 3"]:
    """Positions of the nodes [m].

    The mean of the free border's corners in it, of its free border by length, or of its
    surface by area: the first of these that the node has. With the mean of the surface
    everywhere the border would shrink by half a cell.
    """
    vertices = triangles.vertices
    count = int(vertex_node.max()) + 1
    edges = edges_of(triangles.faces)
    border = np.flatnonzero(edges.uses[edges.edge] == 1)
    ends = np.stack([edges.start[border], edges.end[border]], axis=1)
    along = vertices[ends[:, 1]] - vertices[ends[:, 0]]
    corners = _border_corners(ends, unit_vectors(along), count=len(vertices))
    # Each half of a border edge, and each third of a triangle, is its vertex's.
    half = np.repeat(np.linalg.norm(along, axis=1) / 2, 2)
    middle = vertices[ends].mean(axis=1, keepdims=True)
    half_position = ((vertices[ends] + middle) / 2).reshape(-1, 3)
    corner_points = vertices[triangles.faces]
    third_position = corner_thirds(corner_points)
    position = np.zeros((count, 3))
    for node, weight, points in [
        (
            vertex_node[triangles.faces].ravel(),
            np.repeat(triangles.area / 3, 3),
            third_position.reshape(-1, 3),
        ),
        (vertex_node[ends].ravel(), half, half_position),
        (vertex_node[corners], np.ones(len(corners)), vertices[corners]),
    ]:
        total = np.bincount(node, weight, count)
        has_some = total > 0
        for axis, column in enumerate(points.T):
            sums = np.bincount(node, weight * column, count)
            position[has_some, axis] = sums[has_some] / total[has_some]
    return position


def _border_corners(
    ends: Int[np.ndarray, "b 2"], direction: Float[np.ndarray, "b 3"], *, count: int
) -> Int[np.ndarray, " c"]:
    """Vertices where the free border turns, branches or ends."""
    uses = np.bincount(ends.ravel(), minlength=count)
    # Away from the vertex in both edges: straight on, they cancel.
    away = np.zeros((count, 3))
    np.add.at(away, ends[:, 0], direction)
    np.add.at(away, ends[:, 1], -direction)
    # |a + b|^2 = 2 + 2 cos, which is 2 - 2 cos of the turn.
    turns = row_dot(away, away) > 2 - 2 * _CORNER
    return np.flatnonzero((uses > 0) & ((uses != 2) | turns))


def _links(
    position: Float[np.ndarray, "n 3"],
    corner_node: Int[np.ndarray, "t 3"],
    part: Int[np.ndarray, " t"],
) -> SheetLinks:
    """Conductances between the nodes of the coarse surface of each part."""
    ordered = np.sort(corner_node, axis=1)
    proper = (np.diff(ordered, axis=1) > 0).all(1)
    pairs: list[PairWeights] = []
    parts: list[Int[np.ndarray, " _"]] = []
    for number in np.unique(part):
        chosen = proper & (part == number)
        _, row = unique_rows(ordered[chosen])
        _, first = np.unique(row, return_index=True)
        weights = triangle_weights(position, corner_node[chosen][first])
        pairs.append(weights)
        parts.append(np.full(len(weights.src), number))
    src = np.concatenate([p.src for p in pairs])
    dst = np.concatenate([p.dst for p in pairs])
    link_part = np.concatenate(parts)
    order = np.lexsort([link_part, dst, src])
    return SheetLinks(
        src=src[order],
        dst=dst[order],
        part=link_part[order],
        weight=np.concatenate([p.weight for p in pairs])[order],
    )


def _fragments(
    triangles: _Triangles, corner_node: Int[np.ndarray, "t 3"]
) -> SheetFragments:
    """Merge the thirds of triangles of one node, one part and nearly one normal."""
    parts = int(triangles.part.max()) + 1
    key = (corner_node * parts + triangles.part[:, None]).ravel()
    normal = np.repeat(triangles.normal, 3, axis=0)
    area = np.repeat(triangles.area / 3, 3)
    third = corner_thirds(triangles.vertices[triangles.faces]).reshape(-1, 3)
    fragment = _similar_normals(key, normal)
    count = int(fragment.max()) + 1
    total = np.bincount(fragment, area, count)
    position = np.stack(
        [np.bincount(fragment, area * x, count) / total for x in third.T], axis=1
    )
    mean_normal = np.stack(
        [np.bincount(fragment, area * x, count) for x in normal.T], axis=1
    )
    _, first = np.unique(fragment, return_index=True)
    order = np.argsort(key[first], kind="stable")
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    return SheetFragments(
        node=key[first][order] // parts,
        position=position[order],
        normal=unit_vectors(mean_normal)[order],
        area=total[order],
        part=key[first][order] % parts,
        of_corner=rank[fragment].reshape(-1, 3),
    )


def corner_thirds(triangles: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3 3"]:
    """Centroids of the thirds of triangles that are nearest to their corners [m]."""
    centroid = triangles.mean(axis=1, keepdims=True)
    return (5 * triangles + 7 * centroid) / 12


def _similar_normals(
    key: Int[np.ndarray, " k"], normal: Float[np.ndarray, "k 3"]
) -> Int[np.ndarray, " k"]:
    """Group entries of one key whose normals are within an angle of the first one's."""
    group = np.full(len(key), -1)
    groups = 0
    waiting = np.arange(len(key))
    while len(waiting):
        _, first, number = np.unique(
            key[waiting], return_index=True, return_inverse=True
        )
        leader = waiting[first][number]
        similar = row_dot(normal[waiting], normal[leader]) >= _MAX_SPREAD
        # The leader itself, whatever rounding does to its length.
        similar |= leader == waiting
        group[waiting[similar]] = groups + number[similar]
        groups += len(first)
        waiting = waiting[~similar]
    return group
