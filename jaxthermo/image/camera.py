"""Cameras: where a pixel's ray goes, and how triangles land on the pixels."""

import abc

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..raster.clip import clip_half_space
from ..raster.directions import unit_vector


_FORWARD = np.array([0.0, 0.0, 1.0])

NEAR = 0.02
"""Nearest depth drawn, as a share of the distance to what is looked at."""


class AbstractCamera(eqx.Module):
    """Pixels and rays; image rows run down, columns to the right."""

    position: eqx.AbstractVar[tuple[float, float, float]]
    look_at: eqx.AbstractVar[tuple[float, float, float]]

    @property
    @abc.abstractmethod
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @abc.abstractmethod
    def to_raster(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """World triangles as (column, row, key), and which each piece came from.

        The key grows with depth and is linear over the image, so that rasterized
        fragments sort by it.
        """

    @abc.abstractmethod
    def points(
        self, pixel: Int[np.ndarray, " p"], key: Float[np.ndarray, " p"]
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
        """World points [m] seen at pixels, and their depths along the axis [m]."""

    @abc.abstractmethod
    def finer(self, samples: int) -> "AbstractCamera":
        """The same view with `samples` pixels for each one along both axes."""


def _frame(position, look_at, up) -> Float[np.ndarray, "3 3"]:
    """Right, down and forward axes."""
    forward = unit_vector(np.subtract(look_at, position), "Camera(look_at - position)")
    right = np.cross(forward, unit_vector(up, "Camera(up=)"))
    if np.linalg.norm(right) < 1e-9:
        raise InputError(
            f"Camera(up={tuple(up)!r}) is along the line of sight: "
            "choose another up, such as (0, 1, 0)"
        )
    right = unit_vector(right)
    return np.stack([right, np.cross(forward, right), forward])


def _point(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _check_size(width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > 2**27:
        raise InputError(
            f"Camera(width={width}, height={height}): give 1 to 134 million pixels"
        )


def _rows_and_columns(pixel, width):
    row, column = np.divmod(pixel, width)
    return row + 0.5, column + 0.5


class Camera(AbstractCamera):
    """A pinhole camera."""

    position: tuple[float, float, float] = eqx.field(static=True)
    """[m]"""
    look_at: tuple[float, float, float] = eqx.field(static=True)
    """[m]"""
    up: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 1.0))
    field_of_view: float = eqx.field(static=True, default=0.6)
    """Angle from the top to the bottom of the image [rad]."""
    width: int = eqx.field(static=True, default=640)
    height: int = eqx.field(static=True, default=480)

    def __check_init__(self):
        _check_size(self.width, self.height)
        _frame(self.position, self.look_at, self.up)
        if not 0 < self.field_of_view < np.pi:
            raise InputError(
                f"Camera(field_of_view={self.field_of_view!r}): "
                "give radians between 0 and pi"
            )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def _focal(self) -> float:
        return self.height / 2 / np.tan(self.field_of_view / 2)

    def to_raster(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """Perspective: the key is -1 / depth."""
        frame = _frame(self.position, self.look_at, self.up)
        distance = float(np.linalg.norm(np.subtract(self.look_at, self.position)))
        seen = (triangles - np.asarray(self.position)) @ frame.T
        pieces, parent = clip_half_space(seen, _FORWARD, NEAR * distance)
        depth = pieces[..., 2]
        column = self.width / 2 + self._focal * pieces[..., 0] / depth
        row = self.height / 2 + self._focal * pieces[..., 1] / depth
        return np.stack([column, row, -1 / depth], axis=-1), parent

    def points(
        self, pixel: Int[np.ndarray, " p"], key: Float[np.ndarray, " p"]
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
        """Along the ray through each pixel's centre."""
        row, column = _rows_and_columns(pixel, self.width)
        depth = -1 / key
        x = (column - self.width / 2) / self._focal * depth
        y = (row - self.height / 2) / self._focal * depth
        frame = _frame(self.position, self.look_at, self.up)
        return np.stack([x, y, depth], axis=1) @ frame + self.position, depth

    def finer(self, samples: int) -> "Camera":
        """More pixels in the same field of view."""
        return Camera(
            position=self.position,
            look_at=self.look_at,
            up=self.up,
            field_of_view=self.field_of_view,
            width=self.width * samples,
            height=self.height * samples,
        )


class OrthographicCamera(AbstractCamera):
    """Parallel rays; `view_height` metres from the top to the bottom of the image."""

    position: tuple[float, float, float] = eqx.field(static=True)
    """Middle of the image plane [m]; what lies behind it is not drawn."""
    look_at: tuple[float, float, float] = eqx.field(static=True)
    """[m]"""
    view_height: float = eqx.field(static=True)
    """[m]"""
    up: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 1.0))
    width: int = eqx.field(static=True, default=640)
    height: int = eqx.field(static=True, default=480)

    def __check_init__(self):
        _check_size(self.width, self.height)
        _frame(self.position, self.look_at, self.up)
        if not (np.isfinite(self.view_height) and self.view_height > 0):
            raise InputError(
                f"OrthographicCamera(view_height={self.view_height!r}): "
                "give a positive length in metres"
            )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    def to_raster(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """Parallel: the key is the depth."""
        frame = _frame(self.position, self.look_at, self.up)
        seen = (triangles - np.asarray(self.position)) @ frame.T
        pieces, parent = clip_half_space(seen, _FORWARD, 0.0)
        scale = self.height / self.view_height
        column = self.width / 2 + scale * pieces[..., 0]
        row = self.height / 2 + scale * pieces[..., 1]
        return np.stack([column, row, pieces[..., 2]], axis=-1), parent

    def points(
        self, pixel: Int[np.ndarray, " p"], key: Float[np.ndarray, " p"]
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
        """Straight forward from each pixel's centre."""
        row, column = _rows_and_columns(pixel, self.width)
        scale = self.view_height / self.height
        x, y = (column - self.width / 2) * scale, (row - self.height / 2) * scale
        frame = _frame(self.position, self.look_at, self.up)
        return np.stack([x, y, key], axis=1) @ frame + self.position, key

    def finer(self, samples: int) -> "OrthographicCamera":
        """More pixels over the same height."""
        return OrthographicCamera(
            position=self.position,
            look_at=self.look_at,
            view_height=self.view_height,
            up=self.up,
            width=self.width * samples,
            height=self.height * samples,
        )


def frame_all(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int = 640,
    height: int = 480,
    direction: tuple[float, float, float] = (-0.35, 1.0, -0.22),
) -> Camera:
    """A camera that looks along `direction` and just holds all triangles."""
    corners = triangles.reshape(-1, 3)
    middle = (corners.min(0) + corners.max(0)) / 2
    forward = unit_vector(direction)
    probe = _frame((0.0, 0.0, 0.0), forward, (0.0, 0.0, 1.0))
    x, y, z = np.moveaxis((corners - middle) @ probe.T, -1, 0)
    field_of_view, margin = 0.5, 1.06
    slope = np.tan(field_of_view / 2) / margin
    reach = np.maximum(np.abs(y) / slope, np.abs(x) / (slope * width / height))
    position = middle - forward * float((reach - z).max())
    return Camera(
        position=_point(position),
        look_at=_point(middle),
        field_of_view=field_of_view,
        width=width,
        height=height,
    )
