"""From a validated config to where a body stands, or how it moves."""

import math

import numpy as np

from ..geometry.pose import Pose
from ..scene.motion import Motion, PoseTable
from .schema_pose import AnyPose, MotionConfig, PoseConfig


def build_pose(config: AnyPose) -> Pose | Motion:
    """A pose, or a table of poses that is taken anew every so often."""
    if isinstance(config, MotionConfig):
        poses = tuple(_pose(pose) for pose in config.poses)
        return Motion(PoseTable(config.times, poses), every=config.every)
    return _pose(config)


def _pose(config: PoseConfig) -> Pose:
    """The rotation matrix by Rodrigues' formula, and the translation."""
    turn = config.rotation
    if turn is None:
        return Pose(translation=config.translation)
    x, y, z = np.asarray(turn.axis) / math.hypot(*turn.axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = math.sin(turn.angle), math.cos(turn.angle)
    matrix = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    rows = [(float(a), float(b), float(c)) for a, b, c in matrix]
    return Pose(translation=config.translation, rotation=tuple(rows))
