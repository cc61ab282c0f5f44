"""Cameras in general: pixels, rays, and projection of triangles onto the image."""

import abc
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int, Shaped

from ...arrays import linear_map
from ...errors import InputError
from ...geometry.vectors import unit_vector
from ...raster.views import clip_half_space


FORWARD = np.array([0.0, 0.0, 1.0])
"""The optical axis in the camera's axes."""


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
        return view_frame(self.position, self.look_at, self.up)

    @property
    @abc.abstractmethod
    def _near(self) -> float:
        """Depth before which nothing is drawn [m]."""

    @abc.abstractmethod
    def _on_image(self, local: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Project points in camera axes [m] to (column, row, key)."""

    @property
    @abc.abstractmethod
    def bends(self) -> bool:
        """True if straight edges are curves on the image."""

    @abc.abstractmethod
    def _pieces_on_image(
        self, local: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """Triangles (column, row, key) of triangles in camera axes ahead [m].

        Returns:
            Pieces with straight edges, and the index of the triangle of each piece.
        """

    @abc.abstractmethod
    def in_one_row(self, count: int) -> "AbstractCamera":
        """Camera of as many pixels in one row, whose rays have no meaning."""

    def to_raster(
        self, triangles: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        """Clip and project world triangles to (column, row, key).

        The key grows with depth and is linear over the image, so that rasterized
        fragments sort by it.

        Returns:
            The visible pieces, and the index of the triangle of each piece.
        """
        ahead, parent = clip_half_space(self._local(triangles), FORWARD, self._near)
        pieces, clipped = self._pieces_on_image(ahead)
        return pieces, parent[clipped]

    def mesh_to_raster(
        self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
    ) -> _RasterMesh:
        """Clip and project a mesh as `to_raster`, each vertex once if edges stay."""
        if self.bends:
            pieces, piece_parent = self.to_raster(vertices[faces])
            return _RasterMesh(
                points=pieces.reshape(-1, 3),
                faces=np.arange(3 * len(pieces)).reshape(-1, 3),
                parent=piece_parent,
            )
        local = self._local(vertices)
        ahead = local[:, 2] >= self._near
        if ahead.all():
            return _RasterMesh(
                points=self._on_image(local),
                faces=faces,
                parent=np.arange(len(faces)),
            )
        # What is behind the pinhole would be projected upside down.
        local[~ahead] = self._near * FORWARD
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


# A frame in a new view needs it several times.
@lru_cache(maxsize=64)
def view_frame(position, look_at, up) -> Float[np.ndarray, "3 3"]:
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
