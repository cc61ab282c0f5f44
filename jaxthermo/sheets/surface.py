"""Triangles of a sheet with the areas, faces and parts of the mesh they stand for."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ..arrays import rank_in_group
from ..geometry.mesh import edges_of
from ..geometry.vectors import row_dot, unit_vectors


SHARP_TURN = float(np.cos(np.radians(30)))
"""Cosine of the turn from which a border has a corner, and a surface a crease."""


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
    def edges(self) -> Any:
        """Half-edges of the proper faces, as by `edges_of`."""
        return edges_of(self.faces[self.is_proper])

    @cached_property
    def is_proper(self) -> Bool[np.ndarray, " t"]:
        """False for faces that welding has collapsed: they have areas, but no edges."""
        return proper_faces(self.faces)

    @cached_property
    def _first_sides(self) -> Int[np.ndarray, " e"]:
        """First half-edge of each edge."""
        first = np.empty(len(self.edges.uses), np.int64)
        # Written from the last to the first: the first stays.
        first[self.edges.edge[::-1]] = np.arange(len(self.edges.edge))[::-1]
        return first

    @cached_property
    def joined_vertices(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of vertices that an edge joins, the lower one first; sorted."""
        start = self.edges.start[self._first_sides]
        end = self.edges.end[self._first_sides]
        # Contiguous by columns, which are read one by one.
        return np.stack([np.minimum(start, end), np.maximum(start, end)]).T

    @cached_property
    def _joined(self) -> csr_array:
        """Matrix of vertices that an edge joins; rows and columns are sorted."""
        count = len(self.vertices)
        low, high = self.joined_vertices.T
        ends = (np.concatenate([high, low]), np.concatenate([low, high]))
        is_joined = np.ones(len(ends[0]), bool)
        return csr_array((is_joined, ends), shape=(count, count))

    @cached_property
    def neighbours(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of vertices that an edge joins, in both orders; sorted."""
        degree = np.diff(self._joined.indptr)
        start = np.repeat(np.arange(len(self.vertices)), degree)
        return np.stack([start, self._joined.indices]).T

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
        corners = self.faces.ravel()
        return np.bincount(corners, np.repeat(self.area / 3, 3), len(self.vertices))

    @cached_property
    def vertex_vector(self) -> Float[np.ndarray, "v 3"]:
        """A third of the area vectors of the triangles at each vertex [m^2]."""
        third = self.area[:, None] / 3 * self.normal
        corners = self.faces.ravel()
        return summed_rows(corners, np.repeat(third, 3, axis=0), len(self.vertices))

    @cached_property
    def vertex_volume(self) -> Float[np.ndarray, " v"]:
        """A third of area times height over the origin of the triangles there [m^3]."""
        on_plane = self.vertices[self.faces[:, 0]]
        third = row_dot(on_plane, self.normal) * self.area / 3
        return np.bincount(self.faces.ravel(), np.repeat(third, 3), len(self.vertices))

    @cached_property
    def thirds(self) -> Float[np.ndarray, "t 3 3"]:
        """Centroids of the thirds of the triangles nearest to their corners [m]."""
        return corner_thirds(self.vertices[self.faces])

    @cached_property
    def vertex_moment(self) -> Float[np.ndarray, "v 3"]:
        """Sum of area times centroid of the thirds at each vertex [m^3]."""
        moment = np.repeat(self.area / 3, 3)[:, None] * self.thirds.reshape(-1, 3)
        return summed_rows(self.faces.ravel(), moment, len(self.vertices))

    @cached_property
    def border(self) -> Int[np.ndarray, "b 2"]:
        """Ends of the edges of the free border."""
        alone = self.edges.uses[self.edges.edge] == 1
        return np.stack([self.edges.start[alone], self.edges.end[alone]], axis=1)

    @cached_property
    def partition_edges(self) -> Int[np.ndarray, "k 2"]:
        """Ends of the edges of three, five, .. faces, one of each edge's sides."""
        edges = self.edges
        first = self._first_sides[(edges.uses % 2 == 1) & (edges.uses > 1)]
        return np.stack([edges.start[first], edges.end[first]], axis=1)

    @cached_property
    def creases(self) -> Int[np.ndarray, "c 2"]:
        """Ends of the edges of creases, of branches and between parts."""
        edges = self.edges
        last = np.empty(len(edges.uses), np.int64)
        last[edges.edge] = np.arange(len(edges.edge))
        pairs = np.stack([self._first_sides, last], axis=1)[edges.uses == 2]
        # Faces of opposite winding run along their edge in the same direction.
        winding = np.where(
            edges.start[pairs[:, 0]] == edges.start[pairs[:, 1]], -1.0, 1.0
        )
        normal = self.normal[self.is_proper][pairs // 3]
        cosine = winding * row_dot(normal[:, 0], normal[:, 1])
        part = self.part[self.is_proper][pairs // 3]
        sharp = (cosine < SHARP_TURN) | (part[:, 0] != part[:, 1])
        crease = np.concatenate([pairs[sharp, 0], self._first_sides[edges.uses > 2]])
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


def corner_thirds(triangles: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3 3"]:
    """Centroids of the thirds of triangles that are nearest to their corners [m]."""
    centroid = triangles.mean(axis=1, keepdims=True)
    return (5 * triangles + 7 * centroid) / 12


def proper_faces(faces: Int[np.ndarray, "t 3"]) -> Bool[np.ndarray, " t"]:
    """Flag faces with three different corners."""
    return (faces != np.roll(faces, 1, axis=1)).all(1)


def summed_rows(
    entry: Int[np.ndarray, " k"], rows: Float[np.ndarray, "k 3"], count: int
) -> Float[np.ndarray, "n 3"]:
    """Sums of the rows of each entry."""
    sums = [np.bincount(entry, column, count) for column in rows.T]
    # Counts of nothing are integers to numpy.
    return np.stack(sums, axis=1).astype(np.float64)
