"""Timings after a warm-up, waiting for results, with their range."""

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from .user_cache import without_cache


class Timing(NamedTuple):
    """Wall time of one call [s]: median, minimum and maximum."""

    median: float
    fastest: float
    slowest: float

    def per(self, count: float | int) -> "Timing":
        """Time per item, for calls of `count` items."""
        return Timing(
            median=self.median / count,
            fastest=self.fastest / count,
            slowest=self.slowest / count,
        )

    def text(self) -> str:
        """Format for a table: "12.3 ms (11.9-14.0)" or "1.92 s (1.89-2.18)"."""
        scale, unit = (1.0, "s") if self.median >= 1.0 else (1e3, "ms")
        median, low, high = (scale * value for value in self)
        return f"{median:.3g} {unit} ({low:.3g}-{high:.3g})"


def timed_call(call: Callable[[], Any]) -> tuple[Any, float]:
    """Result of a call, and its wall time [s]."""
    # A search in geometry would be timed as the reading of a file.
    with without_cache():
        clock = time.perf_counter()
        # JAX returns before it has computed: only the dispatch would be timed.
        result = jax.block_until_ready(call())
        return result, time.perf_counter() - clock


def measure(call: Callable[[], Any], repeats: int = 5) -> Timing:
    """Measure the wall time of `call`."""
    # The first call compiles.
    jax.block_until_ready(call())
    spans = [timed_call(call)[1] for _ in range(repeats)]
    return Timing(
        median=statistics.median(spans), fastest=min(spans), slowest=max(spans)
    )
