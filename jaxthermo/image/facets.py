"""Normals and reflection of the smooth surface that facets approximate.

All fragments of a facet have its normal, and what they receive jumps at its edges:
close up, a ball of a few hundred triangles would look like a cut stone. On facets of
several voxels the irradiation is interpolated between their corners instead
(Gouraud, IEEE Trans. Comput. C-20 (1971) 623), with what varies within the facet kept:

    H(x) = H_f(x) + s sum_c b_c (V_c - F_c),    s = min(1, H_f(x) / sum_c b_c F_c)

H_f is the mean of the facet's fragments near x; V_c and F_c are the means around its
corner c of the smooth surface and of the facet alone, and b_c the barycentric
coordinates of x. The factor s keeps shadows dark. Edges of more than 40 degrees and
plane surfaces have V_c = F_c. The error is of second order in the angle between facets
instead of the first: 1.7 % of the irradiation on average for 20 degrees.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import block_diag, coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ..scene.scene import BodyGeometry
from .fragment_cells import CHUNK, cells_of


# Facets of at least this area [voxel faces] have fragments of their own at every corner
# but the sharpest; smaller ones are smoothed by the weights of the pixels.
_MIN_AREA = 8.0
# Radius of the means around corners and near pixels [voxels].
_CORNER_RADIUS, _RADIUS = 3.0, 2.0
# Normals are the same within a degree, and points on one plane within a quarter voxel.
_COPLANAR = float(np.cos(np.deg2rad(1.0)))
_MAX_OFFSET = 0.25
# Faces that meet at a larger angle form an edge, which shading must not round off. A
# cylinder of 12 sides, 30 degrees apart, still counts as round.
_CREASE_COSINE = float(np.cos(np.deg2rad(40.0)))


class FacetShading(NamedTuple):
    """Weights of the q points that lie on large facets of a curved surface."""

    point: Int[np.ndarray, " q"]
    """Index among all points."""
    own: csr_array
    """Weights [q, s] of H_f."""
    corner: Int[np.ndarray, "q 3"]
    """Rows of `joined` and `alone` of the corners of each point's facet."""
    share: Float[np.ndarray, "q 3"]
    """Barycentric coordinates b_c."""
    joined: csr_array
    """Weights [c, s] of V_c, a row for each corner."""
    alone: csr_array
    """Weights [c, s] of F_c."""


class _Near(NamedTuple):
    """Choice of the fragments that belong to points."""

    radius: float
    """In voxels."""
    cosine: float
    """Least cosine between the normals."""
    offset: float
    """Largest distance from the plane through the point [voxels]."""


_OWN = _Near(_RADIUS, _COPLANAR, _MAX_OFFSET)
_ALONE = _Near(_CORNER_RADIUS, _COPLANAR, _MAX_OFFSET)
_JOINED = _Near(_CORNER_RADIUS, _CREASE_COSINE, np.inf)


def facet_shading(
    points: Float[np.ndarray, "p 3"],
    face: Int[np.ndarray, " p"],
    geometry: BodyGeometry,
) -> FacetShading:
    """Find the points on large facets, which may be none, and their weights.

    Args:
        points: in the frame of the body [m].
        face: number of the triangle of each point.
        geometry: of the body.
    """
    vertices, faces = geometry.vertices, geometry.faces
    shown = np.unique(face)
    area = np.linalg.norm(_area_vectors(vertices[faces[shown]]), axis=1)
    shown = shown[area >= _MIN_AREA * geometry.pitch**2]
    normal = _corner_normals(vertices, faces, shown)
    flat = _unit(_area_vectors(vertices[faces[shown]]))
    curved = np.einsum("ki,kci->kc", flat, normal).min(axis=1) < _COPLANAR
    shown, normal, flat = shown[curved], normal[curved], flat[curved]
    place = vertices[faces[shown]].reshape(-1, 3)
    joined = _weights(place, normal.reshape(-1, 3), geometry, _JOINED)
    alone = _weights(place, flat.repeat(3, axis=0), geometry, _ALONE)
    # A corner too sharp for a fragment has no mean.
    whole = _has_mean(joined) & _has_mean(alone)
    slot = np.full(len(faces), -1)
    slot[shown] = np.where(whole.reshape(-1, 3).all(axis=1), np.arange(len(shown)), -1)
    point = np.flatnonzero(slot[face] >= 0)
    own = _weights(points[point], flat[slot[face[point]]], geometry, _OWN)
    found = _has_mean(own)
    point = point[found]
    return FacetShading(
        point=point,
        own=own[np.flatnonzero(found)],
        corner=3 * slot[face[point]][:, None] + np.arange(3),
        share=_barycentric(vertices[faces[face[point]]], points[point]),
        joined=joined,
        alone=alone,
    )


def _has_mean(weights: csr_array) -> np.ndarray:
    return np.diff(weights.indptr) > 0


def _weights(
    points: np.ndarray, normals: np.ndarray, geometry: BodyGeometry, near: _Near
) -> csr_array:
    """Weights that add up to 1 at every point with a fragment."""
    radius = near.radius * geometry.pitch
    size = len(points), len(geometry.fragment_area)
    if not len(points):
        return csr_array(size)
    cells = cells_of(geometry, radius)
    parts = []
    for first in range(0, len(points), CHUNK):
        chunk = slice(first, first + CHUNK)
        point, normal = points[chunk], normals[chunk]
        owner, fragment, weight = cells.weighted(point, normal)
        away = geometry.fragment_position[fragment] - point[owner]
        height = np.abs(np.einsum("ij,ij->i", away, normal[owner]))
        other = geometry.fragment_normal[fragment]
        kept = np.einsum("ij,ij->i", other, normal[owner]) > near.cosine
        kept &= height <= near.offset * geometry.pitch
        parts.append((owner[kept] + first, fragment[kept], weight[kept]))
    row, fragment, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    total = np.bincount(row, weights=weight, minlength=len(points))
    return csr_array((weight / total[row], (row, fragment)), size)


def joined_shadings(
    shown: list[np.ndarray], parts: list[FacetShading]
) -> FacetShading | None:
    """Concatenate the shadings of bodies, of which each has points of an image.

    The fragments are numbered over all bodies in the result. None without any point.
    """
    if not any(len(part.point) for part in parts):
        return None
    before = np.cumsum([0, *(len(part.joined.indptr) - 1 for part in parts)])
    point = [here[part.point] for here, part in zip(shown, parts, strict=True)]
    corner = [part.corner + n for part, n in zip(parts, before[:-1], strict=True)]
    return FacetShading(
        point=np.concatenate(point),
        own=_blocks([part.own for part in parts]),
        corner=np.concatenate(corner),
        share=np.concatenate([part.share for part in parts]),
        joined=_blocks([part.joined for part in parts]),
        alone=_blocks([part.alone for part in parts]),
    )


def _blocks(parts: list[csr_array]) -> csr_array:
    return csr_array(block_diag(parts, format="csr"))


def smooth_normals(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    face: Int[np.ndarray, " p"],
    points: Float[np.ndarray, "p 3"],
) -> Float[np.ndarray, "p 3"]:
    """Outward normals of the smooth surface that the triangles approximate.

    Interpolated in each triangle between its corners. The normal at a corner is the
    mean over the faces around it that edges of less than 40 degrees connect, weighted
    by their angles there, which makes it independent of how quads are cut in two
    (Thuermer and Wuethrich, J. Graphics Tools 3 (1998) 43).

    Args:
        vertices: of the mesh [m].
        faces: of the mesh.
        face: number of the triangle of each point.
        points: on the triangles [m].
    """
    shown, row = np.unique(face, return_inverse=True)
    corner = _corner_normals(vertices, faces, shown)[row]
    triangle = vertices[faces[face]]
    weight = _barycentric(triangle, points)
    normal = _unit(np.einsum("pi,pij->pj", weight, corner))
    flat = _unit(_area_vectors(triangle))
    # A degenerate triangle has no normal, and no pixel that could show it.
    ahead = np.einsum("pi,pi->p", normal, flat) > 0
    return np.where(ahead[:, None], normal, flat)


def _corner_normals(
    vertices: np.ndarray, faces: np.ndarray, shown: np.ndarray
) -> Float[np.ndarray, "k 3 3"]:
    """Normal at each corner of some faces [k, corner, 3]."""
    if not len(shown):
        return np.empty((0, 3, 3))
    touched = np.zeros(len(vertices), bool)
    touched[faces[shown]] = True
    near = np.flatnonzero(touched[faces].any(axis=1))
    normal = _unit(_area_vectors(vertices[faces[near]]))
    # Corner 3 f + i of face f; those of one group have one normal.
    group = _joined_corners(faces[near], normal)
    angle = _corner_angles(vertices[faces[near]]).ravel()
    weighted = normal.repeat(3, axis=0) * angle[:, None]
    total = [np.bincount(group, column) for column in weighted.T]
    smooth = _unit(np.stack(total, axis=1))[group].reshape(-1, 3, 3)
    return smooth[np.searchsorted(near, shown)]


def _joined_corners(
    faces: Int[np.ndarray, "f 3"], normal: Float[np.ndarray, "f 3"]
) -> Int[np.ndarray, " c"]:
    """Number of the group of each corner: those that edges without crease connect."""
    # The edge of corner 3 f + i runs from it to the next corner of its face.
    here = np.arange(faces.size)
    ahead = here - here % 3 + (here + 1) % 3
    ends = np.stack([faces.ravel()[here], faces.ravel()[ahead]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    order = np.lexsort([high, low])
    one, other = order[:-1], order[1:]
    cosine = np.einsum("ij,ij->i", normal[one // 3], normal[other // 3])
    joined = (low[one] == low[other]) & (high[one] == high[other])
    joined &= cosine > _CREASE_COSINE
    one, other = one[joined], other[joined]
    # The same corners of both faces: neighbours run along their edge in opposite ways.
    flip = ends[0, one] != ends[0, other]
    there = np.where(flip, ahead[other], other), np.where(flip, other, ahead[other])
    pairs = np.concatenate([one, ahead[one]]), np.concatenate(there)
    size = faces.size
    graph = coo_array((np.ones(len(pairs[0]), bool), pairs), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _corner_angles(triangles: np.ndarray) -> Float[np.ndarray, "f 3"]:
    ahead = _unit(np.roll(triangles, -1, axis=1) - triangles)
    behind = _unit(np.roll(triangles, 1, axis=1) - triangles)
    return np.arccos(np.clip(np.einsum("fij,fij->fi", ahead, behind), -1.0, 1.0))


def _area_vectors(triangles: np.ndarray) -> Float[np.ndarray, "f 3"]:
    """Normals of triangles, of the length of their areas [m^2]."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1; 0 of those without a length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def _barycentric(
    triangles: Float[np.ndarray, "p 3 3"], points: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, "p 3"]:
    """Barycentric coordinates of points on triangles."""
    # Areas of the triangles that the point forms with each edge, along the normal.
    whole = _area_vectors(triangles)
    away = triangles - points[:, None]
    edges = np.cross(np.roll(away, -1, axis=1), np.roll(away, -2, axis=1)) / 2
    area = np.einsum("pij,pj->pi", edges, whole)
    total = np.einsum("pj,pj->p", whole, whole)[:, None]
    # Clipped: on an edge rounding may place the point just outside.
    return np.clip(area / np.where(total > 0, total, 1), 0.0, 1.0)
