"""Cameras and recorders of a config, framing the scene where it leaves them open."""

import math

import numpy as np
from jaxtyping import Float

from ..geometry.vectors import unit_vector
from ..image.render import Recorder, in_order
from ..image.surface.abstract_camera import AbstractCamera
from ..image.surface.camera import (
    Camera,
    OrthographicCamera,
    frame_all,
    lens_camera,
)
from ..image.surface.lens import CameraPose
from ..scene.scene import SolvedSurface
from .schema.image import CameraConfig, ImageConfig, OrthographicConfig, PinholeConfig
from .types.model import build


_Point = tuple[float, float, float]
# Radius of the framed ball over that of the bodies [-]: nothing touches the edge.
_MARGIN = 1.06
# Vertical angle of view of a `Camera` whose config leaves it open [rad].
_FIELD_OF_VIEW = 0.6
_UP = PinholeConfig().up


def build_recorder(camera: AbstractCamera, config: ImageConfig) -> Recorder:
    """A camera with the band and the effects of a config."""
    return Recorder(
        camera,
        band=build(config.band),
        effects=in_order(build(config.effects), "image.effects"),
        samples=config.samples,
        smooth=config.smooth,
        occlusion=config.occlusion,
    )


def camera_on(
    config: CameraConfig, surfaces: tuple[SolvedSurface, ...]
) -> AbstractCamera:
    """The camera on the surfaces of bodies, see `build_camera`."""
    triangles = [surface.geometry.triangles for surface in surfaces]
    return build_camera(config, np.concatenate(triangles))


def build_camera(
    config: CameraConfig, triangles: Float[np.ndarray, "f 3 3"]
) -> AbstractCamera:
    """The camera; values that the config leaves open are chosen to show all bodies."""
    fitted = frame_all(triangles, config.width, config.height)
    look_at = config.look_at or fitted.look_at
    radius = _radius(triangles, look_at)
    aspect = min(1.0, config.width / config.height)
    if isinstance(config, OrthographicConfig):
        return OrthographicCamera(
            position=config.position or _in_front(fitted, look_at, 2.0 * radius),
            look_at=look_at,
            up=config.up,
            view_height=config.view_height or 2.0 * radius / aspect,
            width=config.width,
            height=config.height,
        )
    left_open = (config.position, config.look_at, config.field_of_view)
    matrices = (config.K, config.world_to_camera)
    if left_open == (None, None, None) and config.up == _UP and not any(matrices):
        return fitted
    lens = config.lens
    angle = config.field_of_view or _FIELD_OF_VIEW
    pose = config.pose
    if pose is None:
        # The ball has to fit into the narrower of the vertical and horizontal angles.
        slope = math.tan(angle / 2.0) * aspect if lens is None else lens.least_slope
        distance = radius / math.sin(math.atan(slope))
        pose = CameraPose(
            position=config.position or _in_front(fitted, look_at, distance),
            look_at=look_at,
            up=config.up,
        )
    if lens is not None:
        return lens_camera(lens, pose)
    return Camera(
        position=pose.position,
        look_at=pose.look_at,
        up=pose.up,
        field_of_view=angle,
        width=config.width,
        height=config.height,
    )


def _radius(triangles: Float[np.ndarray, "f 3 3"], centre: _Point) -> float:
    offsets = triangles.reshape(-1, 3) - np.asarray(centre)
    distances = np.linalg.norm(offsets, axis=1)
    return _MARGIN * float(distances.max())


def _in_front(fitted: Camera, look_at: _Point, distance: float) -> _Point:
    # On the line through `look_at` along the fitted camera's view.
    ahead = unit_vector(np.subtract(fitted.look_at, fitted.position))
    x, y, z = np.asarray(look_at) - distance * ahead
    return float(x), float(y), float(z)
