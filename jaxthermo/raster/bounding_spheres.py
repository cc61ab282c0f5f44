"""Spheres around triangles, to leave out those that are beside an image."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import linear_map
from ..memo.found import found
from .views import OrthographicView


# Rounding must not leave out a triangle that touches the image, in pixels.
_MARGIN = 0.01


class BoundingSpheres(NamedTuple):
    """A sphere around each triangle."""

    centre: Float[np.ndarray, "f 3"]
    radius: Float[np.ndarray, " f"]

    @classmethod
    def of(cls, triangles: Float[np.ndarray, "f 3 3"]) -> "BoundingSpheres":
        """Those around the boxes of triangles [m]; the same ones in every call."""
        return found((triangles,), "bounding spheres", lambda: cls._around(triangles))

    @classmethod
    def _around(cls, triangles: Float[np.ndarray, "f 3 3"]) -> "BoundingSpheres":
        low = triangles.min(axis=1)
        high = triangles.max(axis=1)
        return cls((low + high) / 2, np.linalg.norm(high - low, axis=1) / 2)

    def are_over(
        self,
        view: OrthographicView,
        low: Int[np.ndarray, "2"],
        high: Int[np.ndarray, "2"],
    ) -> Bool[np.ndarray, " f"]:
        """Flags of spheres over a rectangle of a view, (column, row)."""
        in_image = linear_map(self.centre, view.frame[:2].T) - view.corner[:2]
        column, row = in_image.T / view.pitch
        reach = self.radius / view.pitch + _MARGIN
        return (
            (column + reach >= low[0])
            & (column - reach <= high[0])
            & (row + reach >= low[1])
            & (row - reach <= high[1])
        )
