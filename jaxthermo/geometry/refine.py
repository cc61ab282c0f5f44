"""Refinement of triangles until all edges are short, without gaps between them."""

import numpy as np
from jaxtyping import Float, Int


# Corners of the triangles that replace one, by the number of its edges that are cut:
# 0, 1, 2 are its corners, edge e from corner e to the next one has its middle at 3 + e.
# Edges are rotated so that of one cut it is edge 0, of two the edges 0 and 1.
_PIECES = {
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}


def refine_edges(
    vertices: Float[np.ndarray, "v k"], faces: Int[np.ndarray, "f 3"], longest: float
) -> tuple[Float[np.ndarray, "w k"], Int[np.ndarray, "g 3"], Int[np.ndarray, " g"]]:
    """Cut edges in the middle until none is longer than a length.

    Neighbours are cut at the same points: a field over the vertices stays continuous.

    Args:
        vertices: positions in the first three columns [m]; others, such as normals, are
            interpolated.
        faces: of the mesh.
        longest: length [m].

    Returns:
        Vertices, of which the first are the given ones, faces, and the given face that
        each is a part of.
    """
    parent = np.arange(len(faces))
    while True:
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
        along = vertices[ends[..., 1], :3] - vertices[ends[..., 0], :3]
        cut = np.einsum("fei,fei->fe", along, along) > longest**2
        if not cut.any():
            return vertices, faces, parent
        # The same for both sides of an edge, whatever its direction.
        pairs = np.sort(ends[cut], axis=-1)
        edges, number = np.unique(pairs, axis=0, return_inverse=True)
        middle = np.full(cut.shape, -1)
        middle[cut] = len(vertices) + number.ravel()
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        faces, parent = _cut_faces(faces, middle, parent)


def _cut_faces(
    faces: Int[np.ndarray, "f 3"],
    middle: Int[np.ndarray, "f 3"],
    parent: Int[np.ndarray, " f"],
) -> tuple[Int[np.ndarray, "g 3"], Int[np.ndarray, " g"]]:
    cut = middle >= 0
    count = cut.sum(axis=1)
    new, of = [faces[count == 0]], [parent[count == 0]]
    for number, pieces in _PIECES.items():
        here = np.flatnonzero(count == number)
        # With one edge cut it comes first; with two the one that is not comes last.
        first = np.argmax(cut[here], axis=1)
        if number == 2:
            first = (np.argmin(cut[here], axis=1) + 1) % 3
        turned = (first[:, None] + np.arange(3)) % 3
        take = lambda rows, here=here, turned=turned: np.take_along_axis(
            rows[here], turned, axis=1
        )
        points = np.concatenate([take(faces), take(middle)], axis=1)
        new += [points[:, list(piece)] for piece in pieces]
        of += [parent[here]] * len(pieces)
    return np.concatenate(new), np.concatenate(of)
