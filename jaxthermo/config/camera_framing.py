"""Cameras from their config, framing the scene where the config leaves them open."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from ..image.surface.camera import AbstractCamera, Camera, OrthographicCamera, frame_all
from .schema.image import CameraConfig, OrthographicConfig, PinholeConfig


Point = tuple[float, float, float]
# Radius of the framed ball over that of the bodies [-]: nothing touches the edge.
_MARGIN = 1.06
# Vertical angle where none is given [rad], as of `Camera`.
_FIELD_OF_VIEW = 0.6
_UP = PinholeConfig().up
_SIZE = ("width", "height")


def build_camera(
    config: CameraConfig, triangles: Float[np.ndarray, "f 3 3"]
) -> AbstractCamera:
    """The camera; values that the config leaves open are chosen to show all bodies."""
    fitted = frame_all(triangles, config.width, config.height)
    look_at = config.look_at or fitted.look_at
    radius = _radius(triangles, look_at)
    narrow = min(1.0, config.width / config.height)
    shared: dict[str, Any] = {key: getattr(config, key) for key in ("up", *_SIZE)}
    shared["look_at"] = look_at
    if isinstance(config, OrthographicConfig):
        return OrthographicCamera(
            position=config.position or _in_front(fitted, look_at, 2.0 * radius),
            view_height=config.view_height or 2.0 * radius / narrow,
            **shared,
        )
    left_open = (config.position, config.look_at, config.field_of_view)
    if left_open == (None, None, None) and config.up == _UP:
        return fitted
    angle = config.field_of_view or _FIELD_OF_VIEW
    # The ball has to fit into the narrower of both angles.
    half = math.atan(math.tan(angle / 2.0) * narrow)
    return Camera(
        position=config.position or _in_front(fitted, look_at, radius / math.sin(half)),
        field_of_view=angle,
        **shared,
    )


def _radius(triangles: Float[np.ndarray, "f 3 3"], centre: Point) -> float:
    away = triangles.reshape(-1, 3) - np.asarray(centre)
    return _MARGIN * float(np.linalg.norm(away, axis=1).max())


def _in_front(fitted: Camera, look_at: Point, distance: float) -> Point:
    # On the line through `look_at` along the fitted camera's view.
    ahead = np.subtract(fitted.look_at, fitted.position)
    ahead = ahead / np.linalg.norm(ahead)
    x, y, z = np.asarray(look_at) - distance * ahead
    return float(x), float(y), float(z)
