"""Timings: the warm-up is not counted, the spread is, and units suit the size."""

from jaxthermo.timing import Spread, interleaved, measure, ratio_of


def test_every_repeat_counts_but_the_first_call():
    calls = []
    spread = measure(lambda: calls.append(1), repeats=4)
    assert len(calls) == 5
    assert spread.low <= spread.median <= spread.high


def test_alternatives_are_called_one_after_the_other():
    calls = []
    named = {name: lambda name=name: calls.append(name) for name in "ab"}
    spans = interleaved(named, 2, there_and_back=True)
    assert "".join(calls) == "ab" + "abba"
    assert [len(span) for span in spans.values()] == [2, 2]
    assert ratio_of([2.0, 8.0, 9.0], [1.0, 2.0, 3.0]) == Spread(3.0, low=2.0, high=4.0)


def test_text_for_tables():
    assert Spread(0.0123, 0.0119, 0.014).text() == "12.3 ms (11.9-14)"
    assert Spread(1.923, 1.89, 2.18).text() == "1.92 s (1.89-2.18)"
    assert Spread(0.4, 0.3, 0.6).per(4) == Spread(0.1, 0.075, 0.15)
