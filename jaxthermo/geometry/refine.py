"""Refinement of triangles until all edges are short, without gaps between them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .vectors import row_dot


# Corners of the triangles that replace a triangle, by the number of its cut edges.
# 0, 1, 2 are its corners; edge e, from corner e to the next one, has its middle at
# 3 + e. The triangle is rotated so that edge 0, or edges 0 and 1, are cut.
_PIECES = {
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}


class _RefinedMesh(NamedTuple):
    """Mesh with additional vertices, after the original ones."""

    vertices: Float[np.ndarray, "w k"]
    faces: Int[np.ndarray, "g 3"]
    parent: Int[np.ndarray, " g"]
    """Number of the original face that each face is a piece of."""


def refine_edges(
    vertices: Float[np.ndarray, "v k"], faces: Int[np.ndarray, "f 3"], longest: float
) -> _RefinedMesh:
    """Cut edges in the middle until none is longer than a length.

    Neighbours are cut at the same points: a field over the vertices stays continuous.

    Args:
        vertices: positions in the first three columns [m]; others, such as normals, are
            interpolated.
        faces: vertex numbers of each triangle.
        longest: length [m].
    """
    parent = np.arange(len(faces))
    while True:
        next_corners = np.roll(faces, -1, axis=1)
        ends = np.stack([faces, next_corners], axis=-1)
        along = vertices[next_corners, :3] - vertices[faces, :3]
        cut = row_dot(along, along) > longest**2
        if not cut.any():
            return _RefinedMesh(vertices=vertices, faces=faces, parent=parent)
        # Sorted, so that both faces at an edge have the same pair.
        pairs = np.sort(ends[cut], axis=-1)
        edges, number = np.unique(pairs, axis=0, return_inverse=True)
        middle = np.full(cut.shape, -1)
        middle[cut] = len(vertices) + number.ravel()
        edge_middles = vertices[edges].mean(axis=1)
        vertices = np.concatenate([vertices, edge_middles])
        faces, parent = cut_faces(faces, middle, parent)


def cut_faces(
    faces: Int[np.ndarray, "f 3"],
    middle: Int[np.ndarray, "f 3"],
    parent: Int[np.ndarray, " f"],
) -> tuple[Int[np.ndarray, "g 3"], Int[np.ndarray, " g"]]:
    """Cut triangles at points on their edges; return the pieces and their parents.

    Args:
        faces: vertex numbers of each triangle.
        middle: number of the vertex on the edge from each corner to the next one; -1
            for an edge that stays.
        parent: number that the pieces of each triangle get.
    """
    cut = middle >= 0
    # Column by column: numpy is slow along an axis of length three.
    count = np.add.reduce(list(cut.T))
    new_faces = [faces[count == 0]]
    new_parents = [parent[count == 0]]
    for number, pieces in _PIECES.items():
        refined = np.flatnonzero(count == number)
        # A single cut edge comes first; a single uncut edge comes last.
        first = np.argmax(cut[refined], axis=1)
        if number == 2:
            uncut = np.argmin(cut[refined], axis=1)
            first = (uncut + 1) % 3
        turned = (first[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(faces[refined], turned, axis=1)
        middles = np.take_along_axis(middle[refined], turned, axis=1)
        points = np.concatenate([corners, middles], axis=1)
        new_faces += [points[:, list(piece)] for piece in pieces]
        new_parents += [parent[refined]] * len(pieces)
    return np.concatenate(new_faces), np.concatenate(new_parents)
