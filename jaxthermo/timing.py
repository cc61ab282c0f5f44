"""Timings that mean something: warmed up, blocked, with their spread."""

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax


class Timing(NamedTuple):
    """Wall time of one call [s]: the median, and the fastest and slowest seen."""

    median: float
    fastest: float
    slowest: float

    def per(self, count: float | int) -> "Timing":
        """The same per one of `count` things done in a call."""
        return Timing(*(value / count for value in self))

    def text(self) -> str:
        """For a table: "12.3 ms (11.9-14.0)" or "1.92 s (1.89-2.18)"."""
        scale, unit = (1.0, "s") if self.median >= 1.0 else (1e3, "ms")
        median, low, high = (scale * value for value in self)
        return f"{median:.3g} {unit} ({low:.3g}-{high:.3g})"


def measure(call: Callable[[], Any], repeats: int = 5) -> Timing:
    """Times `call`, after one to warm up, waiting for its arrays."""
    jax.block_until_ready(call())
    spans = []
    for _ in range(repeats):
        clock = time.perf_counter()
        jax.block_until_ready(call())
        spans.append(time.perf_counter() - clock)
    return Timing(statistics.median(spans), min(spans), max(spans))
