"""`experiments compare`: what changed between two results, beyond noise."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from jaxthermo.errors import InputError

from .changes import ABSENT, Change, differ, differences, plain_changes, time_change
from .read import NOT_AS_WRITTEN, Kind, Result, Row
from .run_changes import run_changes


_ORIGIN = ("versions", "device", "processor", "commit", "program_hash", "seed")
# Half the last digit of a temperature of some 300 K in float32, for errors in kelvin.
_KELVIN_ROUNDING = 3e-5
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
    """Values that could not be compared, and why."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        plain = lambda changes: [change.as_dict() for change in changes]
        return {
            "kind": self.kind,
            "results": list(self.names),
            "config": plain(self.config),
            "origin": plain(self.origin),
            "numbers": plain(self.numbers),
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
    numbers, remarks = [], []
    try:
        for found in _NUMBERS[old.kind](old, new):
            (remarks if isinstance(found, str) else numbers).append(found)
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
    a, b = old.content, new.content
    if a["ended"] != b["ended"]:
        yield Change("ended", a["ended"], b["ended"])
    yield from _parameter_changes(a["parameters"], b["parameters"])
    for group in {**a["error_percent"], **b["error_percent"]}:
        both = [c["error_percent"].get(group, {}) for c in (a, b)]
        for kind in ("default", "fitted"):
            key = f"error_percent.{group}.{kind}"
            yield from _number_change(key, *(e.get(kind, ABSENT) for e in both))
    yield from _number_change("loss.final", a["loss"]["final"], b["loss"]["final"])
    if a["verdict"]["pays"] != b["verdict"]["pays"]:
        yield Change("verdict.pays", a["verdict"]["pays"], b["verdict"]["pays"])
    speeds = [c["speedup"] for c in (a, b)]
    if all("times_faster" in speed for speed in speeds):
        names = ("min", "times_faster", "max")
        spans = ([speed[n] for n in names if n in speed] for speed in speeds)
        if change := time_change("speedup.times_faster", *spans):
            yield change
    times = [c["run_time_s"] for c in (a, b)]
    for key in ("fit", "one_run", "compile"):
        if change := time_change(f"run_time_s.{key}", *([t[key]] for t in times)):
            yield change


def _parameter_changes(a: dict[str, Any], b: dict[str, Any]) -> Iterator[Change]:
    for name in {**a, **b}:
        if name not in a or name not in b:
            value = lambda rows, name=name: rows.get(name, {"value": ABSENT})["value"]
            yield Change(f"parameters.{name}", value(a), value(b))
            continue
        old, new = a[name], b[name]
        errors = [row["standard_error"] for row in (old, new)]
        known = [error for error in errors if error is not None]
        # Both values are uncertain; without standard errors only rounding is noise.
        noise = sum(error**2 for error in known) ** 0.5 if len(known) == 2 else 0.0
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
            yield Change(key, old["verdict"], new["verdict"])


def _number_change(key: str, old: Any, new: Any) -> Iterator[Change]:
    if ABSENT in (old, new):
        if old is not new:
            yield Change(key, old, new)
    elif differ(old, new, _FIT_ROUNDING):
        yield Change(key=key, old=old, new=new, note=f"{new - old:+.3g}")


def _sweep_changes(old: Result, new: Result) -> Iterator[Change | str]:
    a, b = ({_case_name(row): row for row in r.rows} for r in (old, new))
    for name in a.keys() - b.keys():
        yield Change(name, "a row", ABSENT)
    for name in b.keys() - a.keys():
        yield Change(name, ABSENT, "a row")
    for name in (name for name in a if name in b):
        yield from _row_changes(name, a[name], b[name])
        pairs = (old, a[name]), (new, b[name])
        times = (result.times.get(row["id"], []) for result, row in pairs)
        if change := time_change(f"{name}: loop [s]", *times):
            yield change


def _case_name(row: Row) -> str:
    """Choice and load of a sweep's row, in words."""
    choice = row.get("choice", {})
    parts = [f"{axis} {label}" for axis, label in sorted(choice.items())]
    return ", ".join([*parts, f"load {row.get('load', '-')}"])


# Fields of an error and their absolute rounding.
_ERRORS = {
    "worst_rms_kelvin": _KELVIN_ROUNDING,
    "worst_p99_kelvin": _KELVIN_ROUNDING,
    "worst_rms_percent": 1e-3,
}


def _row_changes(name: str, old: Row, new: Row) -> Iterator[Change]:
    failed = [row.get("failed", ABSENT) for row in (old, new)]
    if failed[0] != failed[1]:
        yield Change(f"{name}: failed", *failed)
    for key in ("nodes", "links", "steps"):
        a, b = old.get(key), new.get(key)
        if a != b and a is not None and b is not None:
            yield Change(f"{name}: {key}", a, b)
    for key, rounding in _ERRORS.items():
        a, b = ((row.get("error") or {}).get(key) for row in (old, new))
        if a is not None and b is not None and differ(a, b, absolute=rounding):
            yield Change(key=f"{name}: {key}", old=a, new=b, note=f"{b - a:+.3g}")


def _plain_changes(old: Result, new: Result) -> Iterator[Change | str]:
    bodies = [
        {k: v for k, v in r.body.items() if k not in _NOT_NUMBERS} for r in (old, new)
    ]
    yield from plain_changes(*bodies)
    # An experiment may have rows of the same form as a sweep's.
    if any("choice" in row for r in (old, new) for row in r.rows):
        yield from _sweep_changes(old, new)


def _plan_changes(old: Result, new: Result) -> Iterator[Change | str]:
    # What was tried on the way follows from the search, and is no result.
    names = ("chosen", "miss", "run_time_s", "reference")
    bodies = [{n: r.content.get(n) for n in names} for r in (old, new)]
    yield from plain_changes(*bodies)


_NOT_NUMBERS = {"config", "config_hash", "files", "date", *_ORIGIN}
_NUMBERS: dict[Kind, Callable[[Result, Result], Iterator[Change | str]]] = {
    "run": run_changes,
    "fit": _fit_changes,
    "sweep": _sweep_changes,
    "experiment": _plain_changes,
    "reduced model": _plain_changes,
    "plan": _plan_changes,
}
