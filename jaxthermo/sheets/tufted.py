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
from .borders import cut_at_feet, encroached_feet, obtuse_feet
from .surface import proper_faces


_DEGENERATE = 1e-10
"""Area of a triangle over its longest edge squared below which it is mollified [-]."""

_MOLLIFY_FACTOR = 1e-9
"""Lengthening of edges that makes a proper triangle of a degenerate one [-]."""

_MAX_ROUNDS = 40
"""Rounds of cuts of the border."""


class PairWeights(NamedTuple):
    """Conductances between pairs of vertices, over that of a square of the sheet."""

    src: Int[np.ndarray, " l"]
    dst: Int[np.ndarray, " l"]
    """Larger than `src`."""
    weight: Float[np.ndarray, " l"]
    """Conductance over the product of conductivity and thickness [-]; positive."""


class _Tufted(NamedTuple):
    """Triangles whose borders the Laplacian keeps."""

    vertices: Float[np.ndarray, "w 3"]
    """Positions [m]: those that were given, and then feet on the border."""
    faces: Int[np.ndarray, "u 3"]
    origin: Int[np.ndarray, " u"]
    """Triangle that each one is a piece of."""
    laplacians: dict[int, csr_array]
    """That of each part, see `vertex_laplacian`."""


def with_cut_borders(
    vertices: Float[np.ndarray, "v 3"],
    *,
    faces: Int[np.ndarray, "t 3"],
    part: Int[np.ndarray, " t"],
) -> _Tufted:
    """Cut the edges of the border of each part that its Laplacian would lose."""
    origin = np.arange(len(faces))
    for remaining in reversed(range(_MAX_ROUNDS + 1)):
        laplacians = {}
        for number in np.unique(part):
            chosen = faces[part[origin] == number]
            chosen = chosen[proper_faces(chosen)]
            feet = obtuse_feet(vertices, chosen)
            if not (len(feet.ends) and remaining):
                laplacian = vertex_laplacian(vertices, chosen)
                feet = encroached_feet(vertices, chosen, laplacian)
                laplacians[int(number)] = laplacian
            if len(feet.ends) and remaining:
                break
        else:
            break
        faces, origin = cut_at_feet(
            faces, origin=origin, feet=feet, first_vertex=len(vertices)
        )
        vertices = np.concatenate([vertices, feet.position])
    return _Tufted(vertices=vertices, faces=faces, origin=origin, laplacians=laplacians)


def triangle_weights(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> PairWeights:
    """Conductances between the corners of triangles; borders are adiabatic."""
    faces = faces[proper_faces(faces)]
    if not len(faces):
        nothing = np.zeros(0, np.int64)
        return PairWeights(src=nothing, dst=nothing, weight=np.zeros(0))
    cut = with_cut_borders(vertices, faces=faces, part=np.zeros(len(faces), np.int64))
    entries = coo_array(without_capacity(cut.laplacians[0], len(vertices)))
    src, dst = entries.coords
    conductance = np.asarray(entries.data, np.float64)
    # Rounding leaves conductances of 1e-17 of either sign at right angles.
    counted = (src < dst) & (conductance > 1e-12)
    order = np.lexsort([dst[counted], src[counted]])
    return PairWeights(
        src=src[counted][order].astype(np.int64),
        dst=dst[counted][order].astype(np.int64),
        weight=conductance[counted][order],
    )


def vertex_laplacian(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> csr_array:
    """Laplacian of the tufted cover [-]: minus the conductances off its diagonal."""
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


def without_capacity(laplacian: Any, count: int) -> csr_array:
    """Conductances after the elimination of all vertices but the first ones.

    Those store no heat: what flows in flows out. The Schur complement has no negative
    conductance either.

    Args:
        laplacian: symmetric matrix with rows that add up to 0.
        count: number of vertices that stay.
    """
    weights = _positive(-laplacian)
    total = weights.shape[0]
    waits = np.arange(total) >= count
    # In a random order few of equal degree wait for a neighbour.
    tie = np.random.default_rng(0).permutation(total)
    while waits.any():
        row, column = coo_array(weights).coords
        # Those with few neighbours first: each joins all of its neighbours.
        priority = np.bincount(row, minlength=total) * total + tie
        both = waits[row] & waits[column]
        first = np.full(total, np.iinfo(np.int64).max)
        np.minimum.at(first, row[both], priority[column[both]])
        eliminated = np.flatnonzero(waits & (priority < first))
        coupling = csr_array(weights[eliminated])
        sums = coupling.sum(axis=1)
        inverse = diags_array(1 / np.where(sums > 0, sums, 1.0))
        remains = np.ones(total)
        remains[eliminated] = 0
        mask = diags_array(remains)
        weights = _positive(mask @ (weights + coupling.T @ inverse @ coupling) @ mask)
        waits[eliminated] = False
    return csr_array(weights[:count, :count])


def _positive(weights: Any) -> Any:
    """Positive entries off the diagonal."""
    entries = coo_array(weights)
    row, column = entries.coords
    counted = (row != column) & (entries.data > 0)
    return csr_array(
        (entries.data[counted], (row[counted], column[counted])), shape=entries.shape
    )
