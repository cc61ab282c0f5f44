"""Perspective views from a point: one image, or the faces of a cube around it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .clip import clip_half_space
from .directions import unit_vector, view_frame
from .fragments import padded, rounded_up
from .layers import depth_range


_MIN_COSINE = 0.6
"""Cosine of the largest angle to the axis of one view; beyond it a cube is drawn."""

_NEAR = 1e-6
"""Depth of the near plane over that of the farthest point [-]."""


@dataclass(frozen=True)
class PerspectiveView:
    """Rays from `eye` through a grid of pixels on the plane at depth 1."""

    frame: Float[np.ndarray, "3 3"]
    """Right, down and forward axes, as rows."""
    eye: Float[np.ndarray, "3"]
    """Position [m]."""
    corner: Float[np.ndarray, "2"]
    """Tangents to the right and down at the corner of pixel (0, 0) [-]."""
    pixel: float
    """Size of a pixel over the depth [-]."""
    width: int
    height: int
    near: float
    """Depth of the near plane [m]."""

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform world points [m] ahead of the eye to (column, row, depth [m])."""
        local = (points - self.eye) @ self.frame.T
        depth = np.maximum(local[..., 2], self.near)
        image = (local[..., :2] / depth[..., None] - self.corner) / self.pixel
        return np.concatenate([image, depth[..., None]], axis=-1)

    def nearest(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> Float[np.ndarray, "h w"]:
        """Depth of the first triangle in each pixel [m]; inf in empty pixels."""
        corners = self.project(self._within(triangles))
        # The inverse of the depth is linear over the image, the depth is not.
        corners[..., 2] = -1 / corners[..., 2]
        # Clipping leaves each view with another count: rounded, they share a program.
        corners = padded(corners, rounded_up(len(corners)))
        key, _ = depth_range(corners, self.width, self.height)
        hit = np.isfinite(key)
        return np.where(hit, -1 / np.where(hit, key, -1.0), np.inf)

    def _within(self, triangles: np.ndarray) -> np.ndarray:
        """Clip world triangles to the image with a margin of one pixel."""
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
        for normal, offset in planes:
            triangles, _ = clip_half_space(
                triangles, normal, offset + self.eye @ normal
            )
        return triangles


def perspective_views(
    eye: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"], size: float
) -> list[tuple[PerspectiveView, Int[np.ndarray, " m"]]]:
    """Views from `eye` that cover all points, with the indices of the points in each.

    Args:
        eye: position of the observer [m].
        points: none of them at the eye [m].
        size: of a pixel at the farthest point [m].
    """
    away = points - eye
    distance = np.linalg.norm(away, axis=1)
    towards = away / distance[:, None]
    middle = towards.mean(0)
    if (towards @ middle > _MIN_COSINE * np.linalg.norm(middle)).all():
        return [(_view(eye, middle, away, size), np.arange(len(points)))]
    axis = np.abs(away).argmax(1)
    side = np.take_along_axis(away, axis[:, None], 1)[:, 0] > 0
    views = []
    # Six square views at most: a single image would grow with tan(angle).
    for face in np.unique(2 * axis + side):
        chosen = np.flatnonzero(2 * axis + side == face)
        forward = (1.0 if face % 2 else -1.0) * np.eye(3)[face // 2]
        views.append((_view(eye, forward, away[chosen], size), chosen))
    return views


def _view(eye, forward, away: np.ndarray, size: float) -> PerspectiveView:
    frame = view_frame(unit_vector(forward))
    local = away @ frame.T
    farthest = float(local[:, 2].max())
    pixel = size / farthest
    tangent = local[:, :2] / local[:, 2:]
    low, high = tangent.min(0), tangent.max(0)
    # Two pixels of margin: samples lie slightly beside their point.
    count = np.maximum(np.ceil((high - low) / pixel).astype(int), 1) + 4
    corner = (low + high) / 2 - count * pixel / 2
    width, height = int(count[0]), int(count[1])
    return PerspectiveView(frame, eye, corner, pixel, width, height, _NEAR * farthest)
