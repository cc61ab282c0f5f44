"""Changes between two runs of `jaxthermo simulate`, beyond noise."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from jaxthermo.accuracy.surface_error import surface_error
from jaxthermo.accuracy.truth_error import truth_error
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.solution_file import load_solution

from .changes import (
    ABSENT,
    ROUNDING,
    Change,
    Number,
    differ,
    number_changes,
    pairs,
    presence,
    time_changes,
)
from .read import Result


_COUNTS = ("nodes", "links", "steps", "solver", "result")
_TIMES = ("run_time_s", "compile_time_s", "setup_time_s")
_KELVIN_ROUNDINGS = 8
"""Roundings of float32 that two machines may differ by in a temperature."""
_MEMORY_ROUNDING = 0.1
_POINTS = 10_000


def run_changes(old: Result, new: Result) -> Iterator[Change | str]:
    """Counts, surface temperatures, probes, energies and times that changed."""
    a = old.content
    b = new.content
    for key, left, right in pairs(a, b, keys=_COUNTS):
        if left != right:
            yield Change(key, old=left, new=right)
    yield from _surface_changes(old, new)
    yield from _truth_changes(a.get("truth_error"), b.get("truth_error"))
    yield from _probe_changes(a.get("probes", {}), b.get("probes", {}))
    yield from _energy_changes(a, b)
    for key in _TIMES:
        if key in a and key in b:
            yield from time_changes(key, old=[a[key]], new=[b[key]])
    left = a.get("peak_memory_bytes", 0)
    right = b.get("peak_memory_bytes", 0)
    if differ(left, right, relative=_MEMORY_ROUNDING):
        yield Change("peak_memory_bytes", old=left, new=right)


def _kelvin_noise(largest: Number) -> float:
    """Difference of temperatures up to `largest` [K] that is rounding [K]."""
    return _KELVIN_ROUNDINGS * float(np.finfo(np.float32).eps) * largest


def _surface_changes(old: Result, new: Result) -> Iterator[Change | str]:
    files = [result.folder / "solution.npz" for result in (old, new)]
    if all(file.exists() for file in files):
        try:
            first, second = (load_solution(file) for file in files)
            yield from _solution_changes(first, second)
            return
        except InputError as error:
            yield f"the surface temperatures were not compared point by point: {error}"
    else:
        yield "a solution.npz is missing: surface temperatures by their summaries only"
    yield from _summary_changes(old.content, new.content)


def _solution_changes(
    first: StoredSolution, second: StoredSolution
) -> Iterator[Change]:
    largest = float(np.abs(np.asarray(first.surface_temperature)).max())
    try:
        error = surface_error(second, first)
        how = "at the same surface cells"
        top = f"at most {float(error.max_percent.max()):.3g} % of the range"
    except InputError:
        # The voxels or the surfaces of the structures differ.
        error = truth_error(second, reference=first, count=_POINTS)
        how = "at points on the mesh"
        top = f"99 % within {float(error.worst_p99_kelvin):.3g} K"
    rms = np.asarray(error.rms_kelvin, float)
    if rms.max() > _kelvin_noise(largest):
        worst = int(rms.argmax())
        percent = float(np.asarray(error.rms_percent)[worst])
        time = float(error.times[worst])
        note = f"{how}, at {time:g} s; {percent:.3g} %; {top}"
        name = "surface temperature: RMS of the change [K]"
        yield Change(key=name, old=0.0, new=rms[worst], note=note)


def _summary_changes(
    old: Mapping[str, Any], new: Mapping[str, Any]
) -> Iterator[Change]:
    bodies = zip(old["bodies"], new["bodies"], strict=False)
    for index, (a, b) in enumerate(bodies):
        for name in ("min", "mean", "max"):
            yield from _temperature_change(
                f"bodies.{index}: {name} of the surface [K]",
                old=a["surface_temperature_K"][name],
                new=b["surface_temperature_K"][name],
            )


def _temperature_change(
    key: str, old: list[Number], new: list[Number]
) -> Iterator[Change]:
    if len(old) != len(new):
        yield Change(key, old=f"{len(old)} times", new=f"{len(new)} times")
        return
    size = np.abs(np.subtract(new, old))
    if len(size) and size.max() > _kelvin_noise(float(np.abs(old).max())):
        worst = int(size.argmax())
        note = f"{new[worst] - old[worst]:+.3g} K"
        yield Change(key=key, old=old[worst], new=new[worst], note=note)


def _truth_changes(old: Any, new: Any) -> Iterator[Change]:
    names = ("worst_rms_kelvin", "worst_p99_kelvin", "worst_lost_fraction")
    # An error that only one of them has is one change.
    compared = names[:1] if None in (old, new) else names
    for name, a, b in pairs(old or {}, new or {}, keys=compared):
        yield from number_changes(
            f"truth_error.{name}",
            old=a,
            new=b,
            absolute=_kelvin_noise(300.0) if "kelvin" in name else 0.0,
        )


def _probe_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    for name, a, b in pairs(old, new):
        key = f"probes.{name} [K]"
        if ABSENT in (a, b):
            yield Change(key, old=presence(a, "a probe"), new=presence(b, "a probe"))
        else:
            yield from _temperature_change(
                key, old=a["temperature_K"], new=b["temperature_K"]
            )


def _energy_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    a = _energies(old)
    b = _energies(new)
    # Small terms of the balance are differences of its large ones.
    rows = [*a.values(), *b.values()]
    scale = max((abs(value) for row in rows for value in row), default=0)
    for name in {**a, **b}:
        first = (a.get(name) or [ABSENT])[-1]
        second = (b.get(name) or [ABSENT])[-1]
        yield from number_changes(
            f"energy.{name}, at the end",
            old=first,
            new=second,
            absolute=ROUNDING * scale,
            unit=" J",
        )


def _energies(content: Mapping[str, Any]) -> dict[str, list[Number]]:
    """Terms of the energy balance at the saved times [J]."""
    energy = content.get("energy", {})
    return {name: row for name, row in energy.items() if name.endswith("_J")}
