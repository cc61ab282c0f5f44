"""Verdict on a fit as a whole: if its weights are worth using, by error and by speed.

The verdicts on single parameters tell how well the data determine them; a fit of well
determined weights may still run slower than the full volume, or be worse at late times.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jaxthermo.report.numbers import padded, with_range

from ..config.fit_record import (
    ErrorsByCase,
    Group,
    SpeedRatio,
    TruthRecord,
    TruthVerdict,
    Verdict,
    each_group,
    number_of,
)


_SAME = 1.001
"""Ratio of two errors up to which they count as equal: rounding of a converged fit."""
_MAX_NAMED = 4
"""Times, values or differences that a sentence names."""


class TimeErrors(NamedTuple):
    """Errors of a case at a saved time, with the scene's own values and the fitted."""

    group: Group
    case: str
    time: float
    """[s]"""
    default: float
    """Error with the scene's own values [%]."""
    fitted: float
    """Error with the fitted values [%]."""

    @property
    def is_worse(self) -> bool:
        """True if the fitted values have the larger error."""
        return self.fitted > _SAME * self.default


def time_errors(errors: ErrorsByCase) -> Iterator[TimeErrors]:
    """Every saved time of every case, in the order of `fit.json`."""
    for group, cases in each_group(errors):
        for case, fitted in cases["fitted"].items():
            default = cases["default"][case]
            for n, time in enumerate(fitted["times_s"]):
                yield TimeErrors(
                    group=group,
                    case=case,
                    time=time,
                    default=number_of(default["rms_percent"][n]),
                    fitted=number_of(fitted["rms_percent"][n]),
                )


class TruthTime(NamedTuple):
    """Errors against finer voxels of one case at one saved time."""

    group: Group
    case: str
    time: float
    """[s]"""
    default: float
    """Error with the scene's own values [K]."""
    fitted: float
    """Error with the fitted values [K]."""
    default_percent: float | None
    """Relative error with the scene's own values [%]; None without a range."""
    fitted_percent: float | None
    """Relative error with the fitted values [%]; None where there is no range."""
    reference: float
    """Estimated error of the reference [K]."""
    is_bound: bool
    """True if `reference` is the difference of two coarser runs, and no estimate."""

    @property
    def is_worse(self) -> bool:
        """True if the fitted values have the larger error, whatever the truth is.

        With a reference that is off by e, both errors are uncertain by e at most.
        """
        return self.fitted > _SAME * self.default + 2 * self.reference


def truth_times(truth: TruthRecord) -> Iterator[TruthTime]:
    """Every saved time of every case, in the order of `fit.json`."""
    for group, cases in each_group(truth["cases"]):
        for case, errors in cases.items():
            default = errors["default"]
            fitted = errors["fitted"]
            reference = errors["reference"]
            for n, time in enumerate(fitted["times_s"]):
                yield TruthTime(
                    group=group,
                    case=case,
                    time=time,
                    default=number_of(default["rms_kelvin"][n]),
                    fitted=number_of(fitted["rms_kelvin"][n]),
                    default_percent=default["rms_percent"][n],
                    fitted_percent=fitted["rms_percent"][n],
                    reference=number_of(reference["rms_kelvin"][n]),
                    is_bound=reference["is_bound"][n],
                )


def judge(
    errors: ErrorsByCase,
    speedup: SpeedRatio,
    is_of_weights: bool,
    truth: TruthRecord | None = None,
    differences: Sequence[str] = (),
    away: Sequence[str] = (),
    elsewhere: Sequence[str] = (),
) -> Verdict:
    """Judge a fit.

    It pays if no error is larger than before, at any saved time of any case, if the
    model and the data differ by no more than the noise allows, if all values are at the
    one minimum that was found, and, where weights of a structure were fitted, if every
    timed run was faster than that of the full volume. Against finer voxels an error
    counts as larger if it is so by more than twice the reference's own.

    Args:
        errors: by group, "default" or "fitted" and case, as in `fit.json`.
        speedup: as `measure_speed` gives it.
        is_of_weights: False for a fit of materials or loads alone, which makes nothing
            faster.
        truth: errors against finer voxels, as in `fit.json`.
        differences: between the model and frames, in units of their noise, see
            `misfit`.
        away: names of values that are away from the minimum.
        elsewhere: values, with names, of another search that fits as well.
    """
    rows = list(time_errors(errors))
    worse = [row for row in rows if row.is_worse]
    slow = is_of_weights and not number_of(speedup["min"]) > 1
    # What makes all values doubtful comes first.
    words = []
    if differences:
        words.append(
            "the model and the data DIFFER by more than the noise allows, so that no "
            f"value is certain within its standard error ({_named(differences)} what "
            "noise leaves)"
        )
    if away:
        words.append(f"the search ended AWAY from the minimum ({_named(away)})")
    if elsewhere:
        words.append(
            "a search from another start ended ELSEWHERE with an error that is as "
            f"small ({_named(elsewhere)})"
        )
    words.append(_error_words(rows, worse))
    if is_of_weights:
        words.append(_speed_words(speedup))
    truth_verdict = None
    farther = 0
    if truth is not None:
        times = list(truth_times(truth))
        farther = sum(row.is_worse for row in times)
        truth_verdict = _truth_numbers(times, worse=farther)
        words.append(_truth_words(truth_verdict, truth["refinement"]))
    pays = not (worse or slow or farther or differences or away or elsewhere)
    start = "the fit pays" if pays else "the fit does NOT pay"
    text = f"{start}: {'; '.join(words)}"
    return {
        "pays": pays,
        "words": text,
        "times": len(rows),
        "worse": len(worse),
        "truth": truth_verdict,
        "differences": list(differences),
    }


def _named(words: Sequence[str]) -> str:
    """The first of them, and if there are more."""
    ellipsis = ", ..." if len(words) > _MAX_NAMED else ""
    return ", ".join(words[:_MAX_NAMED]) + ellipsis


def _truth_numbers(rows: list[TruthTime], worse: int) -> TruthVerdict:
    # The error of a fit is that of its worst time.
    worst_default = max(rows, key=lambda row: row.default)
    worst_fitted = max(rows, key=lambda row: row.fitted)
    default_percent = [r.default_percent for r in rows if r.default_percent is not None]
    fitted_percent = [r.fitted_percent for r in rows if r.fitted_percent is not None]
    return {
        "times": len(rows),
        "before_kelvin": worst_default.default,
        "after_kelvin": worst_fitted.fitted,
        "before_percent": max(default_percent, default=None),
        "after_percent": max(fitted_percent, default=None),
        "own_kelvin": max(worst_default.reference, worst_fitted.reference),
        "own_is_bound": worst_default.is_bound or worst_fitted.is_bound,
        "worse": worse,
    }


def _truth_words(numbers: TruthVerdict, refinement: float) -> str:
    def error(kelvin: float, percent: float | None) -> str:
        relative = "" if percent is None else f" ({padded(percent)} %)"
        return f"{padded(kelvin)} K{relative}"

    default = error(numbers["before_kelvin"], numbers["before_percent"])
    fitted = error(numbers["after_kelvin"], numbers["after_percent"])
    reference_error = padded(numbers["own_kelvin"])
    about = (
        f"at most about {reference_error}"
        if numbers["own_is_bound"]
        else f"about {reference_error}"
    )
    text = (
        f"against voxels {refinement:.3g} times as fine the error goes from "
        f"{default} to {fitted}, where these are off by {about} K"
    )
    change = abs(numbers["after_kelvin"] - numbers["before_kelvin"])
    if change <= 2 * numbers["own_kelvin"]:
        text += ", too much to tell if it is smaller"
    if numbers["worse"]:
        text += f", and is LARGER at {numbers['worse']} of {numbers['times']} times"
    return text


def _error_words(rows: list[TimeErrors], worse: list[TimeErrors]) -> str:
    if not worse:
        return f"no error is larger than before, at {len(rows)} of {len(rows)} times"
    # The largest increases first.
    changes = [
        f"{row.case} at {row.time:g} s {padded(row.default)} to {padded(row.fitted)} %"
        for row in sorted(worse, key=lambda row: row.default - row.fitted)
    ]
    return (
        f"errors are LARGER than before at {len(worse)} of {len(rows)} times "
        f"({_named(changes)})"
    )


def _speed_words(speedup: SpeedRatio) -> str:
    low = number_of(speedup["min"])
    high = number_of(speedup["max"])
    ratio = with_range(number_of(speedup["times_faster"]), low=low, high=high)
    if low > 1:
        return f"a run is {ratio} times as fast as the full volume's"
    if high < 1:
        return f"a run is SLOWER than the full volume's, {ratio} times as fast"
    return f"a run is NOT clearly faster than the full volume's, {ratio} times as fast"
