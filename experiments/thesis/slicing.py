"""Slicing voxelizer (thesis 4.1, [FC00]): the slow reference for the depth layers.

A slab of one voxel between two clip planes is moved through the body, and everything
inside it is drawn: one triangle and one slab at a time, with exact integer edge tests
that are independent of the arithmetic in `jaxthermo.raster.fragments`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxthermo.raster.fragments import SNAP


class _DrawnTriangle(NamedTuple):
    """Pixels whose centres lie in a triangle, and its depths there."""

    column: Int[np.ndarray, " k"]
    row: Int[np.ndarray, " k"]
    depth: Float[np.ndarray, " k"]


def draw(triangle: Float[np.ndarray, "3 3"], width: int, height: int) -> _DrawnTriangle:
    """Draw one triangle (column, row, depth) of an image."""
    corners = np.round(triangle[:, :2] * SNAP).astype(np.int64)
    pixels = _covered(corners, width, height)
    column = pixels[:, 0]
    row = pixels[:, 1]
    if not len(pixels):
        return _DrawnTriangle(column=column, row=row, depth=np.zeros(0))
    # Barycentric weights by a linear solve, not by edge functions.
    matrix = np.column_stack([corners, np.full(3, SNAP)]) / SNAP
    centres = np.column_stack([pixels + 0.5, np.ones(len(pixels))])
    weights = np.linalg.solve(matrix.T, centres.T)
    corner_depth = triangle[:, 2]
    plane = weights.T @ corner_depth
    depth = np.clip(plane, corner_depth.min(), corner_depth.max())
    return _DrawnTriangle(column=column, row=row, depth=depth)


def _covered(corners: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixel centres (column, row) inside a snapped triangle, ties as in `fragments`."""
    half = SNAP // 2
    last = (width - 1, height - 1)
    low = np.maximum((corners.min(0) - half) // SNAP, 0)
    high = np.minimum((corners.max(0) + half) // SNAP, last)
    column_range = np.arange(low[0], high[0] + 1)
    row_range = np.arange(low[1], high[1] + 1)
    columns, rows = np.meshgrid(column_range, row_range)
    x = columns.ravel() * SNAP + half
    y = rows.ravel() * SNAP + half
    edges_to_the_right = np.zeros(x.shape, int)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        lower, upper = sorted([tuple(start), tuple(end)], key=lambda p: p[1])
        ax, ay = lower
        bx, by = upper
        spans = (ay <= y) & (y < by)
        # The edge is strictly right of the centre: cross product, no division.
        right = (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0
        edges_to_the_right += spans & right
    inside = edges_to_the_right % 2 == 1
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    return pixels[inside]


def slice_voxels(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int, depth: int
) -> set[tuple[int, int, int]]:
    """Voxels (column, row, slab) that some triangle crosses at the pixel's centre."""
    voxels = set()
    for triangle in triangles:
        drawn = draw(triangle, width, height)
        for slab in range(depth):
            within = (drawn.depth >= slab) & (drawn.depth < slab + 1)
            columns = drawn.column[within].tolist()
            rows = drawn.row[within].tolist()
            voxels.update((c, r, slab) for c, r in zip(columns, rows, strict=True))
    return voxels
