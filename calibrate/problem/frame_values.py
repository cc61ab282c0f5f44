"""Values of frames that no scene has: see `config.frame_names`."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxthermo.image.pose.derivative import LinearizedView
from jaxthermo.image.pose.pose import POSE_SIZE

from ..config.frame_names import is_of_camera, pose_numbers


class FrameValues(NamedTuple):
    """Values that frames depend on in addition to those of the scene."""

    poses: Float[Array, "v 6"] | None = None
    """Pose of each camera; None where all are as given."""
    views: tuple[LinearizedView, ...] = ()
    """Views of the cameras near `poses`."""
    reflected: Float[Array, ""] | None = None
    """Temperature that surfaces reflect [K]; None for that of the heat balance."""


AS_GIVEN = FrameValues()
"""Cameras in their given poses, and reflection of what heats the surfaces."""


def poses_at(
    values: Mapping[str, Any], cameras: int, dtype: Any
) -> Float[Array, "v 6"]:
    """Poses of cameras from values by path; 0 where there is none."""
    poses = jnp.zeros((cameras, POSE_SIZE), dtype)
    for name, value in values.items():
        if is_of_camera(name):
            camera, numbers = pose_numbers(name)
            poses = poses.at[camera, jnp.asarray(numbers)].set(jnp.atleast_1d(value))
    return poses
