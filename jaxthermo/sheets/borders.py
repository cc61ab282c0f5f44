"""Borders that the Laplacian of the tufted cover keeps.

The tufted cover joins the two sides of a surface at its border, and would flip an edge
of the border that has a corner within its circle (whose diameter is the edge): the
conduction along the border would be lost. Such an edge is first cut at the foot of that
corner. The same holds for edges in which three faces and more meet.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array

from ..arrays import in_sorted, rank_in_group
from ..geometry.mesh import edges_of
from ..geometry.refine import cut_faces
from ..geometry.vectors import row_dot
from .weld import DEFAULT_WELD


_RIGHT_ANGLE = -1e-9
"""Cosine from which an angle is obtuse: rounding makes right angles so."""


class BorderFeet(NamedTuple):
    """Points at which edges of the border are to be cut."""

    ends: Int[np.ndarray, "k 2"]
    """Vertices of each edge; no edge occurs twice."""
    position: Float[np.ndarray, "k 3"]
    """Foot of the corner that lies within the circle of the edge [m]."""


def obtuse_feet(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> BorderFeet:
    """Feet on the edges of the border that a face at them is obtuse at."""
    edges = edges_of(faces)
    border = np.flatnonzero(edges.uses[edges.edge] != 2)
    apex = faces[border // 3, (border + 2) % 3]
    ends = np.stack([edges.start[border], edges.end[border]], axis=1)
    return _widest(vertices, ends, apex)


def encroached_feet(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "t 3"],
    laplacian: csr_array,
) -> BorderFeet:
    """Feet on the edges of the border that the Laplacian has lost, or of branches.

    The corner is one that the Laplacian joins to an end of the edge.
    """
    edges = edges_of(faces)
    uses = edges.uses[edges.edge]
    ends = np.stack([edges.start, edges.end], axis=1)[uses != 2]
    branches = uses[uses != 2] > 2
    entries = coo_array(laplacian)
    row, column = entries.coords
    count = len(vertices)
    joined = np.abs(entries.data) > 1e-12
    key = np.sort(row[joined].astype(np.int64) * count + column[joined])
    # Where sheets meet, the Laplacian has the edge of one if it has lost another's.
    is_lost = ~in_sorted(ends[:, 0] * count + ends[:, 1], key)
    ends = ends[is_lost | branches]
    # All neighbours of both ends.
    corner = ends.ravel()
    first = np.searchsorted(key, corner * count)
    counts = np.searchsorted(key, (corner + 1) * count) - first
    entry = np.repeat(np.arange(len(corner)), counts)
    apex = key[np.repeat(first, counts) + rank_in_group(entry)] % count
    pairs = ends[entry // 2]
    outside = (pairs != apex[:, None]).all(1)
    return _widest(vertices, pairs[outside], apex[outside])


def _widest(
    vertices: Float[np.ndarray, "v 3"],
    ends: Int[np.ndarray, "k 2"],
    apex: Int[np.ndarray, " k"],
) -> BorderFeet:
    """Foot of the corner with the widest obtuse angle over each edge."""
    ends = np.sort(ends, axis=1)
    points = vertices[ends] - vertices[apex][:, None]
    length = np.linalg.norm(points, axis=2).prod(axis=1)
    cosine = row_dot(points[:, 0], points[:, 1]) / np.where(length > 0, length, 1.0)
    order = np.lexsort([cosine, ends[:, 1], ends[:, 0]])
    order = order[cosine[order] < _RIGHT_ANGLE]
    is_first = np.ones(len(order), bool)
    is_first[1:] = (np.diff(ends[order], axis=0) != 0).any(1)
    order = order[is_first]
    start = vertices[ends[order, 0]]
    along = vertices[ends[order, 1]] - start
    fraction = -row_dot(points[order, 0], along) / row_dot(along, along)
    position = start + fraction[:, None] * along
    # Feet of feet may approach a point without end, as on branches around a corner.
    piece = np.minimum(fraction, 1 - fraction) * np.linalg.norm(along, axis=1)
    height = np.linalg.norm(position - vertices[apex[order]], axis=1)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    is_apart = np.minimum(piece, height) > DEFAULT_WELD * size
    return BorderFeet(ends=ends[order[is_apart]], position=position[is_apart])


def cut_at_feet(
    faces: Int[np.ndarray, "t 3"],
    *,
    origin: Int[np.ndarray, " t"],
    feet: BorderFeet,
    first_vertex: int,
) -> tuple[Int[np.ndarray, "u 3"], Int[np.ndarray, " u"]]:
    """Cut all faces at some edges; the feet are numbered from `first_vertex`."""
    width = first_vertex
    key = feet.ends[:, 0] * width + feet.ends[:, 1]
    order = np.argsort(key)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    sides = ends[..., 0] * width + ends[..., 1]
    slot = np.minimum(np.searchsorted(key[order], sides), len(key) - 1)
    is_cut: Bool[np.ndarray, "t 3"] = key[order][slot] == sides
    return cut_faces(faces, np.where(is_cut, first_vertex + order[slot], -1), origin)
