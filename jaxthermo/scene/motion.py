"""Moving bodies: poses as a function of time, by a table or a function.

Between two poses of a table a body moves along a straight line at constant speed while
it turns about one axis at a constant rate: by the difference of their angles where both
are given by angles about one axis, full turns included, else the short way (spherical
interpolation, Shoemake 1985).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Float

from ..errors import InputError
from ..geometry.mesh import Pose
from ..geometry.rotation import Way
from ..geometry.vectors import triple
from ..memo.once import once


if TYPE_CHECKING:
    _PoseFunction = Callable[[float], Pose]
else:
    # Checked by the class, which says what to give instead.
    _PoseFunction = Any

# Each snapshot of a run searches for shadows and contacts, and makes a program.
_MAX_SNAPSHOTS = 10_000

_MAX_SNAPSHOT_TURN = math.pi * (1 - 1e-9)
"""Turn between two snapshots from which they cannot show which way it goes [rad]."""

_GOOD_SNAPSHOT_TURN = math.radians(10)
"""Turn between two snapshots at which loads follow the body to about 1 % [rad]."""


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

    @property
    def ways(self) -> tuple[Way, ...]:
        """The rotations from each pose to the next."""
        return tuple(first.way_to(second) for first, second in pairwise(self.poses))

    def angles_until(self, times: Sequence[float]) -> Float[np.ndarray, " t"]:
        """Angle turned up to each of some times, in whatever directions [rad]."""
        angles = [abs(way.turn.angle) for way in self.ways]
        return np.interp(times, self.times, np.cumsum([0.0, *angles]))


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
        if not isinstance(path, PoseTable):
            return False
        first = path.poses[0]
        same = all(pose.key == first.key for pose in path.poses)
        return same and not path.angles_until(path.times[-1:]).any()

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

    def warnings(self, starts: Sequence[float], end: float) -> Iterator[str]:
        """A line about each turn that its poses or snapshots leave open.

        The snapshots are made at `starts`, and the last one serves up to `end` [s].
        """
        path = self.path
        if not isinstance(path, PoseTable):
            return
        for (first, second), way in zip(pairwise(path.times), path.ways, strict=True):
            if way.is_ambiguous:
                yield (
                    f"its poses at {first:g} and {second:g} s are half a turn apart, "
                    "which both ways round are: give a pose between them, or both by "
                    "an axis and an angle"
                )
        times = (*starts, end)
        turned = np.diff(path.angles_until(times))
        longest = int(np.argmax(turned))
        if turned[longest] >= _MAX_SNAPSHOT_TURN:
            first, second = times[longest : longest + 2]
            every = (second - first) * _GOOD_SNAPSHOT_TURN / turned[longest]
            yield (
                f"it turns by {math.degrees(turned[longest]):.4g} degrees between its "
                f"snapshots at {first:g} and {second:g} s, which see it at rest there: "
                f"give `every`, such as {every:.2g} s"
            )


def moving_together(
    poses: Sequence[tuple[Pose, ...]], length: float
) -> tuple[tuple[int, ...], ...]:
    """Numbers of bodies, those together that keep their places in one another.

    Args:
        poses: of all bodies at each of some times.
        length: of which a millionth counts as the same place [m].
    """
    groups: dict[tuple, list[int]] = {}

    # Bodies at rest have one pose at all times.
    @once
    def key_of(first: Pose, second: Pose) -> tuple:
        return Pose().relative_key(_displacement(first, second), length)

    for number, first in enumerate(poses[0]):
        way = tuple(key_of(first, at_time[number]) for at_time in poses[1:])
        groups.setdefault(way, []).append(number)
    return tuple(map(tuple, groups.values()))


def _displacement(first: Pose, second: Pose) -> Pose:
    """Movement of the world with a body from one pose to another."""
    if first.key == second.key:
        return Pose()
    turn = np.asarray(second.rotation) @ np.transpose(first.rotation)
    shift = triple(second.translation - turn @ first.translation)
    return Pose(shift, tuple(map(tuple, turn.tolist())))


def _between(first: Pose, second: Pose, fraction: float) -> Pose:
    """The pose at a fraction of the way between two."""
    if fraction == 0 or first == second:
        return first
    start = np.asarray(first.translation, float)
    end = np.asarray(second.translation, float)
    middle = triple((1 - fraction) * start + fraction * end)
    way = first.way_to(second)
    return Pose(middle, way.after(first.rotation, fraction))
