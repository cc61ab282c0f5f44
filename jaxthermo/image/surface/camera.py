"""Cameras: rays of pixels, and projection of triangles onto the image."""

import abc
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int, Shaped
from typing_extensions import override

from ...arrays import linear_map, plain_numbers, static_numbers
from ...errors import InputError
from ...geometry.vectors import unit_vector
from ...raster.views import clip_half_space


# Depth of the near plane relative to the distance of `look_at`: at depth 0 the
# projection has no limit.
_NEAR = 0.02

_FORWARD = np.array([0.0, 0.0, 1.0])


class _RasterMesh(NamedTuple):
    """Visible pieces of a mesh on the image."""

    points: Float[np.ndarray, "w 3"]
    """Corners of the pieces: column, row and key."""
    faces: Int[np.ndarray, "k 3"]
    """Numbers of the corners of each piece."""
    parent: Int[np.ndarray, " k"]
    """Index of the face of the mesh that each piece belongs to."""


class AbstractCamera(eqx.Module):
    """Pixels and rays; image rows run down, columns to the right."""

    position: eqx.AbstractVar[tuple[float, float, float]]
    look_at: eqx.AbstractVar[tuple[float, float, float]]

    # Properties, since type checkers would take variables as the next arguments.
    @property
    @abc.abstractmethod
    def up(self) -> tuple[float, float, float]:
        """Direction that is up in the image [-]."""

    @property
    @abc.abstractmethod
    def width(self) -> int:
        """Number of columns [pixels]."""

    @property
    @abc.abstractmethod
    def height(self) -> int:
        """Number of rows [pixels]."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return self.width, self.height

    @property
    def frame(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors to the right, down and forward in the world, as rows."""
        return _view_frame(self.position, self.look_at, self.up)

    @property
    @abc.abstractmethod
    def _near(self) -> float:
        """Depth before which nothing is drawn [m]."""

    @abc.abstractmethod
    def _on_image(self, local: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Project points in camera axes [m] to (column, row, key)."""

    def to_raster(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """Clip and project world triangles to (column, row, key).

        The key grows with depth and is linear over the image, so that rasterized
        fragments sort by it.

        Returns:
            The visible pieces, and the index of the triangle of each piece.
        """
        pieces, parent = clip_half_space(self._local(triangles), _FORWARD, self._near)
        return self._on_image(pieces), parent

    def mesh_to_raster(
        self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
    ) -> _RasterMesh:
        """Clip and project a mesh as `to_raster`, each vertex once."""
        local = self._local(vertices)
        ahead = local[:, 2] >= self._near
        if ahead.all():
            return _RasterMesh(
                points=self._on_image(local),
                faces=faces,
                parent=np.arange(len(faces)),
            )
        # What is behind the pinhole would be projected upside down.
        local[~ahead] = self._near * _FORWARD
        corners = ahead[faces].sum(axis=1)
        uncut = np.flatnonzero(corners == 3)
        cut = (corners > 0) & (corners < 3)
        pieces, piece_parent = self.to_raster(vertices[faces[cut]])
        points = np.concatenate([self._on_image(local), pieces.reshape(-1, 3)])
        cut_faces = len(local) + np.arange(3 * len(pieces)).reshape(-1, 3)
        parent = np.concatenate([uncut, np.flatnonzero(cut)[piece_parent]])
        return _RasterMesh(
            points=points,
            faces=np.concatenate([faces[uncut], cut_faces]),
            parent=parent,
        )

    def project(self, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 2"]:
        """Columns and rows of world points [pixels], whose depths are positive."""
        return self._on_image(self._local(points))[:, :2]

    def points(
        self, pixel: Int[np.ndarray, " p"], key: Float[np.ndarray, " p"]
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
        """World points at pixel centres [m], and their depths along the axis [m]."""
        origin, step = self.rays(pixel)
        depth = self._depth(key)
        return origin + depth[:, None] * step, depth

    @abc.abstractmethod
    def _depth(self, key: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """Depth along the optical axis of a key [m]."""

    @abc.abstractmethod
    def rays(
        self, pixel: Int[np.ndarray, " p"] | None = None
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
        """Rays of pixels, all if None: points at depth 0 [m], steps per metre of it."""

    @abc.abstractmethod
    def pixels_towards(
        self, direction: Float[np.ndarray, "3"], angle: float
    ) -> Int[np.ndarray, " p"]:
        """Pixels with rays within `angle` [rad] of a unit vector; perhaps some more."""

    def frame_of(
        self,
        pixel: Int[np.ndarray, " p"],
        values: Shaped[np.ndarray, "p *k"],
        background: float | int | tuple[int, ...],
    ) -> Shaped[np.ndarray, "h w *k"]:
        """Image of values at some pixels, with a background at all others."""
        frame = np.full(
            (self.height * self.width, *values.shape[1:]), background, values.dtype
        )
        frame[pixel] = values
        return frame.reshape(self.height, self.width, *values.shape[1:])

    def finer(self, samples: int) -> "AbstractCamera":
        """Same view with `samples` times as many pixels along both axes."""
        size = {"width": self.width * samples, "height": self.height * samples}
        return replace(self, **size)

    def _check_view(self) -> None:
        width, height = self.size
        if width < 1 or height < 1 or width * height > 2**27:
            raise InputError(
                f"Camera(width={width}, height={height}): give 1 to 134 million pixels"
            )
        # Raises where the direction or the up vector makes no frame.
        _ = self.frame

    def _local(self, points: np.ndarray) -> np.ndarray:
        return linear_map(points - np.asarray(self.position), self.frame.T)

    def _all_pixels(self) -> Int[np.ndarray, " p"]:
        return np.arange(self.width * self.height)

    def _offsets(
        self, pixel: Int[np.ndarray, " p"] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances to the right of and below the centre of the image [pixels]."""
        pixel = self._all_pixels() if pixel is None else pixel
        row, column = np.divmod(pixel, self.width)
        return column + 0.5 - self.width / 2, row + 0.5 - self.height / 2


class Camera(AbstractCamera):
    """Pinhole camera.

    Raises:
        InputError: for an impossible size, view direction or field of view.
    """

    position: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Position of the pinhole [m]."""
    look_at: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Point in the centre of the image [m]."""
    up: tuple[float, float, float] = static_numbers((0.0, 0.0, 1.0))
    field_of_view: float = static_numbers(0.6)
    """Angle from the top to the bottom of the image [rad]."""
    width: int = static_numbers(640)
    height: int = static_numbers(480)

    def __check_init__(self):
        self._check_view()
        if not 0 < self.field_of_view < np.pi:
            raise InputError(
                f"Camera(field_of_view={self.field_of_view!r}): "
                "give radians between 0 and pi"
            )

    @property
    def _focal(self) -> float:
        return self.height / 2 / np.tan(self.field_of_view / 2)

    @property
    @override
    def _near(self) -> float:
        distance = float(np.linalg.norm(np.subtract(self.look_at, self.position)))
        return _NEAR * distance

    @override
    def _on_image(self, local: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        depth = local[..., 2]
        column = self.width / 2 + self._focal * local[..., 0] / depth
        row = self.height / 2 + self._focal * local[..., 1] / depth
        # In perspective the inverse of the depth is linear over the image.
        return np.stack([column, row, -1 / depth], axis=-1)

    @override
    def _depth(self, key: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        return -1 / key

    @override
    def rays(
        self, pixel: Int[np.ndarray, " p"] | None = None
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
        right, down = self._offsets(pixel)
        ahead = np.full(len(right), self._focal)
        step = linear_map(np.stack([right, down, ahead], axis=1), self.frame)
        step /= self._focal
        return np.broadcast_to(np.asarray(self.position, float), step.shape), step

    @override
    def pixels_towards(
        self, direction: Float[np.ndarray, "3"], angle: float
    ) -> Int[np.ndarray, " p"]:
        right, down, ahead = self.frame @ direction
        off = float(np.arctan2(np.hypot(right, down), ahead))
        if off + angle >= np.pi / 2:
            # Such a cone has no outline on the image, or is behind it.
            return self._all_pixels() if off - angle < np.pi / 2 else np.arange(0)
        # The outline is an ellipse, longest away from the middle of the image.
        reach = self._focal * (np.tan(off + angle) - np.tan(off)) + 1
        ends = []
        for along, size in ((right, self.width), (down, self.height)):
            middle = self._focal * along / ahead + size / 2
            ends.append(np.clip([middle - reach, middle + reach], 0, size).astype(int))
        (left, right_end), (top, bottom) = ends
        rows = np.arange(top, min(bottom + 1, self.height))
        columns = np.arange(left, min(right_end + 1, self.width))
        return (rows[:, None] * self.width + columns).ravel()


class OrthographicCamera(AbstractCamera):
    """Camera with parallel rays.

    Raises:
        InputError: for an impossible size, view direction or height of the view.
    """

    position: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Centre of the image plane [m]; bodies behind the plane are not drawn."""
    look_at: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Point in the centre of the image [m]."""
    view_height: float = eqx.field(static=True, converter=plain_numbers)
    """Length from the top to the bottom of the image [m]."""
    up: tuple[float, float, float] = static_numbers((0.0, 0.0, 1.0))
    width: int = static_numbers(640)
    height: int = static_numbers(480)

    def __check_init__(self):
        self._check_view()
        if not (np.isfinite(self.view_height) and self.view_height > 0):
            raise InputError(
                f"OrthographicCamera(view_height={self.view_height!r}): "
                "give a positive length in metres"
            )

    @property
    @override
    def _near(self) -> float:
        return 0.0

    @override
    def _on_image(self, local: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        scale = self.height / self.view_height
        column = self.width / 2 + scale * local[..., 0]
        row = self.height / 2 + scale * local[..., 1]
        return np.stack([column, row, local[..., 2]], axis=-1)

    @override
    def _depth(self, key: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        return key

    @override
    def rays(
        self, pixel: Int[np.ndarray, " p"] | None = None
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
        right, down = self._offsets(pixel)
        ahead = np.zeros(len(right))
        scale = self.view_height / self.height
        local = scale * np.stack([right, down, ahead], axis=1)
        origin = linear_map(local, self.frame) + np.asarray(self.position)
        return origin, np.broadcast_to(self.frame[2], origin.shape)

    @override
    def pixels_towards(
        self, direction: Float[np.ndarray, "3"], angle: float
    ) -> Int[np.ndarray, " p"]:
        # All rays are parallel; the difference is rounded less than a scalar product.
        away = float(np.linalg.norm(self.frame[2] - direction))
        return self._all_pixels() if away <= angle else np.arange(0)


def frame_all(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int = 640,
    height: int = 480,
    direction: tuple[float, float, float] = (-0.35, 1.0, -0.22),
) -> Camera:
    """Camera along `direction`, as close as possible with all triangles in view."""
    corners = triangles.reshape(-1, 3)
    middle = (corners.min(0) + corners.max(0)) / 2
    forward = unit_vector(direction)
    axes = _view_frame((0.0, 0.0, 0.0), tuple(forward.tolist()), (0.0, 0.0, 1.0))
    x, y, z = np.moveaxis(linear_map(corners - middle, axes.T), -1, 0)
    field_of_view = 0.5
    margin = 1.06
    slope = np.tan(field_of_view / 2) / margin
    # Each corner needs this depth to be inside the image, vertically and horizontally.
    depth = np.maximum(np.abs(y) / slope, np.abs(x) / (slope * width / height))
    position = middle - forward * float((depth - z).max())
    x, y, z = position.tolist()
    middle_x, middle_y, middle_z = middle.tolist()
    return Camera(
        position=(x, y, z),
        look_at=(middle_x, middle_y, middle_z),
        field_of_view=field_of_view,
        width=width,
        height=height,
    )


# A frame in a new view needs it several times.
@lru_cache(maxsize=64)
def _view_frame(position, look_at, up) -> Float[np.ndarray, "3 3"]:
    """Right, down and forward axes, as rows."""
    forward = unit_vector(np.subtract(look_at, position), "Camera(look_at - position)")
    right = np.cross(forward, unit_vector(up, "Camera(up=)"))
    if np.linalg.norm(right) < 1e-9:
        raise InputError(
            f"Camera(up={tuple(up)!r}) is along the line of sight: "
            "choose another up, such as (0, 1, 0)"
        )
    right = unit_vector(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    axes.flags.writeable = False
    return axes
