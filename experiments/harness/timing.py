"""Timing of alternatives one after the other, for the tables of benchmarks."""

from collections.abc import Sequence

from jaxthermo.report.numbers import with_range
from jaxthermo.timing import (
    Spans as Spans,
    Spread,
    interleaved as interleaved,
    ratio_of as ratio_of,
    timed_call as timed_call,
)


def timing_of(spans: Sequence[float]) -> Spread:
    """Spread of wall times [s]."""
    return Spread.of(spans)


def ratio_text(ratio: Sequence[float]) -> str:
    """A ratio for a table: "2.1 (1.9-2.4)"."""
    return with_range(*ratio)
