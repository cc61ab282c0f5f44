"""Surface of a body as a mesh whose vertices have values, as an image shows them.

A vertex on an edge of more than 40 degrees is there once for each side: the sides of a
box have temperatures and normals of their own.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from ...geometry.refine import refine_edges
from ...scene.scene import BodyGeometry
from ..facets import corner_normals
from ..view import smooth_weights


# Longest edge [voxels]: the weights of a point have this radius.
_LONGEST_EDGE = 2.0


class VertexMesh(NamedTuple):
    """Triangles that are about as fine as the voxels, in the frame of their body."""

    vertices: Float[np.ndarray, "v 3"]
    """In the frame of the body [m]."""
    normals: Float[np.ndarray, "v 3"]
    """Outward, of the smooth surface that the mesh approximates."""
    faces: Int[np.ndarray, "f 3"]
    parent: Int[np.ndarray, " f"]
    """Number of the body's triangle that each face belongs to."""
    weights: csr_array
    """Weights [v, s] of the body's fragments at each vertex, those of a pixel there."""

    def values(self, fragments: Float[np.ndarray, " s"]) -> Float[np.ndarray, " v"]:
        """Values at the vertices, interpolated as by an image."""
        return (self.weights @ fragments).astype(np.float32)


def vertex_mesh(
    geometry: BodyGeometry, longest_edge: float | None = None
) -> VertexMesh:
    """Mesh of a body with the weights of its vertices.

    Args:
        geometry: of the body.
        longest_edge: length to which edges are cut [m]; two voxels if None.
    """
    creased = corner_normals(geometry.vertices, geometry.faces)
    columns = np.concatenate(
        [geometry.vertices[creased.vertex], creased.normals], axis=1
    )
    longest = longest_edge or _LONGEST_EDGE * geometry.pitch
    columns, faces, parent = refine_edges(columns, creased.faces, longest)
    vertices = columns[:, :3]
    normals = columns[:, 3:]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(length > 0, length, 1)
    weights = smooth_weights(vertices, normals, geometry)
    return VertexMesh(
        vertices=vertices, normals=normals, faces=faces, parent=parent, weights=weights
    )
