"""Boxes with common points, and nearest triangles of points."""

from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree


_trimesh: Any = lazy_loader.load("trimesh")


def overlapping_boxes(
    lower: Float[np.ndarray, "b 3"], upper: Float[np.ndarray, "b 3"]
) -> Int[np.ndarray, "p 2"]:
    """Pairs i < j of boxes with common points; corners in m."""
    i, j = np.triu_indices(len(lower), k=1)
    meet = ((lower[i] <= upper[j]) & (lower[j] <= upper[i])).all(axis=1)
    return np.stack([i[meet], j[meet]], axis=1)


class NearestTriangles(NamedTuple):
    """Points that have a triangle within a distance."""

    sample: Int[np.ndarray, " n"]
    """Number of each such point."""
    triangle: Int[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    """Nearest point of the triangle [m]."""

    def of(self, which: Int[np.ndarray, " m"]) -> "NearestTriangles":
        """Some of the points."""
        return NearestTriangles(*(column[which] for column in self))


def nearest_triangles(
    points: Float[np.ndarray, "k 3"], triangles: Float[np.ndarray, "t 3 3"], gap: float
) -> NearestTriangles:
    """Nearest triangle of each point that has one within a distance [m]."""
    centre = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
    tree = KDTree(points) if len(points) else None
    near = [] if tree is None else tree.query_ball_point(centre, radius + gap)
    counts = np.array([len(of_triangle) for of_triangle in near], np.int64)
    if not counts.sum():
        no_hits = np.zeros(0, np.int64)
        return NearestTriangles(no_hits, no_hits, np.zeros((0, 3)))
    sample = np.concatenate([np.asarray(entries, np.int64) for entries in near])
    triangle = np.repeat(np.arange(len(triangles)), counts)
    closest = _trimesh.triangles.closest_point(triangles[triangle], points[sample])
    distance = np.linalg.norm(closest - points[sample], axis=1)
    # Triangles without extent have no nearest point.
    within = np.flatnonzero(np.nan_to_num(distance, nan=np.inf) <= gap)
    order = within[np.lexsort([distance[within], sample[within]])]
    is_first = np.diff(sample[order], prepend=-1) != 0
    chosen = order[is_first]
    return NearestTriangles(sample[chosen], triangle[chosen], closest[chosen])
