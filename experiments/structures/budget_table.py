"""Parts of the error in lines, and the page with them."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from jaxthermo.integrate.truth_error import AtPoints, TruthError, error_at_points
from jaxthermo.report import page
from jaxthermo.report.numbers import padded, seconds
from jaxthermo.report.table import Cell, Table

from ..harness.present import Column, Rows, publish, table_of
from ..harness.record import Record, Row
from .config import BudgetConfig, ComparisonConfig, resolved
from .truth_lines import REFERENCE_COLUMNS


PARTS = ("whole", "discretisation", "structure", "time", "reading")
"""Names of the errors of a row."""

_DASH = "\N{EN DASH}"
_OWN_VOXELS = "same voxels"


def budget_lines(
    rows: Rows, references: Rows, record: Record, given: BudgetConfig
) -> list[Row]:
    """A line for each structure of each height: its errors, largest of all loads."""
    known = {row["load"]: row for row in references}
    # The octree stands for full volumes that are too large to run.
    full: dict[Any, Row] = {
        (row["voxels_high"], row["surface_cells"], row["load"]): row
        for kind in ("octree", "full_volume")
        for row in rows
        if row["kind"] == kind and "refused" not in row
    }
    lines: dict[tuple[int, str], Row] = {}
    for row in rows:
        head = {key: row[key] for key in ("label", "voxels_high", "surface_cells")}
        line = lines.setdefault(
            (row["voxels_high"], row["label"]), head | {"by_load": {}}
        )
        if "refused" in row:
            line["refused"] = row["refused"]
            continue
        same = row["voxels_high"], row["surface_cells"], row["load"]
        errors = _errors(row, known[row["load"]], full.get(same), record)
        line["by_load"][row["load"]] = {name: e.as_dict() for name, e in errors.items()}
        line["nodes"] = row["nodes"]
        line["run_time_s"] = min(row["run_time_s"], line.get("run_time_s", np.inf))
        line["shares_voxels"] = row["voxels_high"] == given.reference_voxels_high
    for line in lines.values():
        line |= _worst(list(line["by_load"].values()))
    return list(lines.values())


def _errors(
    row: Row, reference: Row, full: Row | None, record: Record
) -> dict[str, TruthError]:
    """Differences of two runs each, which differ in one thing, and the whole."""
    arrays = record.arrays_of(row)
    times = np.asarray(row["times_s"])
    later = times > 0

    def read(arrays: dict[str, np.ndarray], name: str = "surface") -> AtPoints:
        return AtPoints(arrays[name][later], arrays["is_lost"])

    between = lambda one, other: error_at_points(times[later], one, other)
    own, truth = read(arrays), read(record.arrays_of(reference))
    found = {"whole": between(own, truth)}
    if full is not None:
        everything = read(record.arrays_of(full))
        found["discretisation"] = between(everything, truth)
        if full is not row or row["kind"] == "full_volume":
            found["structure"] = between(own, everything)
    for part, other in (("time", "converged"), ("reading", "constant")):
        if other in arrays:
            found[part] = between(read(arrays, other), own)
    return found


def _worst(loads: list[dict[str, Any]]) -> Row:
    """Largest errors of all loads and saved times."""
    found: Row = {}
    for part in PARTS:
        errors = [load[part] for load in loads if part in load]
        if errors:
            found[f"{part}_kelvin"] = max(e["worst_rms_kelvin"] for e in errors)
    whole = [load["whole"] for load in loads]
    if whole:
        percent = [e["worst_rms_percent"] for e in whole]
        found["percent"] = max((p for p in percent if p is not None), default=None)
        found["p99_kelvin"] = max(e["worst_p99_kelvin"] for e in whole)
        found["bias_kelvin"] = max((e["worst_bias_kelvin"] for e in whole), key=abs)
        found["lost_fraction"] = max(e["worst_lost_fraction"] for e in whole)
    return found


def _number(name: str) -> Any:
    def words(line: Row) -> str:
        value = line.get(name)
        return _DASH if value is None else padded(value)

    return words


def _of_voxels(line: Row) -> str:
    if line["shares_voxels"]:
        return _OWN_VOXELS
    return _number("discretisation_kelvin")(line)


_LINE: list[Column] = [
    ("voxels high", "{voxels_high:,}"),
    ("structure", "{label}"),
    ("nodes", "{nodes:,}"),
    ("error K", _number("whole_kelvin")),
    ("%", _number("percent")),
    ("voxels K", _of_voxels),
    ("structure K", _number("structure_kelvin")),
    ("time K", _number("time_kelvin")),
    ("reading K", _number("reading_kelvin")),
    ("run", lambda line: seconds(line["run_time_s"])),
]

_by_time = lambda name: (
    lambda row: ", ".join(_DASH if v is None else padded(v) for v in row["whole"][name])
)
_BY_LOAD: list[Column] = [
    ("voxels high", "{voxels_high:,}"),
    ("structure", "{label}"),
    ("load", "{load}"),
    ("K at each time", _by_time("rms_kelvin")),
    ("% at each time", _by_time("rms_percent")),
    ("p99 K", lambda row: padded(row["whole"]["worst_p99_kelvin"])),
    ("mean K", lambda row: padded(row["whole"]["worst_bias_kelvin"])),
    ("lost", lambda row: padded(row["whole"]["worst_lost_fraction"])),
]

_TERMS = {
    "error": "root mean square, over points spread evenly over the mesh, of the "
    "difference in surface temperature from the reference, in K and in percent of the "
    "reference's range (0.5 to 99.5 %) at that time; the largest of the saved times "
    "and loads",
    "voxels": "the same of the full volume of these voxels, or of their octree where "
    "there is none; aggregates of the reference's own voxels share their error with it",
    "structure": "difference from that full volume or octree",
    "time": "difference from the same run in steps a quarter as long; this and the "
    "next are not measured above a million nodes",
    "reading": "difference between the temperatures of the nearest nodes and those "
    "corrected by the heat flux, as all others are read",
    "run": "all passes of the default solver until the error in time holds, compiled; "
    "the fastest of the loads",
}


def _goals(lines: list[Row], given: BudgetConfig) -> list[Table]:
    """The smallest error of at most so many nodes, beside what is asked."""
    rows = []
    for goal in given.goals:
        fitting = [
            line
            for line in lines
            if line.get("percent") is not None and line["nodes"] <= goal.nodes
        ]
        asked = [f"{goal.nodes:,}", f"{goal.error_percent:g}"]
        if not fitting:
            rows.append([*asked, Cell("none", False), _DASH, _DASH])
            continue
        best = min(fitting, key=lambda line: line["percent"])
        met = best["percent"] <= goal.error_percent
        name = f"{best['label']}, {best['voxels_high']:,} high"
        found = Cell(padded(best["percent"]), met)
        rows.append([*asked, found, name, f"{best['nodes']:,}"])
    headings = ("nodes at most", "% at most", "best %", "structure", "nodes")
    return [Table(headings, rows, "goals", left=(3,))] if rows else []


def write_budget(
    lines: list[Row], references: Rows, config: ComparisonConfig, folder: Path
) -> None:
    """Print the table, and write it with all its loads and times as a page."""
    given = config.budget
    assert given is not None
    own = max(row["own_error"]["worst_rms_kelvin"] for row in references)
    is_bound = any(any(row["own_error"]["is_bound"]) for row in references)
    kind = given.reference.kind.replace("_", " ")
    caption = (
        f"reference: {kind} of {given.reference_voxels_high:,}-high voxels, "
        f"{references[0]['costs'][0]['nodes']:,} nodes, itself off by "
        f"{'at most about' if is_bound else 'about'} {padded(own)} K"
    )
    by_load = [
        {**line, "load": load, **errors}
        for line in lines
        for load, errors in line["by_load"].items()
    ]
    plain = json.dumps(resolved(config), indent=2)
    sections: list[page.Section] = [
        table_of(lines, _LINE, "parts of the error", caption, names=2, left=(1,)),
        page.paragraph(caption, note=True),
        *_goals(lines, given),
        page.terms(list(_TERMS.items())),
        page.details("Every load and time", table_of(by_load, _BY_LOAD, left=(1, 2))),
        page.details("References", table_of(references, REFERENCE_COLUMNS, names=2)),
        page.details("The config, in SI units", page.pre(plain)),
    ]
    publish(folder, "Where errors come from", sections)
