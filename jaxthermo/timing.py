"""Timings after a warm-up, waiting for results, with their range."""

import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import ArrayLike

from .memo.store import without_cache


Spans = dict[str, list[float]]
"""Wall times of every call by the name of the alternative [s]."""


class Spread(NamedTuple):
    """Median of values that were measured several times, and their range."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Iterable[float | int]) -> "Spread":
        """Median, smallest and largest of some values."""
        ordered = sorted(float(value) for value in values)
        return cls(statistics.median(ordered), low=ordered[0], high=ordered[-1])

    def per(self, count: float | int) -> "Spread":
        """Time per item, for calls of `count` items."""
        return Spread(*(value / count for value in self))

    def text(self) -> str:
        """A time [s] for a table: "12.3 ms (11.9-14.0)" or "1.92 s (1.89-2.18)"."""
        scale, unit = (1.0, "s") if self.median >= 1.0 else (1e3, "ms")
        median, low, high = (scale * value for value in self)
        return f"{median:.3g} {unit} ({low:.3g}-{high:.3g})"


def ratio_of(above: ArrayLike, below: ArrayLike) -> Spread:
    """Spread of the ratios of two alternatives that were timed alternately."""
    return Spread.of(np.atleast_1d(np.asarray(above) / np.asarray(below)))


def timed_call(call: Callable[[], Any]) -> tuple[Any, float]:
    """The result of a call, and its wall time [s]."""
    # A search in geometry would be timed as the reading of a file.
    with without_cache():
        clock = time.perf_counter()
        # JAX returns before it has computed: only the dispatch would be timed.
        result = jax.block_until_ready(call())
        return result, time.perf_counter() - clock


def interleaved(
    calls: Mapping[str, Callable[[], Any]],
    repeats: int,
    *,
    there_and_back: bool = False,
    warm_up: bool = True,
) -> Spans:
    """Time alternatives one after the other, so that a slow moment meets all of them.

    Args:
        calls: the alternatives by their names.
        repeats: number of times that each is timed.
        there_and_back: reverse the order every other time, so that a drift of the
            machine's speed affects the first and the last alike.
        warm_up: call each once before, which compiles it.
    """
    if warm_up:
        for call in calls.values():
            jax.block_until_ready(call())
    spans: Spans = {name: [] for name in calls}
    order = list(calls.items())
    for _ in range(repeats):
        for name, call in order:
            spans[name].append(timed_call(call)[1])
        if there_and_back:
            order.reverse()
    return spans


def measure(call: Callable[[], Any], repeats: int = 5) -> Spread:
    """Measure the wall time of `call` after a first one, which compiles."""
    return Spread.of(interleaved({"call": call}, repeats)["call"])
