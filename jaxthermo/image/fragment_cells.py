"""Fragments near points of a surface, and their weights in values at the points.

The value at a point is a weighted mean of the fragments within a radius R, with
weights (1 - r^2/R^2)^2 times the fragment's area and the squared cosine between the
normals, so that nothing leaks through a thin sheet or around an edge.
"""

import numpy as np
from jaxtyping import Float, Int

from ..scene.scene import BodyGeometry


# Points per chunk, which bounds the size of temporaries.
CHUNK = 65536


class FragmentCells:
    """Fragments sorted into cubic cells of the weights' radius."""

    def __init__(self, position: np.ndarray, radius: float):
        self.radius = radius
        self.low = position.min(0) - 1.5 * radius
        cell = self._cell(position)
        self.size = cell.max(0) + 3
        key = self._key(cell)
        self.order = np.argsort(key, kind="stable")
        self.keys, self.start, self.count = np.unique(
            key[self.order], return_index=True, return_counts=True
        )

    def _cell(self, points: np.ndarray) -> np.ndarray:
        return np.floor((points - self.low) / self.radius).astype(np.int64)

    def _key(self, cell: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis(cell, -1, 0)
        return (x * self.size[1] + y) * self.size[2] + z

    def pairs(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All (point, fragment) in the same or neighbouring cells."""
        offsets = np.indices((3, 3, 3)).reshape(3, -1).T - 1
        cell = self._cell(points)[:, None] + offsets
        within = ((cell >= 0) & (cell < self.size)).all(-1)
        key = np.where(within, self._key(cell), -1).ravel()
        slot = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
        count = np.where(self.keys[slot] == key, self.count[slot], 0)
        owner = np.repeat(np.arange(len(points)).repeat(27), count)
        first = np.repeat(self.start[slot] - np.cumsum(count) + count, count)
        return owner, self.order[first + np.arange(len(first))]


def kernel(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    geometry: BodyGeometry,
    owner: Int[np.ndarray, " w"],
    fragment: Int[np.ndarray, " w"],
    radius: float,
) -> Float[np.ndarray, " w"]:
    """Weights of pairs of a point and a fragment, before they are normalized [m^2]."""
    offset = points[owner] - geometry.fragment_position[fragment]
    squared = np.einsum("ij,ij->i", offset, offset) / radius**2
    cosine = np.einsum("ij,ij->i", normals[owner], geometry.fragment_normal[fragment])
    near = np.maximum(1 - squared, 0) ** 2
    return near * np.maximum(cosine, 0) ** 2 * geometry.fragment_area[fragment]
