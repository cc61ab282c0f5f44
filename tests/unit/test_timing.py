"""Timings: the warm-up is not counted, the spread is, and units suit the size."""

from jaxthermo.timing import Timing, measure


def test_every_repeat_counts_but_the_first_call():
    calls = []
    timing = measure(lambda: calls.append(1), repeats=4)
    assert len(calls) == 5
    assert timing.fastest <= timing.median <= timing.slowest


def test_text_for_tables():
    assert Timing(0.0123, 0.0119, 0.014).text() == "12.3 ms (11.9-14)"
    assert Timing(1.923, 1.89, 2.18).text() == "1.92 s (1.89-2.18)"
    assert Timing(0.4, 0.3, 0.6).per(4) == Timing(0.1, 0.075, 0.15)
