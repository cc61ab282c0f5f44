"""View factor from surface elements to a flat polygon: Lambert's formula.

F = 1/(2 pi) sum over the edges a -> b of theta (a x b) . n / |a x b|

with the corners a, b as seen from the element, the angle theta between them and the
element's normal n; exact at any distance, for the part above the element's horizon.
Source: Lambert, Photometria (1760); Hottel and Sarofim, Radiative Transfer (1967).
"""

import numpy as np
from jaxtyping import Float


Vectors = Float[np.ndarray, "s 3"]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _edge(a: Vectors, b: Vectors, normal: Vectors) -> Float[np.ndarray, " s"]:
    """Of one edge: the angle it spans, times the cosine of its plane to the normal."""
    across = np.cross(a, b)
    size = np.linalg.norm(across, axis=1)
    # Corners that coincide, or are where the element is, span no angle.
    angle = np.arctan2(size, _dot(a, b))
    return angle * _dot(across, normal) / np.where(size > 0, size, 1.0)


def polygon_view_factor(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    corners: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, " s"]:
    """Share of what elements emit that reaches the front of a convex polygon.

    Args:
        position: of the elements [m].
        normal: theirs.
        corners: of the polygon, counter-clockwise seen from its front [m].
    """
    total = np.zeros(len(position))
    leaving, entering = np.zeros_like(position), np.zeros_like(position)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = start - position, end - position
        up, down = _dot(a, normal), _dot(b, normal)
        share = np.where(up == down, 0.0, up / np.where(up == down, 1.0, up - down))
        crossing = a + share[:, None] * (b - a)
        sinks, rises = (up > 0) & (down <= 0), (up <= 0) & (down > 0)
        # A convex polygon dips below the horizon once and comes up again once.
        leaving += np.where(sinks[:, None], crossing, 0.0)
        entering += np.where(rises[:, None], crossing, 0.0)
        first = np.where(rises[:, None], crossing, a)
        last = np.where(sinks[:, None], crossing, b)
        total += np.where((up > 0) | (down > 0), _edge(first, last, normal), 0.0)
    total += _edge(leaving, entering, normal)
    # Seen from its front the corners turn the other way round the element's normal.
    return np.clip(-total / (2 * np.pi), 0.0, 1.0)
