"""When a run steps and saves: intervals of equal steps between its events."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import InputError, shortened
from ..solvers import MAX_REFINED_EVENTS


_MAX_INTERVAL_STEPS = 2**31 - 1
"""Steps of one interval: the loop counts them in 32 bits."""

_FIRST_STEPS_AFTER_EVENT = 4
"""Smallest number of steps after an event in the first pass of several."""


_MIN_WIDTH = 8
"""Number of intervals in a row of a table that costs next to nothing."""


@dataclass(frozen=True)
class Interval:
    """Equal steps from `start` to `end` [s]."""

    start: float
    end: float
    steps: int
    saved: bool
    """True if `end` is a save time."""

    @property
    def dt(self) -> float:
        """Length of one step [s]."""
        return (self.end - self.start) / self.steps


def checked_save_times(t1: float | int, save_at) -> tuple[float, ...]:
    """Return the checked save times [s]; the end time alone if none are given."""
    number = not isinstance(t1, str | type(None)) and np.ndim(t1) == 0
    if not number or not math.isfinite(t1) or t1 < 0:
        raise InputError(f"t1={t1!r}: give an end time of at least 0 s")
    try:
        listed = (t1,) if save_at is None else tuple(save_at)
        times = () if isinstance(save_at, str) else tuple(float(t) for t in listed)
    except (TypeError, ValueError):
        raise InputError(
            f"save_at={shortened(save_at)}: give a list of times in seconds, such as "
            "[30.0, 60.0]"
        ) from None
    if not times:
        raise InputError("save_at is empty: give at least one time, or leave it out")
    # Negated, so that NaN is refused too.
    if any(not b > a for a, b in zip(times, times[1:], strict=False)):
        raise InputError(f"save_at={list(times)}: the times must increase")
    if not (times[0] >= 0 and times[-1] <= t1):
        raise InputError(f"save_at={list(times)}: the times must lie in [0, {t1:g}] s")
    return times


def schedule(
    t1: float | int,
    saves: tuple[float, ...],
    event_times: tuple[float, ...],
    max_dt: float,
    min_steps: int = 1,
) -> tuple[Interval, ...]:
    """Divide a run into intervals that end at save times, event times and the end.

    Events are times that a step must end at, such as breakpoints of the terms' values;
    those outside (0, t1) are ignored. The longest step `max_dt` may be infinite.
    """
    if not max_dt > 0:
        raise InputError(
            f"the largest stable step is {max_dt:g} s: check the materials and terms "
            "for values far out of range"
        )
    ends = sorted({*saves, *(t for t in event_times if 0 < t < t1), t1} - {0.0})
    intervals = []
    start = 0.0
    for end in ends:
        # A quotient that exceeds a whole number by rounding must not cost a step more.
        steps = max(min_steps, math.ceil((end - start) / max_dt * (1 - 1e-9)))
        if steps > _MAX_INTERVAL_STEPS:
            raise InputError(
                f"{end - start:g} s take {steps:.2g} steps of {max_dt:.3g} s, the "
                "largest stable step: simulate a shorter time, or use a coarser pitch"
            )
        intervals.append(
            Interval(start=start, end=end, steps=steps, saved=end in saves)
        )
        start = end
    return tuple(intervals)


def more_after_events(
    intervals: tuple[Interval, ...], event_times: tuple[float, ...]
) -> tuple[Interval, ...]:
    """Divide the intervals after events into more steps."""
    # What is switched changes fast at first, and may be saved soon.
    if len(event_times) > MAX_REFINED_EVENTS:
        return intervals
    switched = {0.0, *event_times}

    def refined(interval: Interval) -> Interval:
        if interval.start not in switched:
            return interval
        steps = max(interval.steps, _FIRST_STEPS_AFTER_EVENT)
        return replace(interval, steps=steps)

    return tuple(map(refined, intervals))


def save_intervals(
    intervals: tuple[Interval, ...],
) -> tuple[tuple[Interval, ...], ...]:
    """Group intervals by the save time that they lead to, the rest in a last group."""
    # Only the end of a group is observed: thousands of event times cost no memory.
    groups: list[tuple[Interval, ...]] = []
    group: list[Interval] = []
    for interval in intervals:
        group.append(interval)
        if interval.saved:
            groups.append(tuple(group))
            group = []
    return tuple([*groups, tuple(group)] if group else groups)


def narrowed(
    groups: tuple[tuple[Interval, ...], ...],
) -> tuple[tuple[Interval, ...], ...]:
    """Divide save intervals that hold many more intervals than others.

    A table of their steps has a row for each group, as wide as the longest one. It then
    has at most half as many rows again, and at most three times the intervals.
    """
    total = sum(map(len, groups))
    width = max(_MIN_WIDTH, 2 * math.ceil(total / len(groups)))
    return tuple(
        group[begin : begin + width]
        for group in groups
        for begin in range(0, len(group), width)
    )


def similar_intervals(
    groups: tuple[tuple[Interval, ...], ...],
) -> list[tuple[tuple[Interval, ...], ...]]:
    """Divide save intervals into sequences that take about as many steps each.

    A loop of fixed length is as long for every interval as for the longest one. Within
    a sequence these lengths are at most twice the steps in all.
    """
    steps = [[interval.steps for interval in group] for group in groups]
    return [groups[rows] for rows in similar_rows(steps)]


def similar_rows(rows: Sequence[Sequence[int]]) -> list[slice]:
    """Divide rows of numbers of steps into sequences, as in `similar_intervals`."""
    sequences = []
    start = 0
    columns = 0
    longest = 0
    steps = 0
    for number, row in enumerate(rows):
        columns = max(columns, len(row))
        longest = max(longest, *row)
        steps += sum(row)
        if (number + 1 - start) * columns * longest > 2 * steps and number > start:
            sequences.append(slice(start, number))
            start = number
            columns = len(row)
            longest = max(row)
            steps = sum(row)
    return [*sequences, slice(start, len(rows))]
