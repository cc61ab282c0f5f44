"""Cuts of triangles: in the middle of long edges, and before the tufted Laplacian."""

import numpy as np
from jaxtyping import Float, Int

from ..geometry.mesh import edges_of
from ..geometry.refine import cut_faces
from ..geometry.vectors import row_dot


def split_long_edges(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    origin: Int[np.ndarray, " t"],
    longest: float,
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "u 3"], Int[np.ndarray, " u"]]:
    """Cut the longest edge of each triangle until none is longer than a length [m].

    The middle of an edge is one vertex for all its triangles, whatever their number. A
    long thin triangle ends in pieces about as long as `longest`, not in ones about as
    long as it is wide.
    """
    while True:
        edges = edges_of(faces)
        along = vertices[edges.end] - vertices[edges.start]
        length = np.linalg.norm(along, axis=1)
        # Equal edges of one triangle: the same one for both triangles at it.
        rank = np.lexsort([edges.edge, length])
        height = np.empty(len(rank), np.int64)
        height[rank] = np.arange(len(rank))
        side = np.arange(len(faces)) * 3 + height.reshape(-1, 3).argmax(1)
        cut = np.unique(edges.edge[side[length[side] > longest]])
        if not len(cut):
            return vertices, faces, origin
        middle = np.full(len(edges.uses), -1)
        middle[cut] = len(vertices) + np.arange(len(cut))
        _, first = np.unique(edges.edge, return_index=True)
        ends = vertices[edges.start[first[cut]]] + vertices[edges.end[first[cut]]]
        vertices = np.concatenate([vertices, ends / 2])
        faces, origin = cut_faces(faces, middle[edges.edge].reshape(-1, 3), origin)


def split_obtuse_borders(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    origin: Int[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "u 3"], Int[np.ndarray, " u"]]:
    """Cut border edges with a corner within their circle, at the foot of the corner.

    The tufted cover would flip such an edge, and the conduction along the border would
    be lost.
    """
    edges = edges_of(faces)
    border = np.flatnonzero(edges.uses[edges.edge] == 1)
    start = vertices[edges.start[border]]
    end = vertices[edges.end[border]]
    apex = vertices[faces[border // 3, (border + 2) % 3]]
    # Rounding makes right angles obtuse.
    cosine = row_dot(start - apex, end - apex)
    scale = np.linalg.norm(start - apex, axis=1) * np.linalg.norm(end - apex, axis=1)
    obtuse = cosine < -1e-9 * scale
    along = (end - start)[obtuse]
    fraction = row_dot(apex[obtuse] - start[obtuse], along) / row_dot(along, along)
    feet = start[obtuse] + fraction[:, None] * along
    middle = np.full(3 * len(faces), -1)
    middle[border[obtuse]] = len(vertices) + np.arange(len(feet))
    faces, origin = cut_faces(faces, middle.reshape(-1, 3), origin)
    return np.concatenate([vertices, feet]), faces, origin
