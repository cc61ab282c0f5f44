"""`experiments compare`: changes between two results beyond noise."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from jaxthermo.errors import InputError

from .changes import ABSENT, Change, differ, differences, plain_changes, time_change
from .read import NOT_AS_WRITTEN, Kind, Result, Row
from .run_changes import run_changes


_ORIGIN = ("versions", "device", "processor", "commit", "program_hash", "seed")
_KELVIN_ROUNDING = 3e-5
"""Half the last digit of a temperature of some 300 K in float32 [K]."""
_FIT_ROUNDING = 1e-3
"""Relative difference of two fits that stop at the same minimum [-]: near it the errors
hardly change, and rounding decides where the fit stops."""


class Comparison(NamedTuple):
    """Changes from one result to another of the same kind."""

    kind: Kind
    names: tuple[str, str]
    config: tuple[Change, ...]
    origin: tuple[Change, ...]
    """Versions, device, processor, commit and seed."""
    numbers: tuple[Change, ...]
    """Results that changed beyond noise."""
    remarks: tuple[str, ...]
    """Reasons why some values could not be compared."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "kind": self.kind,
            "results": list(self.names),
            "config": [change.as_dict() for change in self.config],
            "origin": [change.as_dict() for change in self.origin],
            "numbers": [change.as_dict() for change in self.numbers],
            "remarks": list(self.remarks),
        }


def compare(old: Result, new: Result) -> Comparison:
    """Compare two results: configs first, then their origin, then their numbers.

    Raises:
        InputError: if they are of two kinds, or of two experiments.
    """
    if old.kind != new.kind:
        raise InputError(
            f"{old.folder} is a {old.kind} and {new.folder} a {new.kind}: compare two "
            "results of one kind"
        )
    experiments = [result.content.get("experiment") for result in (old, new)]
    if experiments[0] != experiments[1]:
        raise InputError(
            f"{old.folder} is of the experiment {experiments[0]} and {new.folder} of "
            f"{experiments[1]}: compare two results of one experiment"
        )
    numbers = []
    remarks = []
    try:
        for change in _NUMBERS[old.kind](old, new):
            (remarks if isinstance(change, str) else numbers).append(change)
    except NOT_AS_WRITTEN as error:
        raise InputError(
            f"{old.folder} and {new.folder} cannot be compared: one of them is damaged "
            f"or of another version ({type(error).__name__}: {error})"
        ) from error
    origin = [{k: r.content[k] for k in _ORIGIN if k in r.content} for r in (old, new)]
    return Comparison(
        kind=old.kind,
        names=(str(old.folder), str(new.folder)),
        config=tuple(differences(old.config, new.config)),
        origin=tuple(differences(*origin)),
        numbers=tuple(numbers),
        remarks=tuple(remarks),
    )


def _fit_changes(old: Result, new: Result) -> Iterator[Change | str]:
    a = old.content
    b = new.content
    if a["ended"] != b["ended"]:
        yield Change("ended", old=a["ended"], new=b["ended"])
    yield from _parameter_changes(a["parameters"], b["parameters"])
    for group in {**a["error_percent"], **b["error_percent"]}:
        old_errors = a["error_percent"].get(group, {})
        new_errors = b["error_percent"].get(group, {})
        for values in ("default", "fitted"):
            yield from _number_change(
                f"error_percent.{group}.{values}",
                old=old_errors.get(values, ABSENT),
                new=new_errors.get(values, ABSENT),
            )
    yield from _number_change(
        "loss.final", old=a["loss"]["final"], new=b["loss"]["final"]
    )
    pays = a["verdict"]["pays"]
    if pays != b["verdict"]["pays"]:
        yield Change("verdict.pays", old=pays, new=b["verdict"]["pays"])
    if all("times_faster" in c["speedup"] for c in (a, b)):
        change = time_change(
            "speedup.times_faster",
            old=_speedups(a["speedup"]),
            new=_speedups(b["speedup"]),
        )
        if change:
            yield change
    for key in ("fit", "one_run", "compile"):
        change = time_change(
            f"run_time_s.{key}", old=[a["run_time_s"][key]], new=[b["run_time_s"][key]]
        )
        if change:
            yield change


def _speedups(speedup: dict[str, Any]) -> list[float]:
    names = ("min", "times_faster", "max")
    return [speedup[name] for name in names if name in speedup]


def _parameter_changes(a: dict[str, Any], b: dict[str, Any]) -> Iterator[Change]:
    for name in {**a, **b}:
        if name not in a or name not in b:
            yield Change(
                f"parameters.{name}",
                old=a.get(name, {"value": ABSENT})["value"],
                new=b.get(name, {"value": ABSENT})["value"],
            )
            continue
        old = a[name]
        new = b[name]
        errors = [row["standard_error"] for row in (old, new)]
        # Both values are uncertain; without standard errors only rounding is noise.
        noise = 0.0 if None in errors else math.hypot(*errors)
        if differ(
            old["value"], new=new["value"], relative=_FIT_ROUNDING, absolute=noise
        ):
            size = abs(new["value"] - old["value"])
            note = f"{size / noise:.3g} standard errors" if noise else ""
            yield Change(
                key=f"parameters.{name}", old=old["value"], new=new["value"], note=note
            )
        if old["verdict"] != new["verdict"]:
            key = f"parameters.{name}.verdict"
            yield Change(key, old=old["verdict"], new=new["verdict"])


def _number_change(key: str, old: Any, new: Any) -> Iterator[Change]:
    if ABSENT in (old, new):
        if old is not new:
            yield Change(key, old=old, new=new)
    elif differ(old, new, _FIT_ROUNDING):
        yield Change(key=key, old=old, new=new, note=f"{new - old:+.3g}")


def _sweep_changes(old: Result, new: Result) -> Iterator[Change | str]:
    a = {_case_name(row): row for row in old.rows}
    b = {_case_name(row): row for row in new.rows}
    for name in a.keys() - b.keys():
        yield Change(name, old="a row", new=ABSENT)
    for name in b.keys() - a.keys():
        yield Change(name, old=ABSENT, new="a row")
    for name in (name for name in a if name in b):
        yield from _row_changes(name, old=a[name], new=b[name])
        change = time_change(
            f"{name}: loop [s]",
            old=old.times.get(a[name]["id"], []),
            new=new.times.get(b[name]["id"], []),
        )
        if change:
            yield change


def _case_name(row: Row) -> str:
    """Choice and load of a sweep's row, in words."""
    choice = row.get("choice", {})
    labels = [f"{axis} {label}" for axis, label in sorted(choice.items())]
    return ", ".join([*labels, f"load {row.get('load', '-')}"])


# Fields of an error and their absolute rounding.
_ERRORS = {
    "worst_rms_kelvin": _KELVIN_ROUNDING,
    "worst_p99_kelvin": _KELVIN_ROUNDING,
    "worst_rms_percent": 1e-3,
}


def _row_changes(name: str, old: Row, new: Row) -> Iterator[Change]:
    old_failure = old.get("failed", ABSENT)
    new_failure = new.get("failed", ABSENT)
    if old_failure != new_failure:
        yield Change(f"{name}: failed", old=old_failure, new=new_failure)
    for key in ("nodes", "links", "steps"):
        a = old.get(key)
        b = new.get(key)
        if a != b and a is not None and b is not None:
            yield Change(f"{name}: {key}", old=a, new=b)
    for key, rounding in _ERRORS.items():
        a = (old.get("error") or {}).get(key)
        b = (new.get("error") or {}).get(key)
        if a is not None and b is not None and differ(a, b, absolute=rounding):
            yield Change(key=f"{name}: {key}", old=a, new=b, note=f"{b - a:+.3g}")


def _plain_changes(old: Result, new: Result) -> Iterator[Change | str]:
    yield from plain_changes(_numbers_of(old), _numbers_of(new))
    # An experiment may have rows in the form of a sweep's.
    if any("choice" in row for r in (old, new) for row in r.rows):
        yield from _sweep_changes(old, new)


def _numbers_of(result: Result) -> dict[str, Any]:
    return {k: v for k, v in result.body.items() if k not in _NOT_NUMBERS}


def _plan_changes(old: Result, new: Result) -> Iterator[Change | str]:
    # The trials of the search are no results.
    names = ("chosen", "miss", "run_time_s", "reference")
    yield from plain_changes(
        {name: old.content.get(name) for name in names},
        {name: new.content.get(name) for name in names},
    )


_NOT_NUMBERS = {"config", "config_hash", "files", "date", *_ORIGIN}
_NUMBERS: dict[Kind, Callable[[Result, Result], Iterator[Change | str]]] = {
    "run": run_changes,
    "fit": _fit_changes,
    "sweep": _sweep_changes,
    "experiment": _plain_changes,
    "reduced model": _plain_changes,
    "plan": _plan_changes,
}
