"""From a config to a camera, framing the scene where the config leaves it open."""

import math

import numpy as np
from jaxtyping import Float

from ..image.camera import AbstractCamera, Camera, OrthographicCamera, frame_all
from .schema_image import CameraConfig, OrthographicConfig, PinholeConfig


Point = tuple[float, float, float]
_MARGIN = 1.06
_FIELD_OF_VIEW = 0.6
_UP = PinholeConfig().up


def build_camera(
    config: CameraConfig, triangles: Float[np.ndarray, "f 3 3"]
) -> AbstractCamera:
    """The camera; what the config leaves open is chosen so that the scene fits in.

    Args:
        config: of a pinhole or an orthographic camera.
        triangles: all the bodies', in the world [m].
    """
    fitted = frame_all(triangles, config.width, config.height)
    look_at = config.look_at or fitted.look_at
    radius = _radius(triangles, look_at)
    narrow = min(1.0, config.width / config.height)
    if isinstance(config, OrthographicConfig):
        return OrthographicCamera(
            position=config.position or _before(fitted, look_at, 2.0 * radius),
            look_at=look_at,
            up=config.up,
            view_height=config.view_height or 2.0 * radius / narrow,
            width=config.width,
            height=config.height,
        )
    left_open = (config.position, config.look_at, config.field_of_view)
    if left_open == (None, None, None) and config.up == _UP:
        return fitted
    angle = config.field_of_view or _FIELD_OF_VIEW
    half = math.atan(math.tan(angle / 2.0) * narrow)
    return Camera(
        position=config.position or _before(fitted, look_at, radius / math.sin(half)),
        look_at=look_at,
        up=config.up,
        field_of_view=angle,
        width=config.width,
        height=config.height,
    )


def _radius(triangles: Float[np.ndarray, "f 3 3"], middle: Point) -> float:
    """Of the ball about the point that holds everything, with a margin [m]."""
    away = triangles.reshape(-1, 3) - np.asarray(middle)
    return _MARGIN * float(np.linalg.norm(away, axis=1).max())


def _before(fitted: Camera, look_at: Point, distance: float) -> Point:
    """The point from which the fitted camera's view direction meets `look_at`."""
    ahead = np.subtract(fitted.look_at, fitted.position)
    ahead = ahead / np.linalg.norm(ahead)
    x, y, z = np.asarray(look_at) - distance * ahead
    return float(x), float(y), float(z)
