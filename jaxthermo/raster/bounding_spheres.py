"""Spheres around triangles, to leave out those that an image or lines do not meet."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import linear_map_in_columns
from ..geometry.vectors import row_dot, row_length
from ..memo.found import found


# Triangles that share a sphere: most of a scene is left out by few comparisons.
_RUN = 64


class HalfSpaces(NamedTuple):
    """Half spaces normal . x >= offset; an image shows what is in all of them."""

    normal: Float[np.ndarray, "k 3"]
    """Vectors of any length, out of the planes."""
    offset: Float[np.ndarray, " k"]


class _Spheres(NamedTuple):
    centre: Float[np.ndarray, "n 3"]
    """[m]"""
    radius: Float[np.ndarray, " n"]
    """[m]"""

    @classmethod
    def around(
        cls, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> "_Spheres":
        """Those through the corners of boxes [m]."""
        return cls((low + high) / 2, row_length(high - low) / 2)

    def some(self, numbers: Int[np.ndarray, " m"]) -> "_Spheres":
        """Those of some numbers."""
        return _Spheres(self.centre[numbers], self.radius[numbers])

    def reach_into(self, spaces: HalfSpaces) -> Bool[np.ndarray, " n"]:
        """Flags of spheres that have a part in each half space."""
        x, y, z = self.centre.T
        reaches = np.ones(len(self.radius), bool)
        length = row_length(spaces.normal)
        for (a, b, c), offset, scale in zip(*spaces, length, strict=True):
            reaches &= x * a + y * b + z * c - offset >= -scale * self.radius
        return reaches


class BoundingSpheres(NamedTuple):
    """A sphere around each triangle, and one around each run of triangles."""

    triangles: _Spheres
    runs: _Spheres
    """A run has 64 triangles in their order: those of a body are close together."""

    @classmethod
    def of(cls, triangles: Float[np.ndarray, "f 3 3"]) -> "BoundingSpheres":
        """Those around the boxes of triangles [m]; the same ones in every call."""
        return found((triangles,), "bounding spheres", lambda: cls._around(triangles))

    @classmethod
    def _around(cls, triangles: Float[np.ndarray, "f 3 3"]) -> "BoundingSpheres":
        low = triangles.min(axis=1)
        high = triangles.max(axis=1)
        first = np.arange(0, len(triangles), _RUN)
        runs = _Spheres.around(
            np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
        )
        return cls(triangles=_Spheres.around(low, high), runs=runs)

    def reaching_into(self, spaces: HalfSpaces) -> Int[np.ndarray, " m"]:
        """Numbers of triangles whose spheres have a part in each half space."""
        run = np.flatnonzero(self.runs.reach_into(spaces))
        number = (_RUN * run[:, None] + np.arange(_RUN)).reshape(-1)
        number = number[number < len(self.triangles.radius)]
        return number[self.triangles.some(number).reach_into(spaces)]

    def meet(
        self,
        points: Float[np.ndarray, "k 3"],
        directions: Float[np.ndarray, "d 3"],
        margin: float,
    ) -> Bool[np.ndarray, " d"]:
        """Flag unit directions along which lines through points may meet triangles.

        A sphere around all points and those around runs decide, with a margin [m].
        """
        if not len(points):
            return np.zeros(len(directions), bool)
        # The extremes of a coordinate are found faster in a row of its own.
        coordinates = np.ascontiguousarray(points.T)
        around = _Spheres.around(
            coordinates.min(axis=1)[None], coordinates.max(axis=1)[None]
        )
        offset = self.runs.centre - around.centre
        reach = self.runs.radius + around.radius + margin
        along = linear_map_in_columns(offset, directions.T)
        aside = row_dot(offset, offset)[:, None] - along**2
        return np.any(aside <= reach[:, None] ** 2, axis=0)
