"""When to step: equal steps between the times that must be landed on exactly."""

import math
from dataclasses import dataclass

from ...errors import InputError


MOST_STEPS = 2**31 - 1
"""In one interval: they are counted in 32 bits."""

END_SHARE, END_ROUNDINGS = 1e-6, 8
"""How long before its end, in steps and at least in roundings of the time, the end of a
step takes its loads: just before whatever is switched there."""


@dataclass(frozen=True)
class Interval:
    """`steps` steps of `dt` from `start`, ending at `end` to rounding [s]."""

    start: float
    end: float
    steps: int
    saved: bool
    """Whether `end` is a save time."""

    @property
    def dt(self) -> float:
        """One step [s]."""
        return (self.end - self.start) / self.steps


def save_times(t1: float | int, save_at) -> tuple[float, ...]:
    """The save times, checked; the end alone if none are given.

    Raises:
        InputError: if they do not increase within [0, t1].
    """
    if not math.isfinite(t1) or t1 < 0:
        raise InputError(f"t1={t1!r}: give an end time of at least 0 s")
    times = (t1,) if save_at is None else tuple(float(t) for t in save_at)
    if not times:
        raise InputError("save_at is empty: give at least one time, or leave it out")
    if any(not b > a for a, b in zip(times, times[1:], strict=False)):
        raise InputError(f"save_at={list(times)}: the times must increase")
    if not (times[0] >= 0 and times[-1] <= t1):
        raise InputError(f"save_at={list(times)}: the times must lie in [0, {t1:g}] s")
    return times


def schedule(
    t1: float | int,
    saves: tuple[float, ...],
    knots: tuple[float, ...],
    dt: float,
    least: int = 1,
) -> tuple[Interval, ...]:
    """Intervals between save times, breaks of the terms' values, and the end.

    Args:
        t1: end [s].
        saves: increasing times in [0, t1].
        knots: other times to land on.
        dt: the largest step allowed [s]; may be infinite.
        least: steps in each.

    Raises:
        InputError: if that takes more steps than can be counted.
    """
    if not dt > 0:
        raise InputError(
            f"the largest stable step is {dt:g} s: check the materials and terms for "
            "values far out of range"
        )
    stops = sorted({*saves, *(k for k in knots if 0 < k < t1), t1} - {0.0})
    intervals, start = [], 0.0
    for stop in stops:
        # A quotient that is whole but for rounding must not cost a step more.
        steps = max(least, math.ceil((stop - start) / dt * (1 - 1e-9)))
        if steps > MOST_STEPS:
            raise InputError(
                f"{stop - start:g} s take {steps:.2g} steps of {dt:.3g} s, the largest "
                "stable step: simulate a shorter time, or use a coarser pitch"
            )
        intervals.append(Interval(start, stop, steps, stop in saves))
        start = stop
    return tuple(intervals)


def legs(intervals: tuple[Interval, ...]) -> tuple[tuple[Interval, ...], ...]:
    """Intervals grouped by the save time they lead to; what follows the last one last.

    Only the end of a leg is observed: a table of thousands of knots costs no memory.
    """
    groups: list[tuple[Interval, ...]] = []
    group: list[Interval] = []
    for interval in intervals:
        group.append(interval)
        if interval.saved:
            groups.append(tuple(group))
            group = []
    return tuple([*groups, tuple(group)] if group else groups)
