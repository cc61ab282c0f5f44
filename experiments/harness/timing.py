"""Timing of alternatives in turn, so that all see the same state of the machine."""

import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike

from jaxthermo.report.numbers import with_range
from jaxthermo.timing import Timing, timed_call


# Wall time of every call of each alternative [s].
Spans = dict[str, list[float]]


def interleaved(
    calls: Mapping[str, Callable[[], Any]],
    repeats: int,
    *,
    there_and_back: bool = False,
) -> Spans:
    """Time every call `repeats` times in turn, after one that compiles and warms up.

    With `there_and_back` the order is reversed every other time.
    """
    for call in calls.values():
        jax.block_until_ready(call())
    spans: Spans = {name: [] for name in calls}
    order = list(calls.items())
    for _ in range(repeats):
        for name, call in order:
            spans[name].append(timed_call(call)[1])
        # A drift of the machine's speed then affects the first and the last alike.
        if there_and_back:
            order.reverse()
    return spans


def timing_of(spans: Sequence[float]) -> Timing:
    """Median, fastest and slowest of wall times [s]."""
    return Timing(statistics.median(spans), min(spans), max(spans))


def ratio_of(above: ArrayLike, below: ArrayLike) -> list[float]:
    """Median, lowest and highest ratio of times measured in turn."""
    ratio = np.asarray(above) / np.asarray(below)
    return [float(np.median(ratio)), float(ratio.min()), float(ratio.max())]


def ratio_text(ratio: Sequence[float]) -> str:
    """A ratio for a table: "2.1 (1.9-2.4)"."""
    return with_range(*ratio)
