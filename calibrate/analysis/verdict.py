"""Verdict on a fit as a whole: if its weights are worth using, by error and by speed.

The verdicts on single parameters tell how well the data determine them; a fit of well
determined weights may still run slower than the full volume, or be worse at late times.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from jaxthermo.report.numbers import padded


Verdict = dict[str, Any]
"""`pays`, `words` in one sentence, and the number of `times` compared and `worse`."""
_Errors = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]

_SAME = 1.001
"""Ratio of two errors up to which they count as equal: rounding of a converged fit."""
_MAX_NAMED = 4
"""Times named in the sentence; all of them are in the table of errors."""


class _TimeErrors(NamedTuple):
    """Errors of one case at one saved time, with the start values and the fitted."""

    group: str
    """"train" or "held_out"."""
    case: str
    time: float
    """[s]"""
    before: float
    """[%]"""
    after: float

    @property
    def is_worse(self) -> bool:
        """True if the fitted values have the larger error."""
        return self.after > _SAME * self.before


def time_errors(errors: _Errors) -> Iterator[_TimeErrors]:
    """Every saved time of every case, in the order of `fit.json`."""
    for group, both in errors.items():
        for case, fitted in both["fitted"].items():
            before = both["default"][case]["rms_percent"]
            rows = zip(fitted["times_s"], before, fitted["rms_percent"], strict=True)
            for row in rows:
                yield _TimeErrors(group, case, *row)


def judge(errors: _Errors, speedup: Mapping[str, Any], is_of_weights: bool) -> Verdict:
    """Judge a fit.

    It pays if no error is larger than before, at any saved time of any case, and, where
    weights of a structure were fitted, if every timed run was faster than that of the
    full volume.

    Args:
        errors: by group, "default" or "fitted" and case, as in `fit.json`.
        speedup: as `measure_speed` gives it.
        is_of_weights: False for a fit of materials or loads alone, which makes nothing
            faster.
    """
    rows = list(time_errors(errors))
    worse = [row for row in rows if row.is_worse]
    slow = is_of_weights and not speedup["min"] > 1
    words = [_error_words(rows, worse)]
    if is_of_weights:
        words.append(_speed_words(speedup))
    pays = not worse and not slow
    start = "the fit pays" if pays else "the fit does NOT pay"
    text = f"{start}: {'; '.join(words)}"
    return {"pays": pays, "words": text, "times": len(rows), "worse": len(worse)}


def _error_words(rows: list[_TimeErrors], worse: list[_TimeErrors]) -> str:
    if not worse:
        return f"no error is larger than before, at {len(rows)} of {len(rows)} times"
    # The largest increases first.
    worst = sorted(worse, key=lambda row: row.before - row.after)[:_MAX_NAMED]
    named = ", ".join(
        f"{row.case} at {row.time:g} s {padded(row.before)} to {padded(row.after)} %"
        for row in worst
    )
    more = ", ..." if len(worse) > len(worst) else ""
    return (
        f"errors are LARGER than before at {len(worse)} of {len(rows)} times "
        f"({named}{more})"
    )


def _speed_words(speedup: Mapping[str, Any]) -> str:
    ratio = (
        f"{speedup['times_faster']:.3g} ({speedup['min']:.3g} to {speedup['max']:.3g})"
    )
    if speedup["min"] > 1:
        return f"a run is {ratio} times as fast as the full volume's"
    if speedup["max"] < 1:
        return f"a run is SLOWER than the full volume's, {ratio} times as fast"
    return f"a run is NOT clearly faster than the full volume's, {ratio} times as fast"
