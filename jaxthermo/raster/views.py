"""Views: directions, and orthographic and perspective rays through pixels."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..arrays import linear_map, linear_map_in_columns
from ..geometry.vectors import cross_product, unit_vector
from .bounding_spheres import BoundingSpheres, HalfSpaces
from .depth_buffer import nearest_depth
from .fragments import DepthLayers, peel


def view_frame(direction: object) -> Float[np.ndarray, "3 3"]:
    """Right, down and forward axes of a view along `direction`, as orthonormal rows."""
    forward = unit_vector(direction)
    # The axis least parallel to the view gives the most accurate cross product.
    helper = np.eye(3)[int(np.argmin(np.abs(forward)))]
    right = unit_vector(cross_product(forward, helper))
    down = cross_product(forward, right)
    return np.stack([right, down, forward])


# Corners are snapped to a pixel's fraction: that must not leave out a triangle which
# touches the image, in pixels.
_MARGIN = 0.01


@dataclass(frozen=True)
class OrthographicView:
    """Parallel rays along `frame[2]` through a pixel grid of spacing `pitch` [m]."""

    frame: Float[np.ndarray, "3 3"]
    corner: Float[np.ndarray, "3"]
    """Point of column 0, row 0, depth 0 in view axes [m]."""
    pitch: float
    width: int
    height: int

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform world points [m] to (column, row, depth) in pixels."""
        return self.scaled(linear_map_in_columns(points, self.frame.T))

    def scaled(self, turned: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform points in view axes [m] to (column, row, depth) in pixels."""
        return (turned - self.corner) / self.pitch

    def half_spaces(
        self, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]
    ) -> HalfSpaces:
        """The half spaces around a rectangle of the image, (column, row)."""
        across = self.frame[:2]
        first = self.corner[:2] + self.pitch * (low - _MARGIN)
        last = self.corner[:2] + self.pitch * (high + _MARGIN)
        return HalfSpaces(
            normal=np.concatenate([across, -across]),
            offset=np.concatenate([first, -last]),
        )

    def around(self, *hulls: Float[np.ndarray, "_ 3"]) -> "OrthographicView | None":
        """View of the pixels of the same grid that lie around each of some hulls.

        Hulls are points in the world [m]; None if they have no pixel in common.
        """
        at = [self.project(points)[:, :2] for points in hulls]
        low = np.max([np.floor(hull.min(axis=0)) for hull in at], axis=0)
        high = np.min([np.ceil(hull.max(axis=0)) for hull in at], axis=0)
        if np.any(low >= high):
            return None
        width, height = (high - low).astype(int).tolist()
        corner = self.corner + self.pitch * np.append(low, 0)
        return replace(self, corner=corner, width=width, height=height)

    def peel(self, triangles: Float[np.ndarray, "f 3 3"]) -> DepthLayers:
        """Depth layers of world triangles [m] in this view."""
        projected = self.project(triangles)
        return peel(projected, width=self.width, height=self.height)


def orthographic_view(
    points: Float[np.ndarray, "*n 3"], direction: object, pitch: float
) -> OrthographicView:
    """Smallest view along `direction` around all points, with a pixel of margin."""
    return fitted_view(points.reshape(-1, 3), view_frame(direction), pitch).view


class _FittedView(NamedTuple):
    """The smallest view around some points, with a pixel of margin."""

    view: OrthographicView
    at: Float[np.ndarray, "n 3"]
    """The points as (column, row, depth) in pixels."""


def fitted_view(
    points: Float[np.ndarray, "n 3"], frame: Float[np.ndarray, "3 3"], pitch: float
) -> _FittedView:
    """The view of `orthographic_view` in a `view_frame`, with its points projected."""
    turned = linear_map_in_columns(points, frame.T)
    low = turned.min(0)
    high = turned.max(0)
    extent = (high - low)[:2]
    covered_pixels = np.ceil(extent / pitch).astype(int)
    size = np.maximum(covered_pixels, 1) + 2
    width, height = size
    corner = (low + high) / 2 - np.append(size, 0) * pitch / 2
    corner[2] = low[2]
    view = OrthographicView(
        frame=frame,
        corner=corner,
        pitch=pitch,
        width=int(width),
        height=int(height),
    )
    return _FittedView(view=view, at=view.scaled(turned))


# Successive points of a Fibonacci spiral are rotated by the golden angle [rad].
_GOLDEN_ANGLE = float(np.pi * (3.0 - np.sqrt(5.0)))


def cap_directions(
    axis: object, min_cosine: float, count: int
) -> Float[np.ndarray, "d 3"]:
    """Unit vectors within the angle of `min_cosine` to an axis, of equal solid angles.

    A Fibonacci spiral, the same at every call.

    Source: Swinbank and Purser, Q. J. R. Meteorol. Soc. 132 (2006) 1769.
    """
    index = np.arange(count)
    # Equal steps in height are equal areas on a sphere (Archimedes).
    height = 1.0 - (1.0 - min_cosine) * (index + 0.5) / count
    radius = np.sqrt(np.maximum(0.0, 1.0 - height * height))
    angle = _GOLDEN_ANGLE * index
    x = radius * np.cos(angle)
    y = radius * np.sin(angle)
    local = np.stack([x, y, height], axis=1)
    return local @ view_frame(axis)


def half_sphere_directions(count: int) -> Float[np.ndarray, "d 3"]:
    """Unit vectors with z > 0; with their opposites they sample all directions."""
    upwards = (0.0, 0.0, 1.0)
    return cap_directions(upwards, min_cosine=0.0, count=count)


class _ClippedTriangles(NamedTuple):
    """Pieces of triangles, and the number of the triangle that each is a piece of."""

    pieces: Float[np.ndarray, "k 3 3"]
    parent: Int[np.ndarray, " k"]


def clip_half_space(
    triangles: Float[np.ndarray, "f 3 3"],
    normal: Float[np.ndarray, "3"],
    offset: float,
) -> _ClippedTriangles:
    """Clip triangles to normal . x >= offset."""
    depth = triangles @ normal - offset
    ahead = depth >= 0
    count = ahead.sum(axis=1)
    inside = np.flatnonzero(count == 3)
    single = np.flatnonzero(count == 1)
    double = np.flatnonzero(count == 2)

    def corners(selected, first):
        """Points and depths of the corners, in order from corner `first`."""
        order = [(first + k) % 3 for k in range(3)]
        points = (triangles[selected, corner] for corner in order)
        return (*points, *(depth[selected, corner] for corner in order))

    # One corner ahead leaves a triangle, two leave a quadrilateral: two triangles.
    corner_ahead = ahead[single].argmax(1)
    a, b, c, da, db, dc = corners(single, corner_ahead)
    at_b = _intersect(a, outside=b, depth_in=da, depth_out=db)
    at_c = _intersect(a, outside=c, depth_in=da, depth_out=dc)
    tips = np.stack([a, at_b, at_c], axis=1)
    corner_behind = (~ahead[double]).argmax(1)
    behind, d, e, db, dd, de = corners(double, corner_behind)
    at_d = _intersect(d, outside=behind, depth_in=dd, depth_out=db)
    at_e = _intersect(e, outside=behind, depth_in=de, depth_out=db)
    lower = np.stack([d, e, at_e], axis=1)
    upper = np.stack([d, at_e, at_d], axis=1)
    return _ClippedTriangles(
        pieces=np.concatenate([triangles[inside], tips, lower, upper]),
        parent=np.concatenate([inside, single, double, double]),
    )


def _intersect(inside, outside, depth_in, depth_out):
    # Always from inside to outside, so that neighbours compute the same point.
    fraction = depth_in / (depth_in - depth_out)
    return inside + fraction[:, None] * (outside - inside)


_MIN_COSINE = 0.6
"""Cosine of the largest angle to the axis of one view; beyond it a cube is drawn."""

_NEAR = 1e-6
"""Depth of the near plane over that of the farthest point [-]."""


@dataclass(frozen=True)
class _PerspectiveView:
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
        local = linear_map(points - self.eye, self.frame.T)
        depth = np.maximum(local[..., 2], self.near)
        depth = depth[..., None]
        tangent = local[..., :2] / depth
        image = (tangent - self.corner) / self.pixel
        return np.concatenate([image, depth], axis=-1)

    def nearest(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        row: Int[np.ndarray, " p"],
        column: Int[np.ndarray, " p"],
    ) -> Float[np.ndarray, " p"]:
        """Depth of the first triangle in some pixels [m]; inf in empty ones."""
        corners = self.project(self._within(triangles))
        # The inverse of the depth is linear over the image, the depth is not.
        corners[..., 2] = -1 / corners[..., 2]
        key = nearest_depth(
            corners, row=row, column=column, width=self.width, height=self.height
        )
        hit = np.isfinite(key)
        return np.where(hit, -1 / np.where(hit, key, -1.0), np.inf)

    @property
    def half_spaces(self) -> HalfSpaces:
        """The half spaces around the image, with a margin of one pixel."""
        right, down, forward = self.frame
        left, top = self.corner - self.pixel
        right_end = left + (self.width + 2) * self.pixel
        bottom = top + (self.height + 2) * self.pixel
        normal = np.stack(
            [
                forward,
                right - left * forward,
                right_end * forward - right,
                down - top * forward,
                bottom * forward - down,
            ]
        )
        near = np.array([self.near, 0.0, 0.0, 0.0, 0.0])
        return HalfSpaces(normal=normal, offset=near + normal @ self.eye)

    def _within(self, triangles: np.ndarray) -> np.ndarray:
        """Clip world triangles to the image with a margin of one pixel."""
        spaces = self.half_spaces
        triangles = triangles[BoundingSpheres.of(triangles).reaching_into(spaces)]
        for normal, offset in zip(*spaces, strict=True):
            triangles = clip_half_space(triangles, normal=normal, offset=offset).pieces
        return triangles


def perspective_views(
    eye: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"], size: float
) -> list[tuple[_PerspectiveView, Int[np.ndarray, " m"]]]:
    """Views from `eye` [m] that cover all points, with the indices of their points.

    No point may be at the eye; `size` is that of a pixel at the farthest point [m].
    """
    away = points - eye
    distance = np.linalg.norm(away, axis=1)
    towards = away / distance[:, None]
    middle = towards.mean(0)
    least_projection = _MIN_COSINE * np.linalg.norm(middle)
    if (towards @ middle > least_projection).all():
        view = _view(eye, forward=middle, away=away, size=size)
        all_points = np.arange(len(points))
        return [(view, all_points)]
    axis = np.abs(away).argmax(1)
    along_axis = np.take_along_axis(away, axis[:, None], axis=1)
    is_upper = along_axis[:, 0] > 0
    cube_face = 2 * axis + is_upper
    views = []
    # Six square views at most: a single image would grow with tan(angle).
    for face in np.unique(cube_face):
        in_view = np.flatnonzero(cube_face == face)
        sign = 1.0 if face % 2 else -1.0
        forward = sign * np.eye(3)[face // 2]
        view = _view(eye, forward=forward, away=away[in_view], size=size)
        views.append((view, in_view))
    return views


def _view(eye, forward, away: np.ndarray, size: float) -> _PerspectiveView:
    frame = view_frame(unit_vector(forward))
    local = linear_map(away, frame.T)
    farthest = float(local[:, 2].max())
    pixel = size / farthest
    tangent = local[:, :2] / local[:, 2:]
    low = tangent.min(0)
    high = tangent.max(0)
    # Two pixels of margin: samples are slightly displaced from their point.
    covered_pixels = np.ceil((high - low) / pixel).astype(int)
    count = np.maximum(covered_pixels, 1) + 4
    width, height = count
    corner = (low + high) / 2 - count * pixel / 2
    return _PerspectiveView(
        frame=frame,
        eye=eye,
        corner=corner,
        pixel=pixel,
        width=int(width),
        height=int(height),
        near=_NEAR * farthest,
    )


def pixels_at(
    view: OrthographicView | _PerspectiveView, projected: Float[np.ndarray, "n 3"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Row and column of the pixel of each projected point; the nearest one outside."""
    row = np.clip(projected[:, 1].astype(int), 0, view.height - 1)
    column = np.clip(projected[:, 0].astype(int), 0, view.width - 1)
    return row, column
