"""Triangles of a sheet with the areas, faces and parts of the mesh they stand for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ..arrays import rank_in_group
from ..geometry.mesh import Edges, edges_of
from ..geometry.vectors import row_dot, unit_vectors


SHARP_TURN = float(np.cos(np.radians(30)))
"""Cosine of the turn from which a border has a corner, and a surface a crease."""

ROUNDING_DIGITS = 9
"""Decimal places in which equal lengths agree, over the largest one."""

ROUNDING = 10.0**-ROUNDING_DIGITS
"""Relative difference of equal lengths, so that rounding decides nothing."""


@dataclass(frozen=True)
class Surface:
    """Welded triangles of a sheet, cut as finely as its nodes need."""

    vertices: Float[np.ndarray, "v 3"]
    """Positions [m]."""
    faces: Int[np.ndarray, "t 3"]
    """Vertices of each triangle. Two may be equal where welding collapsed a face."""
    area: Float[np.ndarray, " t"]
    """Area of the mesh that each triangle stands for [m^2]."""
    origin: Int[np.ndarray, " t"]
    """Face of the mesh that each triangle is a piece of."""
    part: Int[np.ndarray, " t"]
    """Part of the mesh that each triangle belongs to."""
    normal: Float[np.ndarray, "t 3"]
    """Unit normal of the face of the mesh."""

    @cached_property
    def edges(self) -> Edges:
        """Half-edges of the proper faces, as by `edges_of`."""
        return edges_of(self.proper)

    @cached_property
    def proper(self) -> Int[np.ndarray, "p 3"]:
        """Vertices of the proper faces."""
        return self.faces if self.is_proper.all() else self.faces[self.is_proper]

    @cached_property
    def corners(self) -> Int[np.ndarray, "3 p"]:
        """Vertices of the proper faces, contiguous by corner."""
        return np.ascontiguousarray(self.proper.T)

    @cached_property
    def proper_number(self) -> Int[np.ndarray, " p"]:
        """Number of each proper face among all."""
        return np.flatnonzero(self.is_proper)

    @cached_property
    def is_proper(self) -> Bool[np.ndarray, " t"]:
        """False for faces that welding has collapsed: they have areas, but no edges."""
        return proper_faces(self.faces)

    @cached_property
    def joined_vertices(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of vertices that an edge joins, the lower one first; sorted."""
        # Contiguous by columns, which are read one by one.
        return np.stack([self.edges.low, self.edges.high]).T

    @cached_property
    def _joined(self) -> csr_array:
        """Matrix of vertices that an edge joins; rows and columns are sorted."""
        count = len(self.vertices)
        low, high = self.joined_vertices.T
        ends = (np.concatenate([high, low]), np.concatenate([low, high]))
        is_joined = np.ones(len(ends[0]), bool)
        return csr_array((is_joined, ends), shape=(count, count))

    def edges_across(
        self, label: Int[np.ndarray, " v"]
    ) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
        """Ends of the edges between two labels, in both orders.

        Those of one start are sorted by their end.
        """
        low, high = self.joined_vertices.T
        is_across = np.flatnonzero(label[low] != label[high])
        low = low[is_across]
        high = high[is_across]
        return np.concatenate([high, low]), np.concatenate([low, high])

    def edges_from(
        self, vertices: Int[np.ndarray, " m"]
    ) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
        """Some vertices, once for each of their neighbours, and these neighbours."""
        first = self._joined.indptr[vertices]
        count = self._joined.indptr[vertices + 1] - first
        entry = np.repeat(np.arange(len(vertices)), count)
        neighbour = self._joined.indices[first[entry] + rank_in_group(entry)]
        return vertices[entry], neighbour.astype(np.int64)

    @cached_property
    def vertex_area(self) -> Float[np.ndarray, " v"]:
        """A third of the area of the triangles at each vertex [m^2]."""
        return self._corner_sums(self.area / 3)

    @cached_property
    def vertex_vector(self) -> Float[np.ndarray, "v 3"]:
        """A third of the area vectors of the triangles at each vertex [m^2]."""
        third = self.area / 3
        return np.stack(
            [self._corner_sums(third * column) for column in self.normal.T], axis=1
        )

    @cached_property
    def vertex_volume(self) -> Float[np.ndarray, " v"]:
        """A third of area times height over the origin of the triangles there [m^3]."""
        on_plane = self.vertices[self.faces[:, 0]]
        return self._corner_sums(row_dot(on_plane, self.normal) * self.area / 3)

    def _corner_sums(self, values: Float[np.ndarray, " t"]) -> Float[np.ndarray, " v"]:
        """Sum of the values of the triangles at each vertex."""
        return np.bincount(self.faces.ravel(), np.repeat(values, 3), len(self.vertices))

    @cached_property
    def thirds(self) -> Float[np.ndarray, "t 3 3"]:
        """Centroids of the thirds of the triangles nearest to their corners [m]."""
        return corner_thirds(self.vertices, self.faces)

    @cached_property
    def vertex_moment(self) -> Float[np.ndarray, "v 3"]:
        """Sum of area times centroid of the thirds at each vertex [m^3]."""
        return summed_rows(
            self.faces.ravel(),
            self.thirds.reshape(-1, 3),
            len(self.vertices),
            weight=np.repeat(self.area / 3, 3),
        )

    @cached_property
    def border(self) -> Int[np.ndarray, "b 2"]:
        """Ends of the edges of the free border."""
        sides = self.edges.border
        return np.stack([self.edges.start[sides], self.edges.end[sides]], axis=1)

    @cached_property
    def partition_edges(self) -> Int[np.ndarray, "k 2"]:
        """Ends of the edges of three, five, .. faces, one of each edge's sides."""
        edges = self.edges
        first = edges.first[(edges.uses % 2 == 1) & (edges.uses > 1)]
        return np.stack([edges.start[first], edges.end[first]], axis=1)

    @cached_property
    def creases(self) -> Int[np.ndarray, "c 2"]:
        """Ends of the edges of creases, of branches and between parts."""
        edges = self.edges
        pairs = edges.pairs
        triangle = self.proper_number.take(pairs // 3)
        # Pieces of one face of the mesh are in one plane.
        origin = self.origin.take(triangle)
        is_between = np.flatnonzero(origin[:, 0] != origin[:, 1])
        pairs = pairs[is_between]
        triangle = triangle[is_between]
        # Faces of opposite winding run along their edge in the same direction.
        winding = np.where(
            edges.start[pairs[:, 0]] == edges.start[pairs[:, 1]], -1.0, 1.0
        )
        normal = self.normal[triangle]
        cosine = winding * row_dot(normal[:, 0], normal[:, 1])
        part = self.part[triangle]
        sharp = (cosine < SHARP_TURN) | (part[:, 0] != part[:, 1])
        crease = np.concatenate([pairs[sharp, 0], edges.first[edges.uses > 2]])
        ends = np.stack([edges.start[crease], edges.end[crease]], axis=1)
        return ends[ends[:, 0] != ends[:, 1]]

    @cached_property
    def border_corners(self) -> Bool[np.ndarray, " v"]:
        """Flag vertices where the free border turns, branches or ends."""
        return self._turns(self.border)

    @cached_property
    def crease_corners(self) -> Bool[np.ndarray, " v"]:
        """Flag vertices where creases turn, branch or end."""
        return self._turns(self.creases)

    def _turns(self, ends: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " v"]:
        count = len(self.vertices)
        along = unit_vectors(self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]])
        uses = np.bincount(ends.ravel(), minlength=count)
        # Away from the vertex in both edges: straight on, they cancel.
        away = summed_rows(ends[:, 0], along, count)
        away -= summed_rows(ends[:, 1], along, count)
        # |a + b|^2 = 2 + 2 cos, which is 2 - 2 cos of the turn.
        turns = row_dot(away, away) > 2 - 2 * SHARP_TURN
        return (uses > 0) & ((uses != 2) | turns)


def corner_thirds(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> Float[np.ndarray, "t 3 3"]:
    """Centroids of the thirds of triangles that are nearest to their corners [m]."""
    # Contiguous by coordinates, which are summed one by one.
    thirds = np.empty((3, len(faces), 3))
    for axis, column in enumerate(vertices.T):
        corner = column.take(faces)
        centroid = (corner[:, 0] + corner[:, 1] + corner[:, 2]) / 3
        np.multiply(corner, 5, out=thirds[axis])
        thirds[axis] += 7 * centroid[:, None]
        thirds[axis] /= 12
    return np.moveaxis(thirds, 0, 2)


def proper_faces(faces: Int[np.ndarray, "t 3"]) -> Bool[np.ndarray, " t"]:
    """Flag faces with three different corners."""
    first, second, third = faces.T
    return (first != second) & (second != third) & (third != first)


def summed_rows(
    entry: Int[np.ndarray, " k"],
    rows: Float[np.ndarray, "k 3"],
    count: int,
    weight: Float[np.ndarray, " k"] | float = 1.0,
) -> Float[np.ndarray, "n 3"]:
    """Sums of the rows of each entry, times their weights."""
    sums = [np.bincount(entry, weight * column, count) for column in rows.T]
    # Counts of nothing are integers to numpy.
    return np.stack(sums, axis=1).astype(np.float64)
