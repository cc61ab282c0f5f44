"""Lenses: where a point before a camera is on its image, and back.

A point at (X, Y, Z) in the camera's axes, right, down and forward, has the tangents
x = X / Z and y = Y / Z. A lens bends them as Brown and Conrady have it,

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y,

with r^2 = x^2 + y^2, and the image is at column c_x + f_x x', row c_y + f_y y'.

Without jax, so that a config can check a camera before jax is loaded.

Source: D. C. Brown, Photogrammetric Engineering 37 (1971) 855; the coefficients are in
the order of OpenCV, k1, k2, p1, p2, k3.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
from ...geometry.vectors import triple


_STRAIGHT = 1 / 256
"""Largest distance of a curved edge from the straight ones that stand for it
[pixels]."""
_NEWTON_STEPS = 50
_CONVERGED = 1e-12
"""Largest last step of tangents [-]."""
_CHUNK = 2**14
"""Points that are computed together: temporaries stay in the cache."""
_CACHED_PIXELS = 2**22
"""Largest image whose rays are kept."""
_OFF_MIDDLE = 0.15
"""Largest distance of a principal point from the middle, over the size of the image.

That of a camera is in the middle but for some hundredths; a picture of half the size
would have it at a quarter."""
_FAR_ORIGIN = 1.0
"""Largest distance from a calibrated camera to the point that it looks at [m]."""
_NOT_ORTHOGONAL = 1e-3
"""Largest error of the products of rows of a rotation, as rounded in a file [-]."""


class _BentPieces(NamedTuple):
    """Pieces of triangles on an image."""

    corners: Float[np.ndarray, "k 3 3"]
    """Column, row and key."""
    parent: Int[np.ndarray, " k"]
    """Number of the triangle of each piece."""


class _Bent(NamedTuple):
    """Tangents behind a lens, and their derivatives by those before it."""

    x: Float[np.ndarray, "*n"]
    y: Float[np.ndarray, "*n"]
    x_by_x: Float[np.ndarray, "*n"]
    x_by_y: Float[np.ndarray, "*n"]
    """Derivative of x' by y, which is that of y' by x."""
    y_by_y: Float[np.ndarray, "*n"]

    @property
    def determinant(self) -> Float[np.ndarray, "*n"]:
        """Area on the image over that of the tangents [-]; negative in a fold."""
        return self.x_by_x * self.y_by_y - self.x_by_y**2


@dataclass(frozen=True)
class Lens:
    """Focal lengths, principal point and distortion of a camera.

    Columns and rows count from the left and upper edges of the image.
    """

    width: int
    """[pixels]."""
    height: int
    """[pixels]."""
    focal_lengths: tuple[float, float]
    """Across and down [pixels]."""
    principal_point: tuple[float, float]
    """Column and row on the optical axis [pixels]."""
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2 and k3 [-]; empty without distortion."""

    def image(self, tangents: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Columns and rows of tangents."""
        if self.distortion:
            bent = self._bent(tangents)
            tangents = np.stack([bent.x, bent.y], axis=-1)
        return np.asarray(self.principal_point) + self.focal_lengths * tangents

    def tangents(
        self, pixel: Int[np.ndarray, " p"] | None = None
    ) -> Float[np.ndarray, "p 2"]:
        """Tangents of the centres of pixels, all if None."""
        if self.distortion and self.width * self.height <= _CACHED_PIXELS:
            all_tangents = _all_tangents(self)
            return all_tangents if pixel is None else all_tangents[pixel]
        return self._centre_tangents(pixel)

    @property
    def least_slope(self) -> float:
        """Tangent of half of the angle of view, across or down, but for distortion."""
        across, down = self.focal_lengths
        return min(self.width / across, self.height / down) / 2

    def check(self) -> None:
        """Refuse a distortion that folds the image.

        Raises:
            InputError: if a ray of a pixel is not the only one that is bent into it.
        """
        corners = self.edges
        low, high = corners
        across, down = np.linspace(low, high, 17).T
        tangents = np.stack(np.meshgrid(across, down), axis=-1)
        with np.errstate(all="ignore"):
            unfolded = self._bent(tangents).determinant > 0
        if not (np.isfinite(corners).all() and unfolded.all()):
            raise InputError(
                f"Camera(distortion={self.distortion}): folds a picture of "
                f"{self.width} x {self.height} pixels, so that some have no ray: check "
                "the coefficients, in the order k1, k2, p1, p2, k3, and the size"
            )

    @property
    def edges(self) -> Float[np.ndarray, "2 2"]:
        """Smallest and largest tangents of the edges of the image."""
        across = np.linspace(0, self.width, self.width + 1)
        down = np.linspace(0, self.height, self.height + 1)
        columns = [across, across, np.zeros(len(down)), np.full(len(down), self.width)]
        rows = [np.zeros(len(across)), np.full(len(across), self.height), down, down]
        image = np.stack([np.concatenate(columns), np.concatenate(rows)], axis=1)
        with np.errstate(all="ignore"):
            tangents = self._unbent(image)
        return np.stack([tangents.min(axis=0), tangents.max(axis=0)])

    def straightened(self, corners: Float[np.ndarray, "f 3 3"]) -> _BentPieces:
        """Pieces of triangles whose straight edges are curves on the image.

        Args:
            corners: tangents and key.

        An edge of the length l, up to r from the optical axis, is at most

            l^2 / 8 f (6 |k1| r + 20 |k2| r^3 + 42 |k3| r^5 + 6 |p1| + 6 |p2|)

        off its curve, since the sum bounds second derivatives. Longer ones are halved:
        by edges, so that both of their triangles do the same.
        """
        parent = np.arange(len(corners))
        pieces: list[np.ndarray] = []
        parents: list[np.ndarray] = []
        while len(corners):
            following = corners[:, [1, 2, 0]]
            radius = np.hypot(corners[..., 0], corners[..., 1])
            farther = np.maximum(radius, radius[:, [1, 2, 0]])
            square = ((following - corners)[..., :2] ** 2).sum(axis=-1)
            sag = square / 8 * self._bend(farther)
            is_bent = sag.max(axis=1) > _STRAIGHT
            pieces.append(corners[~is_bent])
            parents.append(parent[~is_bent])
            # From the corner before the most bent edge.
            first = sag[is_bent].argmax(axis=1)
            order = (first[:, None] + np.arange(3)) % 3
            turned = np.take_along_axis(corners[is_bent], order[..., None], axis=1)
            a, b, c = np.moveaxis(turned, 1, 0)
            middle = (a + b) / 2
            halves = [np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)]
            corners = np.concatenate(halves)
            parent = np.tile(parent[is_bent], 2)
        straight = np.concatenate([np.empty((0, 3, 3)), *pieces])
        image = self.image(straight[..., :2])
        return _BentPieces(
            corners=np.concatenate([image, straight[..., 2:]], axis=-1),
            parent=np.concatenate([np.empty(0, int), *parents]),
        )

    def _bend(self, radius: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Bound of the second derivatives of the image up to a radius [pixels]."""
        k1, k2, p1, p2, k3 = map(abs, self.distortion)
        radial = 6 * k1 * radius + 20 * k2 * radius**3 + 42 * k3 * radius**5
        return max(self.focal_lengths) * (radial + 6 * p1 + 6 * p2)

    def _bent(self, tangents: Float[np.ndarray, "*n 2"]) -> _Bent:
        k1, k2, p1, p2, k3 = self.distortion
        x, y = np.moveaxis(tangents, -1, 0)
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        # Derivative of the radial factor by the square of the radius.
        slope = k1 + square * (2 * k2 + square * 3 * k3)
        return _Bent(
            x=x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y=y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            x_by_x=radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
            x_by_y=2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
            y_by_y=radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
        )

    def _centre_tangents(
        self, pixel: Int[np.ndarray, " p"] | None
    ) -> Float[np.ndarray, "p 2"]:
        pixel = np.arange(self.width * self.height) if pixel is None else pixel
        row, column = np.divmod(pixel, self.width)
        return self._unbent(np.stack([column + 0.5, row + 0.5], axis=1))

    def _unbent(self, image: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 2"]:
        """Tangents of columns and rows; not a number where steps do not end."""
        bent = (image - self.principal_point) / self.focal_lengths
        if not self.distortion:
            return bent
        chunks = [
            self._unbent_tangents(bent[first : first + _CHUNK])
            for first in range(0, len(bent), _CHUNK)
        ]
        return np.concatenate([bent[:0], *chunks])

    def _unbent_tangents(self, bent: Float[np.ndarray, "p 2"]) -> np.ndarray:
        """Tangents before the lens of those behind it, by Newton's steps.

        They start from the bent tangents: from there they approach those of a monotonic
        radial distortion from one side.
        """
        tangents = bent
        for _ in range(_NEWTON_STEPS):
            trial = self._bent(tangents)
            x = trial.x - bent[:, 0]
            y = trial.y - bent[:, 1]
            step_x = (trial.y_by_y * x - trial.x_by_y * y) / trial.determinant
            step_y = (trial.x_by_x * y - trial.x_by_y * x) / trial.determinant
            step = np.stack([step_x, step_y], axis=1)
            tangents = tangents - step
            if np.abs(step).max() < _CONVERGED:
                return tangents
        is_converged = np.all(np.abs(step) < _CONVERGED, axis=1)
        return np.where(is_converged[:, None], tangents, np.nan)


@lru_cache(maxsize=4)
def _all_tangents(lens: Lens) -> Float[np.ndarray, "p 2"]:
    tangents = lens._centre_tangents(None)
    tangents.flags.writeable = False
    return tangents


@lru_cache(maxsize=64)
def check_lens(lens: Lens) -> None:
    """Refuse a distortion that folds the image, as `Lens.check`; each lens once."""
    lens.check()


def checked_distortion(distortion: Any) -> tuple[float, ...]:
    """Coefficients k1, k2, p1, p2 and k3, which may be left out; none if all are 0.

    Raises:
        InputError: for another number of them, or one that is not finite.
    """
    try:
        numbers = np.asarray(distortion, float).ravel()
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if len(numbers) not in (0, 4, 5) or not np.isfinite(numbers).all():
        raise InputError(
            f"Camera(distortion={distortion!r}): give k1, k2, p1, p2 and perhaps k3 of "
            "Brown and Conrady, in this order"
        )
    if not numbers.any():
        return ()
    third_radial = [0.0] * (5 - len(numbers))
    return (*numbers.tolist(), *third_radial)


def lens_of_matrix(K: Any, width: int, height: int, distortion: Any = ()) -> Lens:
    """Lens of an intrinsic matrix.

    Args:
        K: ((f_x, 0, c_x), (0, f_y, c_y), (0, 0, 1)) [pixels], with the centre of the
            first pixel at (0, 0), as in OpenCV.
        width: of the pictures that K was found with [pixels].
        height: of the pictures that K was found with [pixels].
        distortion: coefficients, see `checked_distortion`.

    Raises:
        InputError: for another matrix, or one of pictures of another size.
    """
    matrix = _matrix(K, "Camera.calibrated(K=...)", ((3, 3),))
    (f_x, skew, c_x), (below, f_y, c_y), last = matrix.tolist()
    if last != [0, 0, 1] or below != 0 or abs(skew) > 1e-9 * abs(f_x):
        raise InputError(
            "Camera.calibrated(K=...): give ((f_x, 0, c_x), (0, f_y, c_y), (0, 0, 1)) "
            "in pixels"
        )
    if not (f_x > 0 and f_y > 0):
        raise InputError(
            f"Camera.calibrated(K=...): focal lengths of {f_x:g} and {f_y:g} pixels: "
            "give positive ones"
        )
    for centre, size in ((c_x, width), (c_y, height)):
        if abs((centre + 0.5) / size - 0.5) > _OFF_MIDDLE:
            raise InputError(
                f"Camera.calibrated(K=...): has its principal point at ({c_x:g}, "
                f"{c_y:g}), far from the middle of a picture of {width} x {height} "
                "pixels: it is of pictures of another size; give that size, or K of "
                "this one"
            )
    return Lens(
        width=width,
        height=height,
        focal_lengths=(f_x, f_y),
        principal_point=(c_x + 0.5, c_y + 0.5),
        distortion=checked_distortion(distortion),
    )


class CameraPose(NamedTuple):
    """Position and direction of a camera, as the fields of `Camera`."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]


def pose_of_matrix(world_to_camera: Any) -> CameraPose:
    """Position and direction of a camera by its extrinsic matrix.

    `look_at` is on the optical axis, as far from the camera as the world's origin, but
    at most 1 m.

    Args:
        world_to_camera: ((R, t), (0, 1)) with X_camera = R X_world + t [m], in OpenCV's
            axes: right, down and forward. The last row may be left out.

    Raises:
        InputError: for a matrix of another shape, or one that does more than turn and
            move.
    """
    name = "Camera.calibrated(world_to_camera=...)"
    matrix = _matrix(world_to_camera, name, ((3, 4), (4, 4)))
    if len(matrix) == 4 and matrix[3].tolist() != [0, 0, 0, 1]:
        raise InputError(
            f"{name}: its last row is (0, 0, 0, 1): give R and t in metres"
        )
    rotation = matrix[:3, :3]
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if error > _NOT_ORTHOGONAL or np.linalg.det(rotation) < 0:
        raise InputError(
            f"{name}: its first three columns are no rotation: give R and t with "
            "X_camera = R X_world + t, axes right, down and forward"
        )
    left, _, right = np.linalg.svd(rotation)
    axes = left @ right
    position = -axes.T @ matrix[:3, 3]
    # The near plane, at a fraction of it, must not cut a body far from the origin.
    distance = min(float(np.linalg.norm(position)), _FAR_ORIGIN) or _FAR_ORIGIN
    return CameraPose(
        position=triple(position),
        look_at=triple(position + distance * axes[2]),
        up=triple(-axes[1]),
    )


def _matrix(
    value: Any, name: str, shapes: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "m n"]:
    try:
        matrix = np.asarray(value, float)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape not in shapes or not np.isfinite(matrix).all():
        sizes = " or ".join(f"{rows} x {columns}" for rows, columns in shapes)
        raise InputError(f"{name}: give a matrix of {sizes} finite numbers")
    return matrix
