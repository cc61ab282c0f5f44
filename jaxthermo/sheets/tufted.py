"""Conductances of triangles by the Laplacian of their tufted cover.

The Laplacian of linear finite elements on the intrinsic Delaunay triangulation of the
tufted cover has no negative conductance, whatever the triangles: needles, borders,
edges in which three and more of them meet. Source: Sharp and Crane, "A Laplacian for
nonmanifold triangle meshes" (2020).
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from robust_laplacian import mesh_laplacian
from scipy.sparse import coo_array, csr_array, diags_array

from ..geometry.vectors import triangle_normals
from .split import split_obtuse_borders


_DEGENERATE = 1e-10
"""Area of a triangle over its longest edge squared below which it is mollified [-]."""

_MOLLIFY_FACTOR = 1e-9
"""Lengthening of edges that makes a proper triangle of a degenerate one [-]."""


class PairWeights(NamedTuple):
    """Conductances between pairs of vertices, over that of a square of the sheet."""

    src: Int[np.ndarray, " l"]
    dst: Int[np.ndarray, " l"]
    """Larger than `src`."""
    weight: Float[np.ndarray, " l"]
    """Conductance over the product of conductivity and thickness [-]; positive."""


def triangle_weights(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> PairWeights:
    """Conductances between the corners of triangles; borders are adiabatic."""
    if not len(faces):
        nothing = np.zeros(0, np.int64)
        return PairWeights(src=nothing, dst=nothing, weight=np.zeros(0))
    count = len(vertices)
    points, cut_faces, _ = split_obtuse_borders(
        vertices, faces=faces, origin=np.arange(len(faces))
    )
    laplacian = without_capacity(_laplacian(points, cut_faces), count)
    entries = coo_array(laplacian)
    src, dst = entries.coords
    conductance = -np.asarray(entries.data, np.float64)
    # Rounding leaves conductances of 1e-17 of either sign at right angles.
    counted = (src < dst) & (conductance > 1e-12)
    order = np.lexsort([dst[counted], src[counted]])
    return PairWeights(
        src=src[counted][order].astype(np.int64),
        dst=dst[counted][order].astype(np.int64),
        weight=conductance[counted][order],
    )


def _laplacian(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> csr_array:
    used, corners = np.unique(faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    triangles = vertices[faces]
    edges = triangles - np.roll(triangles, 1, axis=1)
    square = (edges**2).sum(2).max(1)
    area = np.linalg.norm(triangle_normals(triangles), axis=1) / 2
    is_degenerate = (area < _DEGENERATE * square).any()
    # Mollifying lengthens all edges: only where it must be.
    factor = _MOLLIFY_FACTOR if is_degenerate else 0.0
    matrix, _ = mesh_laplacian(vertices[used], corners, mollify_factor=factor)
    matrix = coo_array(matrix)
    row, column = matrix.coords
    shape = (len(vertices), len(vertices))
    return csr_array((matrix.data, (used[row], used[column])), shape=shape)


def without_capacity(laplacian: Any, count: int) -> Any:
    """Eliminate all vertices but the first ones, which store no heat.

    The Schur complement has no negative conductance either.
    """
    while laplacian.shape[0] > count:
        total = laplacian.shape[0]
        candidates = np.arange(count, total)
        # Vertices that no earlier candidate is linked to are eliminated together.
        block = coo_array(laplacian[count:, count:])
        row, column = block.coords
        waits = np.zeros(len(candidates), bool)
        waits[row[(column < row) & (block.data != 0)]] = True
        chosen = candidates[~waits]
        remaining = np.concatenate([np.arange(count), candidates[waits]])
        diagonal = laplacian.diagonal()[chosen]
        inverse = diags_array(1 / np.where(diagonal > 0, diagonal, 1.0))
        coupling = laplacian[remaining][:, chosen]
        reduced = laplacian[remaining][:, remaining]
        laplacian = csr_array(reduced - coupling @ inverse @ coupling.T)
    return laplacian
