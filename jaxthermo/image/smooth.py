"""Smooth surface temperature: each pixel as a weighted mean of fragments around it.

Weights fall to zero at two voxels, (1 - r^2/R^2)^2, times the fragment's area and the
square of the cosine between the normals, so that nothing leaks through a thin sheet or
around an edge. They depend on the view only, so a frame costs one sparse product.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..scene.solved_surface import BodyGeometry


REACH = 2.0
"""Radius of the weights, in voxels: 1.4 holds at least one fragment of any surface."""

CHUNK = 65536


class PixelWeights(NamedTuple):
    """value[pixel] = sum of weight * value[fragment] over the entries."""

    pixel: Int[np.ndarray, " w"]
    """Sorted."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]


class _Cells:
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
        return (cell[..., 0] * self.size[1] + cell[..., 1]) * self.size[2] + cell[
            ..., 2
        ]

    def pairs(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every (point, fragment) in the same or neighbouring cells."""
        reach = np.arange(-1, 2)
        offsets = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1)
        cell = self._cell(points)[:, None] + offsets.reshape(1, -1, 3)
        within = ((cell >= 0) & (cell < self.size)).all(-1)
        key = np.where(within, self._key(cell), -1).ravel()
        slot = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
        count = np.where(self.keys[slot] == key, self.count[slot], 0)
        owner = np.repeat(np.arange(len(points)).repeat(27), count)
        first = np.repeat(self.start[slot] - np.cumsum(count) + count, count)
        return owner, self.order[first + np.arange(len(first))]


def _kernel(points, normals, geometry, owner, fragment, radius):
    apart = points[owner] - geometry.fragment_position[fragment]
    share = np.einsum("ij,ij->i", apart, apart) / radius**2
    cosine = np.einsum("ij,ij->i", normals[owner], geometry.fragment_normal[fragment])
    near = np.maximum(1 - share, 0) ** 2
    return near * np.maximum(cosine, 0) ** 2 * geometry.fragment_area[fragment]


def nearest_fragments(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> Int[np.ndarray, " p"]:
    """The nearest fragment of each point, whatever its normal."""
    found = np.full(len(points), -1, np.int64)
    radius = geometry.pitch
    while (missing := np.flatnonzero(found < 0)).size:
        radius *= 2
        cells = _Cells(geometry.fragment_position, radius)
        for part in np.array_split(missing, len(missing) // CHUNK + 1):
            owner, fragment = cells.pairs(points[part])
            away = points[part][owner] - geometry.fragment_position[fragment]
            distance = np.einsum("ij,ij->i", away, away)
            order = np.lexsort([distance, owner])
            owners, first = np.unique(owner[order], return_index=True)
            found[part[owners]] = fragment[order][first]
    return found


def smooth_weights(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    geometry: BodyGeometry,
) -> PixelWeights:
    """Weights of the fragments around each point; they sum to one.

    Args:
        points: on the body's surface, in its own frame [m].
        normals: outward there.
        geometry: the body.
    """
    radius = REACH * geometry.pitch
    cells = _Cells(geometry.fragment_position, radius)
    parts = []
    for first in range(0, len(points), CHUNK):
        here = slice(first, first + CHUNK)
        owner, fragment = cells.pairs(points[here])
        weight = _kernel(points[here], normals[here], geometry, owner, fragment, radius)
        kept = weight > 0
        parts.append((owner[kept] + first, fragment[kept], weight[kept]))
    pixel, fragment, weight = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    total = np.bincount(pixel, weights=weight, minlength=len(points))
    alone = np.flatnonzero(total == 0)
    if len(alone):
        # Parts too thin to have fragments of their own show the nearest ones'.
        pixel = np.concatenate([pixel, alone])
        fragment = np.concatenate(
            [fragment, nearest_fragments(points[alone], geometry)]
        )
        weight = np.concatenate([weight, np.ones(len(alone))])
        order = np.argsort(pixel, kind="stable")
        pixel, fragment, weight = pixel[order], fragment[order], weight[order]
        total[alone] = 1.0
    return PixelWeights(pixel, fragment, weight / total[pixel])


def block_weights(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> PixelWeights:
    """The nearest fragment alone: shows the voxels as they are."""
    return PixelWeights(
        np.arange(len(points)),
        nearest_fragments(points, geometry),
        np.ones(len(points)),
    )
