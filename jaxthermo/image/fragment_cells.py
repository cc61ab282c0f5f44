"""Fragments near points of a surface, and their weights in values at the points.

The value at a point is a weighted mean of the fragments within a radius R, with
weights (1 - r^2/R^2)^2 times the fragment's area and the squared cosine between the
normals, so that nothing leaks through a thin sheet or around an edge.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..findings import found
from ..scene.scene import BodyGeometry


# Points per chunk. Temporaries that stay in the cache, and that the allocator keeps
# instead of returning them, take a third of the time of larger ones.
CHUNK = 2048


class Neighbours(NamedTuple):
    """Pairs of a point and a fragment near it with a weight above 0."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]
    """Before it is normalized [m^2]."""


class FragmentCells:
    """Fragments sorted into cubic cells of the weights' radius."""

    def __init__(self, geometry: BodyGeometry, radius: float):
        position = geometry.fragment_position
        self.radius = radius
        self.low = position.min(0) - 1.5 * radius
        cell = self._cell(position)
        self.size = cell.max(0) + 3
        key = self._key(cell)
        self.order = np.argsort(key, kind="stable")
        self.keys = key[self.order]
        # Columns in the order of the cells, so that neighbours are close in memory.
        self.position = np.ascontiguousarray(position[self.order].T)
        self.normal = np.ascontiguousarray(geometry.fragment_normal[self.order].T)
        self.area = geometry.fragment_area[self.order]

    def _cell(self, points: np.ndarray) -> np.ndarray:
        return np.floor((points - self.low) / self.radius).astype(np.int64)

    def _key(self, cell: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis(cell, -1, 0)
        return (x * self.size[1] + y) * self.size[2] + z

    def _ranges(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First fragment and number of fragments [p, 9] in nine rows of three cells."""
        offsets = np.indices((3, 3)).reshape(2, -1).T - 1
        cell = self._cell(points)
        x, y = (cell[:, None, axis] + offsets[:, axis] for axis in range(2))
        z = cell[:, 2]
        inside = (x >= 0) & (x < self.size[0]) & (y >= 0) & (y < self.size[1])
        inside &= ((z >= -1) & (z <= self.size[2]))[:, None]
        # Cells of a row along z have keys in succession; the rows' ends are empty.
        row = (x * self.size[1] + y) * self.size[2]
        low, high = np.maximum(z - 1, 0), np.minimum(z + 1, self.size[2] - 1)
        first = np.searchsorted(self.keys, row + low[:, None])
        count = np.searchsorted(self.keys, row + high[:, None], side="right") - first
        return first, np.where(inside, count, 0)

    def pairs(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, fragments and their places here, in the same or adjacent cells."""
        first, count = self._ranges(points)
        number = count.sum(axis=1)
        flat = count.ravel()
        place = np.repeat(first.ravel() - np.cumsum(flat) + flat, flat)
        place += np.arange(len(place))
        return np.repeat(np.arange(len(points)), number), self.order[place], place

    def weighted(
        self, points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"]
    ) -> Neighbours:
        """Fragments with a weight at each point."""
        owner, _, place = self.pairs(points)
        squared = np.zeros(len(owner))
        for along, other in zip(points.T, self.position, strict=True):
            away = along[owner] - other[place]
            squared += away * away
        # Two thirds of the pairs are too far apart.
        near = np.flatnonzero(squared < self.radius * self.radius)
        owner, place = owner[near], place[near]
        cosine = np.zeros(len(owner))
        for along, other in zip(normals.T, self.normal, strict=True):
            cosine += along[owner] * other[place]
        fade = 1 - squared[near] / (self.radius * self.radius)
        weight = (fade * np.maximum(cosine, 0)) ** 2 * self.area[place]
        kept = np.flatnonzero(weight > 0)
        place = place[kept]
        return Neighbours(owner[kept], self.order[place], weight[kept])


def cells_of(geometry: BodyGeometry, radius: float) -> FragmentCells:
    """Cells of a body's fragments, the same for all views of it."""
    by = "fragment_cells", radius
    return found((geometry,), by, lambda: FragmentCells(geometry, radius))
