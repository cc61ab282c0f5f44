"""Poses of a camera relative to the one that was given, by six small numbers.

With the axes F of the given camera (right, down, forward, as rows) at the position p,
the rotation vector w [rad] and the translation t [m], both in these axes, the moved
camera is at p + F^T t, and its rays have the directions F^T R(w) F d of the rays d of
the given camera. All six are 0 for the given pose.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..surface.abstract_camera import AbstractCamera


POSE_SIZE = 6
"""Rotation vector [rad], then translation [m]."""


def moved_camera(
    camera: AbstractCamera, pose: Float[np.ndarray, "6"]
) -> AbstractCamera:
    """Camera in a pose relative to the given one, see above."""
    axes = camera.frame
    # A copy: scipy refuses arrays that cannot be written to.
    turned = Rotation.from_rotvec(np.array(pose[:3])).as_matrix().T @ axes
    position = np.asarray(camera.position) + axes.T @ pose[3:]
    # The distance of the near plane follows from that of `look_at`, which stays.
    distance = np.linalg.norm(np.subtract(camera.look_at, camera.position))
    look_at = position + distance * turned[2]
    up = -turned[1]
    return replace(
        camera,
        position=tuple(position.tolist()),
        look_at=tuple(look_at.tolist()),
        up=tuple(up.tolist()),
    )
