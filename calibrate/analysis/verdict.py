"""Verdict on a fit as a whole: if its weights are worth using, by error and by speed.

The verdicts on single parameters tell how well the data determine them; a fit of well
determined weights may still run slower than the full volume, or be worse at late times.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from jaxthermo.report.numbers import padded


Verdict = dict[str, Any]
"""`pays`, `words` in one sentence, the number of `times` compared and `worse`, and the
same with the errors in kelvin against finer voxels as `truth`, None without them."""
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


class _TruthTime(NamedTuple):
    """Errors against finer voxels of one case at one saved time."""

    group: str
    """"train" or "held_out"."""
    case: str
    time: float
    """[s]"""
    before: float
    """[K]"""
    after: float
    before_percent: float | None
    """None where the reference has no range."""
    after_percent: float | None
    own: float
    """Estimated error of the reference [K]."""
    is_bound: bool
    """True if `own` is the difference of two coarser runs, and no estimate."""

    @property
    def is_worse(self) -> bool:
        """True if the fitted values have the larger error, whatever the truth is.

        With a reference that is off by e, both errors are uncertain by e at most.
        """
        return self.after > _SAME * self.before + 2 * self.own


def truth_times(truth: Mapping[str, Any]) -> Iterator[_TruthTime]:
    """Every saved time of every case, in the order of `fit.json`."""
    for group, cases in truth["cases"].items():
        for case, found in cases.items():
            before, after, own = (
                found[kind] for kind in ("default", "fitted", "reference")
            )
            columns = [after["times_s"]]
            for name in ("rms_kelvin", "rms_percent"):
                columns += [before[name], after[name]]
            columns += [own["rms_kelvin"], own["is_bound"]]
            for row in zip(*columns, strict=True):
                yield _TruthTime(group, case, *row)


def judge(
    errors: _Errors,
    speedup: Mapping[str, Any],
    is_of_weights: bool,
    truth: Mapping[str, Any] | None = None,
) -> Verdict:
    """Judge a fit.

    It pays if no error is larger than before, at any saved time of any case, and, where
    weights of a structure were fitted, if every timed run was faster than that of the
    full volume. Against finer voxels an error counts as larger if it is so by more than
    twice the reference's own.

    Args:
        errors: by group, "default" or "fitted" and case, as in `fit.json`.
        speedup: as `measure_speed` gives it.
        is_of_weights: False for a fit of materials or loads alone, which makes nothing
            faster.
        truth: errors against finer voxels, as in `fit.json`.
    """
    rows = list(time_errors(errors))
    worse = [row for row in rows if row.is_worse]
    slow = is_of_weights and not speedup["min"] > 1
    words = [_error_words(rows, worse)]
    if is_of_weights:
        words.append(_speed_words(speedup))
    against, farther = None, 0
    if truth is not None:
        times = list(truth_times(truth))
        farther = sum(row.is_worse for row in times)
        against = _truth_numbers(times) | {"worse": farther}
        words.append(_truth_words(against, truth["refinement"]))
    pays = not worse and not slow and not farther
    start = "the fit pays" if pays else "the fit does NOT pay"
    text = f"{start}: {'; '.join(words)}"
    counts = {"times": len(rows), "worse": len(worse)}
    return {"pays": pays, "words": text, **counts, "truth": against}


def _truth_numbers(rows: list[_TruthTime]) -> dict[str, Any]:
    # The error of a fit is that of its worst time; the reference's own there beside it.
    before = max(rows, key=lambda row: row.before)
    after = max(rows, key=lambda row: row.after)
    percent = lambda name: max(
        (v for row in rows if (v := getattr(row, name)) is not None), default=None
    )
    return {
        "times": len(rows),
        "before_kelvin": before.before,
        "after_kelvin": after.after,
        "before_percent": percent("before_percent"),
        "after_percent": percent("after_percent"),
        "own_kelvin": max(before.own, after.own),
        "own_is_bound": before.is_bound or after.is_bound,
    }


def _truth_words(found: Mapping[str, Any], refinement: float) -> str:
    def error(kind: str) -> str:
        percent = found[f"{kind}_percent"]
        relative = "" if percent is None else f" ({padded(percent)} %)"
        return f"{padded(found[f'{kind}_kelvin'])} K{relative}"

    own = padded(found["own_kelvin"])
    about = f"at most about {own}" if found["own_is_bound"] else f"about {own}"
    text = (
        f"against voxels {refinement:.3g} times as fine the error goes from "
        f"{error('before')} to {error('after')}, where these are off by {about} K"
    )
    change = abs(found["after_kelvin"] - found["before_kelvin"])
    if change <= 2 * found["own_kelvin"]:
        text += ", too much to tell if it is smaller"
    if found["worse"]:
        text += f", and is LARGER at {found['worse']} of {found['times']} times"
    return text


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
