"""Moving bodies: poses as a function of time, by a table or a function.

Between two poses of a table a body moves along a straight line at constant speed while
it turns about one axis at a constant rate (spherical interpolation, Shoemake 1985).
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Float

from ..errors import InputError
from ..geometry.mesh import Pose


if TYPE_CHECKING:
    _PoseFunction = Callable[[float], Pose]
else:
    # Checked by the class, which says what to give instead.
    _PoseFunction = Any

# Each snapshot of a run searches for shadows and contacts, and makes a program.
_MAX_SNAPSHOTS = 10_000


class PoseTable(Module):
    """Poses at increasing times, constant before the first and after the last."""

    times: tuple[float, ...] = eqx.field(
        static=True, converter=lambda times: tuple(float(t) for t in times)
    )
    """[s]"""
    poses: tuple[Pose, ...] = eqx.field(static=True, converter=tuple)

    def __check_init__(self):
        if not self.times or len(self.times) != len(self.poses):
            raise InputError(
                f"PoseTable: {len(self.times)} times and {len(self.poses)} poses; "
                "give as many of each, at least one"
            )
        # An infinite time has no pose halfway.
        gaps = np.diff(self.times)
        if not np.isfinite(self.times).all() or (gaps <= 0).any():
            raise InputError("PoseTable: the times must be finite and increase")

    def __call__(self, time: float) -> Pose:
        """The pose at `time` [s]."""
        next_pose = int(np.searchsorted(self.times, time, side="right"))
        if next_pose in (0, len(self.times)):
            return self.poses[min(next_pose, len(self.times) - 1)]
        start = self.times[next_pose - 1]
        fraction = (time - start) / (self.times[next_pose] - start)
        return _between(self.poses[next_pose - 1], self.poses[next_pose], fraction)


class Motion(Module):
    """A pose that changes with time, in snapshots."""

    path: _PoseFunction = eqx.field(static=True)
    """A `PoseTable`, or a function of time [s] that returns a `Pose`."""
    every: float | int | None = eqx.field(static=True, default=None, kw_only=True)
    """Interval between snapshots of the geometry [s]; None: a table's own times."""

    def __check_init__(self):
        if not isinstance(self.path, PoseTable) and not callable(self.path):
            raise InputError(
                f"Motion({self.path!r}): give a PoseTable or a function of time"
            )
        if self.every is None and not isinstance(self.path, PoseTable):
            raise InputError("Motion: give every=, in seconds, with a function of time")
        if self.every is not None and not 0 < float(self.every) < math.inf:
            raise InputError(
                f"Motion(every={self.every!r}): give a positive number of seconds"
            )

    @property
    def is_still(self) -> bool:
        """True if all poses of a table are the same; a function may always move."""
        path = self.path
        return isinstance(path, PoseTable) and all(
            pose == path.poses[0] for pose in path.poses
        )

    def at(self, time: float | int) -> Pose:
        """The pose at `time` [s].

        Raises:
            InputError: if the function returns anything else than a pose.
        """
        pose = self.path(float(time))
        if not isinstance(pose, Pose):
            raise InputError(
                f"Motion: its function gave {pose!r} at {float(time):g} s, not a Pose"
            )
        return pose

    def snapshot_times(self, end: float | int) -> tuple[float, ...]:
        """Times between 0 and `end` [s] at which new snapshots start.

        Raises:
            InputError: if there are too many.
        """
        if self.is_still:
            return ()
        if self.every is None:
            times = self.path.times
        else:
            # A last snapshot a rounding error before the end would see nothing new.
            snapshots = math.ceil(end / self.every * (1 - 1e-12))
            if snapshots > _MAX_SNAPSHOTS:
                raise InputError(
                    f"Motion(every={self.every:g}): {snapshots} snapshots of the "
                    f"geometry in {end:g} s; give {end / _MAX_SNAPSHOTS:.2g} s or more"
                )
            # Products, not sums, which would collect rounding.
            times = (self.every * k for k in range(1, snapshots))
        return tuple(float(t) for t in times if 0 < t < end)


def _between(first: Pose, second: Pose, fraction: float) -> Pose:
    """The pose at a fraction of the way between two, turned the short way."""
    if fraction == 0 or first == second:
        return first
    start = np.asarray(first.translation, float)
    end = np.asarray(second.translation, float)
    translation = (1 - fraction) * start + fraction * end
    turned = _slerp(_quaternion(first), _quaternion(second), fraction)
    x, y, z = translation.tolist()
    return Pose((x, y, z), tuple(tuple(row) for row in _matrix(turned).tolist()))


def _slerp(a, b, fraction: float) -> Float[np.ndarray, "4"]:
    """Interpolation between unit quaternions at a constant rate of turn."""
    cosine = float(a @ b)
    # A quaternion and its reverse are the same turn; the nearer one is the short way.
    b = b if cosine >= 0 else -b
    angle = 2 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
    # The formula for larger angles would divide rounding by rounding.
    if angle < 1e-9:
        blend = (1 - fraction) * a + fraction * b
    else:
        blend = math.sin((1 - fraction) * angle) * a + math.sin(fraction * angle) * b
    return blend / np.linalg.norm(blend)


def _quaternion(pose: Pose) -> Float[np.ndarray, "4"]:
    """The rotation of a pose as (w, x, y, z)."""
    # The outer product of the quaternion with itself is linear in the rotation matrix;
    # its row with the largest diagonal loses no digits (Shepperd 1978).
    (a, b, c), (d, e, f), (g, h, i) = pose.rotation
    product = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    row = product[int(np.argmax(np.diag(product)))]
    return row / np.linalg.norm(row)


def _matrix(quaternion) -> Float[np.ndarray, "3 3"]:
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
