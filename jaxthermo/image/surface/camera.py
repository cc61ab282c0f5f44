"""Cameras with a pinhole and a lens, and with parallel rays."""

import math
from dataclasses import replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ...arrays import linear_map, plain_numbers, static_numbers
from ...errors import InputError
from ...geometry.vectors import unit_vector
from ...raster.views import clip_half_space
from .abstract_camera import FORWARD, AbstractCamera, view_frame
from .lens import (
    CameraPose,
    Lens,
    check_lens,
    checked_distortion,
    lens_of_matrix,
    pose_of_matrix,
)


# Depth of the near plane relative to the distance of `look_at`: at depth 0 the
# projection has no limit.
_NEAR = 0.02


class Camera(AbstractCamera):
    """Pinhole camera, perhaps with the distortion of a lens.

    `Camera.calibrated` makes one of the matrices of a calibration.

    Raises:
        InputError: for an impossible size, view direction or field of view, or a
            distortion that folds the image.
    """

    position: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Position of the pinhole [m]."""
    look_at: tuple[float, float, float] = eqx.field(
        static=True, converter=plain_numbers
    )
    """Point on the optical axis, by default that in the centre of the image [m]."""
    up: tuple[float, float, float] = static_numbers((0.0, 0.0, 1.0))
    field_of_view: float = static_numbers(0.6)
    """Angle a by which the focal length is height / (2 tan(a / 2)) [rad].

    It is that from the top to the bottom of an image whose principal point is in its
    middle, without distortion."""
    width: int = static_numbers(640)
    height: int = static_numbers(480)
    focal_ratio: float = static_numbers(1.0)
    """Focal length across over that down, in pixels [-]."""
    principal_point: tuple[float, float] = static_numbers((0.5, 0.5))
    """Point of the image on the optical axis, over width and height, from the upper
    left corner [-]."""
    distortion: tuple[float, ...] = eqx.field(
        static=True, converter=checked_distortion, default=()
    )
    """Coefficients k1, k2, p1, p2 and perhaps k3 of Brown and Conrady [-], see
    `Lens`."""

    @classmethod
    def calibrated(
        cls,
        K: Any,
        width: int,
        height: int,
        distortion: Any = (),
        world_to_camera: Any = None,
        position: Any = None,
        look_at: Any = None,
        up: Any = (0.0, 0.0, 1.0),
    ) -> "Camera":
        """Camera of the matrices of a calibration, in the conventions of OpenCV.

        Args:
            K: ((f_x, 0, c_x), (0, f_y, c_y), (0, 0, 1)) [pixels], with the centre of
                the first pixel at (0, 0).
            width: of the pictures that K was found with [pixels].
            height: of the pictures that K was found with [pixels].
            distortion: k1, k2, p1, p2 and perhaps k3 of Brown and Conrady [-].
            world_to_camera: ((R, t), (0, 1)) with X_camera = R X_world + t [m], axes
                right, down and forward, as `jaxthermo dataset` writes it.
            position: of the pinhole [m], instead of `world_to_camera`.
            look_at: point on the optical axis [m], with `position`.
            up: direction that is up in the image [-], with `position`.

        Raises:
            InputError: for matrices of another form, a K of pictures of another size,
                or both poses or none.

        Example:
            >>> import jaxthermo as jt
            >>> K = ((741.0, 0.0, 325.0), (0.0, 740.0, 250.0), (0.0, 0.0, 1.0))
            >>> camera = jt.Camera.calibrated(
            ...     K,
            ...     width=640,
            ...     height=512,
            ...     distortion=(-0.274, 0.0, 0.0, 0.0),
            ...     world_to_camera=((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 2)),
            ... )
            >>> camera.position
            (0.0, -2.0, 0.0)
        """
        lens = lens_of_matrix(K, width=width, height=height, distortion=distortion)
        one_pose = "Camera.calibrated: give world_to_camera, or position and look_at"
        if world_to_camera is None:
            if position is None or look_at is None:
                raise InputError(one_pose)
            return lens_camera(lens, CameraPose(position, look_at, up))
        if position is not None or look_at is not None:
            raise InputError(one_pose)
        return lens_camera(lens, pose_of_matrix(world_to_camera))

    def __check_init__(self):
        self._check_view()
        if not 0 < self.field_of_view < np.pi:
            raise InputError(
                f"Camera(field_of_view={self.field_of_view!r}): "
                "give radians between 0 and pi"
            )
        if not (np.isfinite(self.focal_ratio) and self.focal_ratio > 0):
            raise InputError(
                f"Camera(focal_ratio={self.focal_ratio!r}): give a positive number"
            )
        if not all(0 < fraction < 1 for fraction in self.principal_point):
            raise InputError(
                f"Camera(principal_point={self.principal_point!r}): give fractions of "
                "width and height, such as (0.5, 0.5)"
            )
        if self.distortion:
            check_lens(self.lens)

    @property
    def lens(self) -> Lens:
        """Focal lengths, principal point and distortion in pixels."""
        focal = self.height / 2 / np.tan(self.field_of_view / 2)
        across, down = self.principal_point
        return Lens(
            width=self.width,
            height=self.height,
            focal_lengths=(float(self.focal_ratio * focal), float(focal)),
            principal_point=(across * self.width, down * self.height),
            distortion=self.distortion,
        )

    @property
    def K(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsic matrix [pixels], with the centre of the first pixel at (0, 0)."""
        lens = self.lens
        matrix = np.diag([*lens.focal_lengths, 1.0])
        matrix[:2, 2] = np.subtract(lens.principal_point, 0.5)
        return matrix

    @property
    @override
    def _near(self) -> float:
        distance = float(np.linalg.norm(np.subtract(self.look_at, self.position)))
        return _NEAR * distance

    @property
    @override
    def bends(self) -> bool:
        return bool(self.distortion)

    @override
    def _on_image(self, local: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        depth = local[..., 2:]
        image = self.lens.image(local[..., :2] / depth)
        # In perspective the inverse of the depth is linear over the image.
        return np.concatenate([image, -1 / depth], axis=-1)

    @override
    def _pieces_on_image(
        self, local: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        parent = np.arange(len(local))
        if not self.bends:
            return self._on_image(local), parent
        lens = self.lens
        low, high = lens.edges
        # Farther out a lens may bend points back into the image.
        for axis, (least, most) in enumerate(zip(low, high, strict=True)):
            unit = np.eye(3)[axis]
            for normal in (unit - least * FORWARD, most * FORWARD - unit):
                local, clipped = clip_half_space(local, normal, 0.0)
                parent = parent[clipped]
        depth = local[..., 2:]
        pieces = lens.straightened(
            np.concatenate([local[..., :2] / depth, -1 / depth], axis=-1)
        )
        return pieces.corners, parent[pieces.parent]

    @override
    def in_one_row(self, count: int) -> "Camera":
        return replace(self, width=count, height=1, distortion=())

    @override
    def _depth(self, key: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        return -1 / key

    @override
    def rays(
        self, pixel: Int[np.ndarray, " p"] | None = None
    ) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
        tangents = self.lens.tangents(pixel)
        ahead = np.ones((len(tangents), 1))
        step = linear_map(np.concatenate([tangents, ahead], axis=1), self.frame)
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
        lens = self.lens
        # The outline is an ellipse, longest away from the principal point.
        reach = np.tan(off + angle) - np.tan(off)
        if self.bends:
            x, y = lens.tangents().T
            away = np.hypot(x - right / ahead, y - down / ahead)
            return np.flatnonzero(away <= reach)
        ends = []
        for axis, along in enumerate((right, down)):
            focal = lens.focal_lengths[axis]
            middle = focal * along / ahead + lens.principal_point[axis]
            span = np.array([-1, 1]) * (focal * reach + 1)
            ends.append(np.clip(middle + span, 0, self.size[axis]).astype(int))
        (left, right_end), (top, bottom) = ends
        rows = np.arange(top, min(bottom + 1, self.height))
        columns = np.arange(left, min(right_end + 1, self.width))
        return (rows[:, None] * self.width + columns).ravel()


def lens_camera(lens: Lens, pose: CameraPose) -> Camera:
    """Camera with a lens, in a pose."""
    f_x, f_y = lens.focal_lengths
    c_x, c_y = lens.principal_point
    return Camera(
        position=pose.position,
        look_at=pose.look_at,
        up=pose.up,
        field_of_view=2 * math.atan(lens.height / 2 / f_y),
        width=lens.width,
        height=lens.height,
        focal_ratio=f_x / f_y,
        principal_point=(c_x / lens.width, c_y / lens.height),
        distortion=lens.distortion,
    )


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

    @property
    @override
    def bends(self) -> bool:
        return False

    @override
    def _pieces_on_image(
        self, local: Float[np.ndarray, "f 3 3"]
    ) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
        return self._on_image(local), np.arange(len(local))

    @override
    def in_one_row(self, count: int) -> "OrthographicCamera":
        return replace(self, width=count, height=1)

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
    axes = view_frame((0.0, 0.0, 0.0), tuple(forward.tolist()), (0.0, 0.0, 1.0))
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
