"""Cuts of triangles until no edge is long, with few pieces of long thin ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..arrays import rank_in_group, sorted_union
from ..geometry.mesh import edges_of
from ..geometry.refine import cut_faces
from ..geometry.vectors import row_length
from .surface import ROUNDING


_BITS = 32
"""Bits of the number of a vertex."""

_IN_TURN = 1 + ROUNDING * np.arange(3)
"""Factors by which the first of three equal edges is the shortest one [-]."""


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
    then each edge in as few equal pieces as it needs, and in about twice as many along
    the free border. Further cuts in the middle would leave pieces of a needle that are
    far shorter than it is wide.
    """
    origin = np.arange(len(faces))
    wide = _wide_faces(vertices, faces, longest)
    while len(wide.face):
        edges = sorted_union(_edge_keys(faces).ravel())
        keys = _edge_keys(faces[wide.face])
        # Of equal edges the same one in both triangles at it.
        number = np.searchsorted(edges, keys)
        preference = wide.length * (1 + ROUNDING * (number % 997) / 997)
        cut = sorted_union(keys[np.arange(len(keys)), preference.argmax(axis=1)])
        low = cut >> _BITS
        high = cut & ((1 << _BITS) - 1)
        is_end = np.zeros(len(vertices), bool)
        is_end[low] = True
        is_end[high] = True
        # Few triangles have both ends of an edge that is cut, and fewer have the edge.
        ends = [is_end.take(column) for column in faces.T]
        face = np.flatnonzero(np.add.reduce(ends, dtype=np.int8) > 1)
        sides = _edge_keys(faces[face])
        place = np.minimum(np.searchsorted(cut, sides), len(cut) - 1)
        middle = np.where(cut[place] == sides, len(vertices) + place, -1)
        is_cut = (middle >= 0).any(axis=1)
        face = face[is_cut]
        vertices = np.concatenate([vertices, (vertices[low] + vertices[high]) / 2])
        pieces, parent = cut_faces(faces[face], middle[is_cut], origin[face])
        stays = np.ones(len(faces), bool)
        stays[face] = False
        # All wide triangles are cut: those that are wide now are among the pieces.
        wide = _wide_faces(vertices, pieces, longest)
        wide = wide._replace(face=wide.face + (len(faces) - len(face)))
        faces = np.concatenate([faces[stays], pieces])
        origin = np.concatenate([origin[stays], parent])
    sliced = _sliced(vertices, faces=faces, longest=longest)
    return sliced._replace(origin=origin[sliced.origin])


class _WideFaces(NamedTuple):
    """Triangles whose shortest edge is too long."""

    face: Int[np.ndarray, " w"]
    length: Float[np.ndarray, "w 3"]
    """Lengths of the edges from each corner to the next one [m]."""


def _wide_faces(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], longest: float
) -> _WideFaces:
    corners = vertices.take(faces, axis=0)
    along = np.roll(corners, -1, axis=1) - corners
    length = row_length(along.reshape(-1, 3)).reshape(-1, 3)
    # Column by column: numpy is slow along an axis of length three.
    face = np.flatnonzero(np.minimum.reduce(list(length.T)) > (1 + ROUNDING) * longest)
    return _WideFaces(face, length[face])


def _edge_keys(faces: Int[np.ndarray, "t 3"]) -> Int[np.ndarray, "t 3"]:
    """Vertices of the edges from each corner to the next one, as one number each."""
    start = faces.astype(np.int64, copy=False)
    end = np.roll(start, -1, axis=1)
    return np.minimum(start, end) << _BITS | np.maximum(start, end)


def _sliced(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    longest: float,
) -> SplitMesh:
    """Divide edges into equal pieces, and triangles along their two longest edges."""
    edges = edges_of(faces)
    low = vertices.take(edges.low, axis=0)
    along = vertices.take(edges.high, axis=0) - low
    length = row_length(along)
    is_cut = length > (1 + ROUNDING) * longest
    sides = edges.edge.reshape(-1, 3)
    # A narrow strip has no vertices but those on its borders.
    is_border = is_cut & (edges.uses == 1)
    is_fine = np.zeros(len(length), bool)
    is_fine[sides[is_border[sides].any(axis=1)]] = True
    limit = (1 + ROUNDING) * np.where(is_fine, longest / 2, longest)
    pieces = np.where(is_cut, np.ceil(length / limit), 1).astype(np.int64)
    first_point = len(vertices) + np.cumsum(pieces - 1) - (pieces - 1)
    edge = np.repeat(np.arange(len(pieces)), pieces - 1)
    fraction = (rank_in_group(edge) + 1) / pieces[edge]
    points = low[edge] + fraction[:, None] * along[edge]
    is_long = np.logical_or.reduce(list(is_cut[sides].T))
    long_face = np.flatnonzero(is_long)
    # From the corner opposite to the shortest edge, which stays.
    sides = sides[long_face]
    apex = ((length[sides] * _IN_TURN).argmin(1) + 2) % 3
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
    count = first.pieces + second.pieces - 1
    before = np.cumsum(count) - count
    triangle = np.repeat(np.arange(len(count)), count)
    corners = np.empty((len(triangle), 3), np.int64)
    # A step comes after those of the other edge that end nearer to the corner, as parts
    # of their edges; the first steps of both edges make one triangle, at the corner.
    face = np.repeat(np.arange(len(count)), first.pieces)
    i = rank_in_group(face)
    face = face[i > 0]
    i = i[i > 0]
    nearer = -(-(i + 1) * second.pieces[face] // first.pieces[face]) - 1
    j = np.maximum(nearer, 1)
    row = before[face] + i + j - 1
    corners[row, 0] = first.point(face, i)
    corners[row, 1] = first.point(face, i + 1)
    corners[row, 2] = second.point(face, j)
    face = np.repeat(np.arange(len(count)), second.pieces)
    j = rank_in_group(face)
    nearer = (j + 1) * first.pieces[face] // second.pieces[face]
    i = np.where(j > 0, np.maximum(nearer, 1), 1)
    row = before[face] + i + j - 1
    corners[row, 0] = first.point(face, i)
    corners[row, 1] = second.point(face, j + 1)
    corners[row, 2] = second.point(face, j)
    return corners, triangle
