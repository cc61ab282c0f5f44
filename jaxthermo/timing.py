"""Timings after a warm-up, waiting for results, with their range."""

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax


class Timing(NamedTuple):
    """Wall time of one call [s]: median, minimum and maximum."""

    median: float
    fastest: float
    slowest: float

    def per(self, count: float | int) -> "Timing":
        """Time per item, for calls of `count` items."""
        return Timing(*(value / count for value in self))

    def text(self) -> str:
        """Format for a table: "12.3 ms (11.9-14.0)" or "1.92 s (1.89-2.18)"."""
        scale, unit = (1.0, "s") if self.median >= 1.0 else (1e3, "ms")
        median, low, high = (scale * value for value in self)
        return f"{median:.3g} {unit} ({low:.3g}-{high:.3g})"


def measure(call: Callable[[], Any], repeats: int = 5) -> Timing:
    """Measure the wall time of `call`."""
    # The first call compiles. JAX returns before it has computed: block until ready.
    jax.block_until_ready(call())
    spans = []
    for _ in range(repeats):
        clock = time.perf_counter()
        jax.block_until_ready(call())
        spans.append(time.perf_counter() - clock)
    return Timing(statistics.median(spans), min(spans), max(spans))
