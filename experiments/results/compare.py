"""`experiments compare`: changes between two results beyond noise."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from calibrate.study.rows import Row
from jaxthermo.errors import InputError

from .changes import (
    ABSENT,
    Change,
    differ,
    differences,
    is_number,
    number_changes,
    pairs,
    plain_changes,
    presence,
    time_changes,
)
from .read import NOT_AS_WRITTEN, Kind, Result
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

    def as_dict(self) -> Mapping[str, Any]:
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
    origin = [_origin(result) for result in (old, new)]
    return Comparison(
        kind=old.kind,
        names=(str(old.folder), str(new.folder)),
        config=tuple(differences(old.config, new.config)),
        origin=tuple(differences(*origin)),
        numbers=tuple(numbers),
        remarks=tuple(remarks),
    )


def _origin(result: Result) -> dict[str, object]:
    content = result.content
    return {key: content[key] for key in _ORIGIN if key in content}


def _fit_changes(old: Result, new: Result) -> Iterator[Change | str]:
    a = old.content
    b = new.content
    yield from _exact_changes("ended", old=a["ended"], new=b["ended"])
    yield from _parameter_changes(a["parameters"], b["parameters"])
    errors = pairs(a["error_percent"], b["error_percent"])
    for group, old_errors, new_errors in errors:
        for name, left, right in pairs(
            old_errors or {}, new_errors or {}, keys=("default", "fitted")
        ):
            yield from number_changes(
                f"error_percent.{group}.{name}",
                old=left,
                new=right,
                relative=_FIT_ROUNDING,
            )
    yield from number_changes(
        "loss.final",
        old=a["loss"]["final"],
        new=b["loss"]["final"],
        relative=_FIT_ROUNDING,
    )
    yield from _exact_changes(
        "verdict.pays", old=a["verdict"]["pays"], new=b["verdict"]["pays"]
    )
    speedups = (a["speedup"], b["speedup"])
    # A fit without a full volume has no such ratio.
    if all(speedup.get("times_faster") is not None for speedup in speedups):
        first, second = (
            [speedup[name] for name in ("min", "times_faster", "max")]
            for speedup in speedups
        )
        yield from time_changes("speedup.times_faster", old=first, new=second)
    for key in ("fit", "one_run", "compile"):
        yield from time_changes(
            f"run_time_s.{key}", old=[a["run_time_s"][key]], new=[b["run_time_s"][key]]
        )


def _exact_changes(key: str, old: object, new: object) -> Iterator[Change]:
    if old != new:
        yield Change(key, old=old, new=new)


def _parameter_changes(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Change]:
    for name, old, new in pairs(a, b):
        if ABSENT in (old, new):
            left, right = (p if p is ABSENT else p["value"] for p in (old, new))
            yield Change(f"parameters.{name}", old=left, new=right)
            continue
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
        yield from _exact_changes(
            f"parameters.{name}.verdict", old=old["verdict"], new=new["verdict"]
        )


def _sweep_changes(old: Result, new: Result) -> Iterator[Change | str]:
    a = {_case_name(row): row for row in old.rows}
    b = {_case_name(row): row for row in new.rows}
    for name, left, right in pairs(a, b):
        if ABSENT in (left, right):
            yield Change(
                name, old=presence(left, "a row"), new=presence(right, "a row")
            )
            continue
        yield from _row_changes(name, old=left, new=right)
        yield from time_changes(
            f"{name}: loop [s]",
            old=old.times.get(left["id"], []),
            new=new.times.get(right["id"], []),
        )


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
    yield from _exact_changes(
        f"{name}: failed", old.get("failed", ABSENT), new.get("failed", ABSENT)
    )
    for key, a, b in pairs(old, new, keys=("nodes", "links", "steps")):
        if is_number(a) and is_number(b):
            yield from _exact_changes(f"{name}: {key}", old=a, new=b)
    old_errors = old.get("error") or {}
    new_errors = new.get("error") or {}
    for key, a, b in pairs(old_errors, new_errors, keys=tuple(_ERRORS)):
        if is_number(a) and is_number(b):
            yield from number_changes(
                f"{name}: {key}", old=a, new=b, absolute=_ERRORS[key]
            )


def _plain_changes(old: Result, new: Result) -> Iterator[Change | str]:
    yield from plain_changes(_numbers_of(old), _numbers_of(new))
    # An experiment may have rows in the form of a sweep's.
    if any("choice" in row for r in (old, new) for row in r.rows):
        yield from _sweep_changes(old, new)


def _numbers_of(result: Result) -> dict[str, object]:
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
