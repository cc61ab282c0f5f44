"""Cuts of triangles until no edge is long, with few pieces of long thin ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..arrays import rank_in_group, sorted_union
from ..geometry.mesh import edges_of
from ..geometry.refine import cut_faces


class SplitMesh(NamedTuple):
    """Triangles with additional vertices, after the given ones."""

    vertices: Float[np.ndarray, "w 3"]
    """Positions [m]."""
    faces: Int[np.ndarray, "u 3"]
    origin: Int[np.ndarray, " u"]
    """Triangle that each one is a piece of."""


def split_long_edges(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], longest: float
) -> SplitMesh:
    """Cut triangles until edges of the mesh are not longer than a length [m].

    A point on an edge is one vertex for all its triangles, whatever their number. The
    longest edge of a triangle is cut in the middle while its shortest one is too long;
    then each edge in equal pieces. A needle ends in pieces as long as `longest`, where
    further cuts in the middle would leave some that are far shorter than it is wide.
    """
    origin = np.arange(len(faces))
    while True:
        edges = edges_of(faces)
        along = vertices[edges.end] - vertices[edges.start]
        length = np.linalg.norm(along, axis=1).reshape(-1, 3)
        # Of equal edges the same one in both triangles at it.
        preference = length * (1 + 1e-9 * (edges.edge % 997).reshape(-1, 3) / 997)
        side = np.arange(len(faces)) * 3 + preference.argmax(1)
        cut = sorted_union(edges.edge[side[length.min(1) > longest]])
        if not len(cut):
            break
        middle = np.full(len(edges.uses), -1)
        middle[cut] = len(vertices) + np.arange(len(cut))
        half_edge = np.zeros(len(edges.uses), np.int64)
        half_edge[edges.edge] = np.arange(len(edges.edge))
        ends = (
            vertices[edges.start[half_edge[cut]]] + vertices[edges.end[half_edge[cut]]]
        )
        vertices = np.concatenate([vertices, ends / 2])
        faces, origin = cut_faces(faces, middle[edges.edge].reshape(-1, 3), origin)
    sliced = _sliced(vertices, faces, longest)
    return sliced._replace(origin=origin[sliced.origin])


def _sliced(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], longest: float
) -> SplitMesh:
    """Divide edges into equal pieces, and triangles along their two longest edges."""
    edges = edges_of(faces)
    half_edge = np.zeros(len(edges.uses), np.int64)
    half_edge[edges.edge] = np.arange(len(edges.edge))
    low = np.minimum(edges.start[half_edge], edges.end[half_edge])
    high = np.maximum(edges.start[half_edge], edges.end[half_edge])
    along = vertices[high] - vertices[low]
    length = np.linalg.norm(along, axis=1)
    # Half as long as elsewhere: a strip has no vertices but those on its borders.
    slices = np.ceil(2 * length / longest).astype(np.int64)
    pieces = np.where(length > (1 + 1e-9) * longest, slices, 1)
    first_point = len(vertices) + np.cumsum(pieces - 1) - (pieces - 1)
    edge = np.repeat(np.arange(len(pieces)), pieces - 1)
    fraction = (rank_in_group(edge) + 1) / pieces[edge]
    points = vertices[low[edge]] + fraction[:, None] * along[edge]
    is_long = (pieces[edges.edge].reshape(-1, 3) > 1).any(1)
    long_face = np.flatnonzero(is_long)
    # From the corner opposite to the shortest edge, which stays.
    sides = edges.edge.reshape(-1, 3)[long_face]
    apex = (length[sides].argmin(1) + 2) % 3
    rows = np.arange(len(long_face))
    corners = faces[long_face]
    chains = []
    for side, far in ((apex, (apex + 1) % 3), ((apex + 2) % 3, (apex + 2) % 3)):
        chains.append(
            _Chain(
                start=corners[rows, apex],
                end=corners[rows, far],
                pieces=pieces[sides[rows, side]],
                first_point=first_point[sides[rows, side]],
            )
        )
    triangles, face = _zipped(chains[0], chains[1])
    return SplitMesh(
        vertices=np.concatenate([vertices, points]),
        faces=np.concatenate([faces[~is_long], triangles]),
        origin=np.concatenate([np.flatnonzero(~is_long), long_face[face]]),
    )


class _Chain(NamedTuple):
    """An edge of each of some triangles, from its first corner on."""

    start: Int[np.ndarray, " t"]
    end: Int[np.ndarray, " t"]
    pieces: Int[np.ndarray, " t"]
    first_point: Int[np.ndarray, " t"]
    """Number of the point next to the end with the lower number."""

    def point(
        self, triangle: Int[np.ndarray, " k"], step: Int[np.ndarray, " k"]
    ) -> Int[np.ndarray, " k"]:
        """Number of the vertex after some pieces."""
        start = self.start[triangle]
        end = self.end[triangle]
        pieces = self.pieces[triangle]
        inner = np.where(start < end, step - 1, pieces - step - 1)
        point = self.first_point[triangle] + inner
        return np.where(step == 0, start, np.where(step == pieces, end, point))


def _zipped(
    first: _Chain, second: _Chain
) -> tuple[Int[np.ndarray, "u 3"], Int[np.ndarray, " u"]]:
    """Triangles between two edges that start in one corner, and their triangle."""
    count = len(first.pieces)
    triangle = np.concatenate(
        [
            np.repeat(np.arange(count), first.pieces),
            np.repeat(np.arange(count), second.pieces),
        ]
    )
    is_first = np.arange(len(triangle)) < first.pieces.sum()
    # rank_in_group needs equal groups side by side, as in each half.
    step = np.concatenate(
        [rank_in_group(triangle[is_first]), rank_in_group(triangle[~is_first])]
    )
    pieces = np.where(is_first, first.pieces[triangle], second.pieces[triangle])
    # The first steps of both edges come first: they make the triangle at the corner.
    progress = np.where(step == 0, 0.0, (step + 1) / pieces)
    order = np.lexsort([~is_first, progress, triangle])
    triangle = triangle[order]
    is_first = is_first[order]
    step = step[order]
    # Steps that the other edge has made before.
    opposite = rank_in_group(triangle) - step
    i = np.where(is_first, step, opposite)
    j = np.where(is_first, opposite, step)
    corners = np.stack(
        [
            first.point(triangle, i),
            np.where(
                is_first,
                first.point(triangle, np.minimum(i + 1, first.pieces[triangle])),
                second.point(triangle, np.minimum(j + 1, second.pieces[triangle])),
            ),
            second.point(triangle, j),
        ],
        axis=1,
    )
    # The first step leaves the corner that both start from.
    proper = i + j > 0
    return corners[proper], triangle[proper]
