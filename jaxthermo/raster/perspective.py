"""Perspective views: what a point sees of the scene, a window of it or all round."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .clip import clip_half_space
from .directions import unit_vector, view_frame
from .fragments import padded, rounded_up
from .layers import depth_range


WIDEST = 0.6
"""Least cosine to the middle of what one view shows; beyond, the faces of a cube."""

NEAR = 1e-6
"""Nearest depth that is drawn, as a share of the farthest point's."""


@dataclass(frozen=True)
class PerspectiveView:
    """Rays from `eye` through a grid of pixels on the plane at distance 1 ahead."""

    frame: Float[np.ndarray, "3 3"]
    """Rows: right, down, forward."""
    eye: Float[np.ndarray, "3"]
    """[m]"""
    corner: Float[np.ndarray, "2"]
    """Tangents to the right and down at the corner of pixel (0, 0)."""
    pixel: float
    """Tangent of a pixel: its size [m] a metre ahead."""
    width: int
    height: int
    near: float
    """[m]"""

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World points [m] as (column, row, depth ahead [m]); ahead of the eye only."""
        seen = (points - self.eye) @ self.frame.T
        depth = np.maximum(seen[..., 2], self.near)
        at = (seen[..., :2] / depth[..., None] - self.corner) / self.pixel
        return np.concatenate([at, depth[..., None]], axis=-1)

    def nearest(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> Float[np.ndarray, "h w"]:
        """Depth of the first triangle in each pixel [m]; infinite where none is."""
        corners = self.project(self._within(triangles))
        # The inverse of the depth is linear over the image, the depth is not.
        corners[..., 2] = -1 / corners[..., 2]
        # As many as few views have, since clipping leaves each with another number.
        corners = padded(corners, rounded_up(len(corners)))
        key, _ = depth_range(corners, self.width, self.height)
        seen = np.isfinite(key)
        return np.where(seen, -1 / np.where(seen, key, -1.0), np.inf)

    def _within(self, triangles: np.ndarray) -> np.ndarray:
        """World triangles clipped to what the image shows, a pixel beyond its rim."""
        right, down, forward = self.frame
        left, top = self.corner - self.pixel
        size = np.array([self.width + 2, self.height + 2]) * self.pixel
        planes = [
            (forward, self.near),
            (right - left * forward, 0.0),
            ((left + size[0]) * forward - right, 0.0),
            (down - top * forward, 0.0),
            ((top + size[1]) * forward - down, 0.0),
        ]
        for normal, least in planes:
            triangles, _ = clip_half_space(triangles, normal, least + self.eye @ normal)
        return triangles


def perspective_views(
    eye: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"], size: float
) -> list[tuple[PerspectiveView, Int[np.ndarray, " m"]]]:
    """Views from `eye` that hold all points, and the numbers of those in each.

    Args:
        eye: [m]
        points: none of them at the eye [m].
        size: of a pixel at the farthest point [m].
    """
    away = points - eye
    distance = np.linalg.norm(away, axis=1)
    towards = away / distance[:, None]
    middle = towards.mean(0)
    if (towards @ middle > WIDEST * np.linalg.norm(middle)).all():
        return [(_view(eye, middle, away, size), np.arange(len(points)))]
    axis = np.abs(away).argmax(1)
    side = np.take_along_axis(away, axis[:, None], 1)[:, 0] > 0
    views = []
    for face in np.unique(2 * axis + side):
        chosen = np.flatnonzero(2 * axis + side == face)
        forward = (1.0 if face % 2 else -1.0) * np.eye(3)[face // 2]
        views.append((_view(eye, forward, away[chosen], size), chosen))
    return views


def _view(eye, forward, away: np.ndarray, size: float) -> PerspectiveView:
    frame = view_frame(unit_vector(forward))
    seen = away @ frame.T
    farthest = float(seen[:, 2].max())
    pixel = size / farthest
    tangent = seen[:, :2] / seen[:, 2:]
    low, high = tangent.min(0), tangent.max(0)
    # A pixel to spare on every side, as samples lie a little beside their point.
    count = np.maximum(np.ceil((high - low) / pixel).astype(int), 1) + 4
    corner = (low + high) / 2 - count * pixel / 2
    width, height = int(count[0]), int(count[1])
    return PerspectiveView(frame, eye, corner, pixel, width, height, NEAR * farthest)
