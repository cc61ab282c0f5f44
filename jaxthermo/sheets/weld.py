"""Welding of triangles that were never joined: CAD exports, game meshes, polygon soup.

Vertices closer than a tolerance become one, an edge on which a vertex lies is cut there
(a T-junction), and a face that occurs twice is dropped. Any number of faces may meet in
an edge, with any winding.
"""

from itertools import chain
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from ..arrays import unique_rows
from ..geometry.mesh import Mesh, edges_of
from ..geometry.refine import cut_faces
from ..geometry.vectors import row_dot, row_length, triangle_normals
from .surface import Surface


DEFAULT_WELD = 1e-5
"""Distance within which vertices are welded, over the diagonal of the mesh [-]."""


class WeldedMesh(NamedTuple):
    """Triangles that share their vertices, and what was done to join them."""

    vertices: Float[np.ndarray, "v 3"]
    """Positions [m]; all are corners of faces."""
    faces: Int[np.ndarray, "t 3"]
    """Vertices of each triangle. Two may be equal: its area lies within the weld."""
    face_area: Float[np.ndarray, " t"]
    """Area of the mesh that each triangle stands for [m^2]; welding leaves it."""
    face_origin: Int[np.ndarray, " t"]
    """Face of the mesh that each triangle is a piece of."""
    welded_vertices: int
    """Number of used vertices that were welded to another one."""
    double_faces: int
    """Number of dropped faces with the corners of an earlier face."""
    degenerate_faces: int
    """Number of dropped faces without area."""
    cut_edges: int
    """Number of cuts of edges at a vertex that lies on them."""


def weld_mesh(mesh: Mesh, tolerance: float) -> WeldedMesh:
    """Join the triangles of a mesh.

    Args:
        mesh: any triangles.
        tolerance: distance [m] within which two vertices are one, and a vertex is on an
            edge.
    """
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    # Rounding gives triangles of no area some of it.
    origin = np.flatnonzero(area > 1e-12 * area.max(initial=0))
    used = np.unique(mesh.faces[origin])
    points = mesh.vertices[used].astype(np.float64)
    leader = _leaders(points, tolerance)
    vertices = points[np.unique(leader)]
    number = np.searchsorted(np.unique(leader), leader)
    faces = number[np.searchsorted(used, mesh.faces[origin])]
    faces, origin, cut_edges = _cut_at_vertices(
        vertices, faces=faces, origin=origin, tolerance=tolerance
    )
    piece_area = shared_area(vertices, faces=faces, parent=origin, area=area)
    is_double = _is_double(faces)
    return WeldedMesh(
        vertices=vertices,
        faces=faces[~is_double],
        face_area=piece_area[~is_double],
        face_origin=origin[~is_double],
        welded_vertices=len(used) - len(vertices),
        double_faces=int(is_double.sum()),
        degenerate_faces=int((area <= 1e-12 * area.max(initial=0)).sum()),
        cut_edges=cut_edges,
    )


def shared_area(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    parent: Int[np.ndarray, " t"],
    area: Float[np.ndarray, " f"],
) -> Float[np.ndarray, " t"]:
    """Areas of triangles that add up to those of the faces they are pieces of [m^2].

    Args:
        vertices: positions [m].
        faces: vertices of the pieces.
        parent: face that each one is a piece of.
        area: areas of these faces [m^2], which welding may have changed.
    """
    weight = row_length(triangle_normals(vertices.take(faces, axis=0)))
    total = np.bincount(parent, weight, len(area))
    # A face that has collapsed into a line or a point: equal shares.
    weight = np.where(total[parent] > 0, weight, 1.0)
    total = np.bincount(parent, weight, len(area))
    return area[parent] * weight / total[parent]


def _leaders(
    points: Float[np.ndarray, "v 3"], tolerance: float
) -> Int[np.ndarray, " v"]:
    """Earlier point within the tolerance that each point is welded to, or itself.

    A leader is its own leader: a chain of points, each near the next one, does not
    collapse into one.
    """
    leader = np.arange(len(points))
    pairs = KDTree(points).query_pairs(tolerance, output_type="ndarray")
    if not len(pairs):
        return leader
    early, late = np.sort(pairs, axis=1).T
    # In the order of the points: those without an undecided earlier neighbour lead.
    is_open = np.zeros(len(points), bool)
    is_open[late] = True
    while is_open.any():
        led = is_open[late] & ~is_open[early] & (leader[early] == early)
        np.minimum.at(leader, late[led], early[led])
        is_open[late[led]] = False
        waiting = np.zeros(len(points), bool)
        waiting[late[is_open[early] & is_open[late]]] = True
        is_open &= waiting
    return leader


def _is_double(faces: Int[np.ndarray, "t 3"]) -> Bool[np.ndarray, " t"]:
    """Flag faces with the corners of an earlier face, in any order."""
    ordered = np.sort(faces, axis=1)
    _, number = unique_rows(ordered)
    _, first = np.unique(number, return_index=True)
    is_double = np.ones(len(faces), bool)
    is_double[first] = False
    # Faces that the weld has collapsed keep their areas.
    return is_double & (np.diff(ordered, axis=1) > 0).all(1)


def _cut_at_vertices(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    origin: Int[np.ndarray, " t"],
    tolerance: float,
) -> tuple[Int[np.ndarray, "u 3"], Int[np.ndarray, " u"], int]:
    """Cut edges at the vertices that lie on them; also returns the number of cuts."""
    cuts = 0
    tree = KDTree(vertices)
    clean = np.zeros((0, 2), np.int64)
    while True:
        edges = edges_of(faces)
        ends = np.stack([edges.low, edges.high], axis=1)
        middle = np.full(len(ends), -1)
        fresh = ~_is_in(ends, clean)
        middle[fresh] = _vertex_on_edges(
            vertices, tree=tree, ends=ends[fresh], tolerance=tolerance
        )
        clean = ends[middle < 0]
        if len(clean) == len(ends):
            return faces, origin, cuts
        cuts += len(ends) - len(clean)
        faces, origin = cut_faces(faces, middle[edges.edge].reshape(-1, 3), origin)


def _is_in(
    rows: Int[np.ndarray, "n 2"], earlier: Int[np.ndarray, "m 2"]
) -> Bool[np.ndarray, " n"]:
    """Flag rows that are among earlier ones."""
    _, number = unique_rows(np.concatenate([earlier, rows]))
    return np.isin(number[len(earlier) :], number[: len(earlier)])


def _vertex_on_edges(
    vertices: Float[np.ndarray, "v 3"],
    *,
    tree: KDTree,
    ends: Int[np.ndarray, "e 2"],
    tolerance: float,
) -> Int[np.ndarray, " e"]:
    """Vertex that lies on each edge, the nearest to its middle; -1 for none."""
    start = vertices[ends[:, 0]]
    along = vertices[ends[:, 1]] - start
    length = row_length(along)
    near = tree.query_ball_point(start + along / 2, length / 2 + tolerance)
    counts = np.array([len(n) for n in near], np.int64)
    edge = np.repeat(np.arange(len(ends)), counts)
    vertex = np.fromiter(chain.from_iterable(near), np.int64, counts.sum())
    offset = vertices.take(vertex, axis=0) - start.take(edge, axis=0)
    square = np.maximum(length[edge] ** 2, np.finfo(float).tiny)
    edge_vector = along.take(edge, axis=0)
    fraction = row_dot(offset, edge_vector) / square
    distance = row_length(offset - fraction[:, None] * edge_vector)
    # Beyond the tolerance from both ends: nearer vertices were welded to them.
    inner = np.minimum(fraction, 1 - fraction) * length[edge]
    lies_on = (distance <= tolerance) & (inner > tolerance)
    lies_on &= (ends[edge, 0] != vertex) & (ends[edge, 1] != vertex)
    edge = edge[lies_on]
    order = np.lexsort([np.abs(fraction[lies_on] - 0.5), edge])
    on_edge = np.full(len(ends), -1)
    # Written from the last to the first: the nearest to the middle stays.
    on_edge[edge[order][::-1]] = vertex[lies_on][order][::-1]
    return on_edge


def open_seams(surface: Surface, distance: float) -> float:
    """Length of the free border that runs within a distance of another border [m].

    Borders of faces that share a vertex are no seam: a corner, or a thin strip.
    """
    if not len(surface.border):
        return 0.0
    start = surface.vertices[surface.border[:, 0]]
    along = surface.vertices[surface.border[:, 1]] - start
    length = row_length(along)
    middle = start + along / 2
    pairs = KDTree(middle).query_pairs(
        length.max() / 2 + distance, output_type="ndarray"
    )
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    corners = surface.proper[surface.edges.border // 3]
    first, second = pairs.T
    is_shared = np.zeros(len(pairs), bool)
    for corner in corners.T:
        for other_corner in corners.T:
            is_shared |= corner[first] == other_corner[second]
    first, second = pairs[~is_shared].T
    offset = middle[first] - start[second]
    fraction = row_dot(offset, along[second]) / row_dot(along, along)[second]
    nearest = np.clip(fraction, 0, 1)[:, None] * along[second]
    is_near = row_length(offset - nearest) <= distance
    return float(length[np.unique(first[is_near])].sum())
