"""Points of surfaces that a camera sees, and the normals with which they are shaded."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import InputError
from ..geometry.mesh import winding_number
from ..raster.fragments import peel
from .camera import AbstractCamera


# Faces that meet at a larger angle form an edge, which shading must not round off. A
# cylinder of 12 sides, 30 degrees apart, still counts as round.
CREASE_COSINE = float(np.cos(np.deg2rad(40.0)))


class VisiblePoints(NamedTuple):
    """The nearest point of a surface on the ray of each pixel that shows a body."""

    pixel: Int[np.ndarray, " p"]
    """Index of each pixel, rows first."""
    body: Int[np.ndarray, " p"]
    """Number of the body."""
    face: Int[np.ndarray, " p"]
    """Number of the triangle in its body."""
    position: Float[np.ndarray, "p 3"]
    """World [m]."""
    depth: Float[np.ndarray, " p"]
    """Depth along the optical axis [m]."""


def visible_points(
    bodies: tuple[Float[np.ndarray, "_ 3 3"], ...], camera: AbstractCamera
) -> VisiblePoints:
    """Find what the camera sees of bodies, each given by its triangles [m].

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    for index, triangles in enumerate(bodies):
        if abs(winding_number(triangles, np.asarray(camera.position, float))) > 0.5:
            raise InputError(
                f"camera: position {camera.position} is inside body {index}; "
                "move it out, or omit the camera for an automatic view"
            )
    corners, parent = camera.to_raster(np.concatenate(bodies))
    on_image = np.flatnonzero(_overlaps(corners, camera))
    layers = peel(corners[on_image], *camera.size)
    front = layers.layer == 0
    pixel, key = layers.pixel[front], layers.depth[front]
    if not len(pixel):
        raise InputError(
            f"camera: at {camera.position} it sees no body; "
            "turn it, or omit the camera for an automatic view"
        )
    hit = parent[on_image][layers.triangle[front]]
    first = np.cumsum([0, *(len(triangles) for triangles in bodies)])
    body = np.searchsorted(first, hit, side="right") - 1
    position, depth = camera.points(pixel, key)
    return VisiblePoints(pixel, body, hit - first[body], position, depth)


# Triangles whose bounding box overlaps the image: the others would cost rays.
def _overlaps(corners: np.ndarray, camera: AbstractCamera) -> Bool[np.ndarray, " k"]:
    low, high = corners[..., :2].min(1), corners[..., :2].max(1)
    return ((high > 0) & (low < np.array(camera.size))).all(1)


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
    corner = corner_normals(vertices, faces, shown)[row]
    triangle = vertices[faces[face]]
    weight = barycentric(triangle, points)
    normal = unit(np.einsum("pi,pij->pj", weight, corner))
    flat = unit(area_vectors(triangle))
    # A degenerate triangle has no normal, and no pixel that could show it.
    ahead = np.einsum("pi,pi->p", normal, flat) > 0
    return np.where(ahead[:, None], normal, flat)


def corner_normals(
    vertices: np.ndarray, faces: np.ndarray, shown: np.ndarray
) -> Float[np.ndarray, "k 3 3"]:
    """Normal at each corner of some faces [k, corner, 3]."""
    if not len(shown):
        return np.empty((0, 3, 3))
    touched = np.zeros(len(vertices), bool)
    touched[faces[shown]] = True
    near = np.flatnonzero(touched[faces].any(axis=1))
    normal = unit(area_vectors(vertices[faces[near]]))
    # Corner 3 f + i of face f; those of one group have one normal.
    group = _joined_corners(faces[near], normal)
    angle = _corner_angles(vertices[faces[near]]).ravel()
    weighted = normal.repeat(3, axis=0) * angle[:, None]
    total = [np.bincount(group, column) for column in weighted.T]
    smooth = unit(np.stack(total, axis=1))[group].reshape(-1, 3, 3)
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
    joined &= cosine > CREASE_COSINE
    one, other = one[joined], other[joined]
    # The same corners of both faces: neighbours run along their edge in opposite ways.
    flip = ends[0, one] != ends[0, other]
    there = np.where(flip, ahead[other], other), np.where(flip, other, ahead[other])
    pairs = np.concatenate([one, ahead[one]]), np.concatenate(there)
    size = faces.size
    graph = coo_array((np.ones(len(pairs[0]), bool), pairs), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _corner_angles(triangles: np.ndarray) -> Float[np.ndarray, "f 3"]:
    ahead = unit(np.roll(triangles, -1, axis=1) - triangles)
    behind = unit(np.roll(triangles, 1, axis=1) - triangles)
    return np.arccos(np.clip(np.einsum("fij,fij->fi", ahead, behind), -1.0, 1.0))


def area_vectors(triangles: np.ndarray) -> Float[np.ndarray, "f 3"]:
    """Normals of triangles, of the length of their areas [m^2]."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1; 0 of those without a length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def barycentric(
    triangles: Float[np.ndarray, "p 3 3"], points: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, "p 3"]:
    """Barycentric coordinates of points on triangles."""
    # Areas of the triangles that the point forms with each edge, along the normal.
    whole = area_vectors(triangles)
    away = triangles - points[:, None]
    edges = np.cross(np.roll(away, -1, axis=1), np.roll(away, -2, axis=1)) / 2
    area = np.einsum("pij,pj->pi", edges, whole)
    total = np.einsum("pj,pj->p", whole, whole)[:, None]
    # Clipped: on an edge rounding may place the point just outside.
    return np.clip(area / np.where(total > 0, total, 1), 0.0, 1.0)
