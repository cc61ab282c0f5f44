"""The part of a view in which points may be behind an occluder."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...host_memory import require_memory
from ...raster.bounding_spheres import BoundingSpheres
from ...raster.depth_buffer import nearest_depth
from ...raster.views import OrthographicView, pixels_at


_LARGE_MAP = 16_000_000
"""Size of a map from which the free memory is looked up, for each map [bytes]."""


def check_map(width: int, height: int, task: str) -> None:
    """Raise an InputError for an image that would not fit into memory."""
    size = width * height * 16
    if size > _LARGE_MAP:
        require_memory(size, task, "use a coarser pitch")


class Window(NamedTuple):
    """The part of a view in which a point may be behind an occluder."""

    points: Int[np.ndarray, " n"]
    """Numbers of these points."""
    row: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    """Their pixels in the window."""
    corners: Float[np.ndarray, "f 3 3"]
    """Corners of the occluder (column, row, depth)."""
    width: int
    height: int

    def shades(self, depth: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Flag the points, at these depths, that the occluder is in front of."""
        # What begins behind all points shades none of them.
        ahead = self.corners[..., 2].min(axis=1) < depth.max()
        return depth > nearest_depth(
            self.corners[ahead],
            row=self.row,
            column=self.column,
            width=self.width,
            height=self.height,
        )


def window_of(
    view: OrthographicView,
    triangles: Float[np.ndarray, "f 3 3"],
    at: Float[np.ndarray, "n 3"],
    is_behind: Callable[[float, float], Bool[np.ndarray, " n"]],
    task: str,
) -> Window | None:
    """The window of points whose pixels the box around an occluder covers.

    Args:
        view: of all points.
        triangles: of the occluder, in the world [m].
        at: points, projected.
        is_behind: flags of the points, from the depths at which the occluder begins
            and ends.
        task: what the window is a part of.
    """
    row, column = pixels_at(view, at)
    spaces = view.half_spaces(
        low=np.array([column.min(), row.min()]),
        high=np.array([column.max() + 1, row.max() + 1]),
    )
    over = BoundingSpheres.of(triangles).reaching_into(spaces)
    if not len(over):
        return None
    corners = view.project(triangles[over])
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    points = np.flatnonzero(
        (column + 1 >= low[0])
        & (column <= high[0])
        & (row + 1 >= low[1])
        & (row <= high[1])
        & is_behind(low[2], high[2])
    )
    if not len(points):
        return None
    row = row[points]
    column = column[points]
    first = np.array([column.min(), row.min(), 0])
    width = int(column.max() - first[0]) + 1
    height = int(row.max() - first[1]) + 1
    check_map(width, height, task)
    return Window(
        points=points,
        row=row - first[1],
        column=column - first[0],
        # Whole pixels: the rays through the window are those of the view.
        corners=corners - first,
        width=width,
        height=height,
    )
