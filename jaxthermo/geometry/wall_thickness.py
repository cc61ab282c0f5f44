"""Thickness of a closed mesh that is a thin wall."""

import numpy as np
from jaxtyping import Float

from .mesh import Mesh


_RAYS = 24
_DEVIATION = 0.25
"""Difference between the way through a wall and 2 V / A, over the latter [-]."""
_FLATNESS = 100.0
"""Area of one side of a wall over the square of its thickness, at least [-]."""
_MAX_FACES = 200_000
"""Number of faces from which a part is not a simple wall, and rays take long."""


def wall_thickness(mesh: Mesh) -> float | None:
    """Thickness of a closed thin wall [m]; None for any other body.

    The way through a wall of thickness t is t from most of its faces, and as its sides
    have nearly all of its area, 2 V / A is little less. For a rod or a ball the two
    differ.
    """
    area = mesh.area
    volume = mesh.volume
    if volume <= 0.0 or area <= 0.0 or len(mesh.faces) > _MAX_FACES:
        return None
    mean = 2.0 * volume / area
    if area / 2.0 < _FLATNESS * mean**2:
        return None
    thickness = float(np.median(_ways_through(mesh)))
    return thickness if abs(thickness - mean) <= _DEVIATION * mean else None


def _ways_through(mesh: Mesh) -> Float[np.ndarray, " r"]:
    """Distances from points on the surface to the next one behind it [m]."""
    corners = mesh.triangles
    vectors = mesh.area_vectors
    cumulative = np.linalg.norm(vectors, axis=1).cumsum()
    shares = (np.arange(_RAYS) + 0.5) / _RAYS * cumulative[-1]
    distances = []
    for face in np.searchsorted(cumulative, shares).tolist():
        # Beside the centre: rays through it often meet an edge of the other side.
        origin = np.array([0.29, 0.33, 0.38]) @ corners[face]
        inward = -vectors[face] / np.linalg.norm(vectors[face])
        distances.append(_first_hit(corners, face, origin, inward))
    return np.array(distances)


def _first_hit(
    corners: Float[np.ndarray, "f 3 3"],
    start_face: int,
    origin: Float[np.ndarray, "3"],
    direction: Float[np.ndarray, "3"],
) -> float:
    """Distance along a ray to the first triangle but that of its start; else infinite.

    Source: Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection"
    (1997).
    """
    first, second, third = np.moveaxis(corners, 1, 0)
    along_u = second - first
    along_v = third - first
    normal = np.cross(direction, along_v)
    determinant = (along_u * normal).sum(axis=1)
    away = origin - first
    turned = np.cross(away, along_u)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (away * normal).sum(axis=1) / determinant
        v = turned @ direction / determinant
        distance = (along_v * turned).sum(axis=1) / determinant
        is_hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    is_hit[start_face] = False
    return float(distance[is_hit].min(initial=np.inf))
