"""`experiments run budget`: shares of an error due to voxels, structure and time.

All runs of a sweep are read at the points of its reference, so that a share of an error
is the difference between two runs that differ in one property.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import jaxthermo as jt
from calibrate.study.case import Case, build_case, plan_case
from calibrate.study.config import (
    SweepConfig,
    load_sweep,
    sweep_hash,
)
from calibrate.study.evaluate import Truth, find_truth
from calibrate.study.points import cases_of, choices
from calibrate.study.rows import Row
from calibrate.study.summary import goals_table
from jaxthermo.accuracy.truth_error import AtPoints, TruthError, error_at_points
from jaxthermo.arrays import precision
from jaxthermo.config.loader import resolved, to_yaml
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.host_memory import readable_bytes
from jaxthermo.integrate.run.plan import Plan
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.integrate.run.time_error import of_pass
from jaxthermo.report import page
from jaxthermo.report.numbers import padded, seconds
from jaxthermo.timing import timed_call

from ..harness.present import Column, publish, table_of
from ..harness.record import Arrays, Record


_FURTHER = 2
"""Number of times that steps are halved for the run that gives the error in time."""
_MAX_NODES = 1_000_000
"""Number of nodes above which a run's shares of time and reading are not measured."""
_LONG = 30.0
"""Time of a run above which it is not repeated to be timed warm [s]."""

_DEFAULT = Path(__file__).parents[2] / "configs" / "sweeps" / "budget.yaml"


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """Shares of the error of every choice of a sweep, the standard one by default.

    An interrupted run continues in the same folder.

    Raises:
        InputError: for a mistake in the config, a mesh that is not there, or a
            reference that cannot be run.
    """
    path = config or _DEFAULT
    console = open_console()
    if config is None and not _DEFAULT.is_file():
        raise InputError(f"the standard budget, {path}, is not installed: name a file")
    # As the folder of a finished sweep has it.
    sweep_config = load_sweep(path / "config.yaml" if path.is_dir() else path)
    cases = [
        case
        for choice in choices(sweep_config)
        for case in cases_of(sweep_config, choice)
    ]
    record = Record(folder, (Path(__file__),))
    log = partial(print_line, console)
    truths = {case.truth_key: find_truth(case, log) for case in cases}
    rows: dict[str, Row] = {}
    # The coarsest first: those of the finest voxels take longest, and gigabytes.
    for case in sorted(cases, key=_fineness):
        truth = truths[case.truth_key]
        head = {"choice": dict(case.names), "load": case.load}
        row = record.once(case.id, head, partial(_measured, case, truth))
        rows[case.id] = row
        outcome = row.get("refused") or f"{row['nodes']:,} nodes, {row['steps']} steps"
        names = ", ".join(label for _, label in case.names)
        print_line(console, f"{names}, {case.load}: {outcome}")
    lines = budget_lines(cases, rows=rows, truths=truths, record=record)
    write_budget(
        lines, truths=list(truths.values()), config=sweep_config, folder=folder
    )
    return {
        "config": resolved(sweep_config),
        "config_hash": sweep_hash(sweep_config),
        "table": lines,
        "rows": list(rows.values()),
        "references": [
            {"own_error": truth.own_error, "costs": list(truth.costs)}
            for truth in truths.values()
        ],
        "files": ["report.html"],
    }


def _fineness(case: Case) -> tuple[float, float, str]:
    body = case.config.bodies[0]
    pitch = -math.inf if body.pitch is None else -body.pitch
    return float(body.voxels_high or 0), pitch, str(body.surface_cells)


def _measured(case: Case, truth: Truth) -> tuple[Row, Arrays]:
    """A run, one in shorter steps, and one read at the nodes."""
    scene = build_case(case.config).scene
    plan = plan_case(case.config, scene)
    with precision(scene.dtype):
        solution, took = timed_call(lambda: run_plan(plan))
        # Once more without compilation.
        if took < _LONG:
            solution, took = timed_call(lambda: run_plan(plan))
    if solution.result != jt.RESULTS.successful:
        raise InputError(jt.RESULTS[solution.result])
    runs = {"surface": solution}
    # Passes of a solver that controls its error differ in steps only.
    if solution.receipt.nodes <= _MAX_NODES and plan.control is not None:
        last = round(math.log2(solution.run.steps / plan.steps))
        nearest = (replace(b, surface_map=jt.ConstantMap()) for b in scene.bodies)
        at_nodes = plan_case(case.config, replace(scene, bodies=tuple(nearest)))
        runs["converged"] = _one_pass(plan, last + _FURTHER)
        runs["constant"] = _one_pass(at_nodes, last)
    reading = truth.points.reading(solution.surfaces)
    row = {
        "nodes": solution.receipt.nodes,
        "steps": solution.run.steps,
        "run_time_s": took,
        "time_error_K": solution.run.time_error,
        "times_s": np.asarray(solution.times, float).tolist(),
        "energy_residual": float(np.abs(solution.energy.residual_relative).max()),
    }
    at_points = {
        name: np.asarray(reading.read(np.asarray(run.surface_temperature)))
        for name, run in runs.items()
    }
    return row, {**at_points, "is_lost": reading.is_lost}


def _one_pass(plan: Plan, number: int) -> jt.Solution:
    """A run with the steps of one pass alone."""
    single = of_pass(plan, number)
    with precision(plan.scene.dtype):
        return run_plan(single)


def budget_lines(
    cases: list[Case], rows: dict[str, Row], truths: dict[str, Truth], record: Record
) -> list[Row]:
    """A line for each choice with the largest errors of all loads.

    Args:
        cases: all, with their loads.
        rows: by the id of the case, with runs at points as their arrays.
        truths: references by their key.
        record: of the arrays.
    """
    # The octree stands for full volumes that are too large to run.
    full = {
        _voxels(case): rows[case.id]
        for structure_kind in ("octree", "full_volume")
        for case in cases
        if _kind(case) == structure_kind and "refused" not in rows[case.id]
    }
    lines: dict[tuple[tuple[str, str], ...], Row] = {}
    for case in cases:
        row = rows[case.id]
        line = lines.setdefault(case.names, {"choice": dict(case.names), "by_load": {}})
        if "refused" in row:
            line["refused"] = row["refused"]
            continue
        full_row = full.get(_voxels(case))
        is_full = full_row is row and _kind(case) == "octree"
        errors = _errors(
            row,
            truth=truths[case.truth_key],
            full=full_row,
            stands_in=is_full,
            record=record,
        )
        line["by_load"][case.load] = {
            name: error.as_dict() for name, error in errors.items()
        }
        line["nodes"] = row["nodes"]
        line["run_time_s"] = min(row["run_time_s"], line.get("run_time_s", np.inf))
        line["shares_voxels"] = case.shares_voxels
    for line in lines.values():
        line |= _worst(list(line["by_load"].values()))
    return list(lines.values())


def _kind(case: Case) -> str:
    """Kind of structure of all bodies; empty where they differ."""
    kinds = {body.structure.kind for body in case.config.bodies}
    return kinds.pop() if len(kinds) == 1 else ""


def _voxels(case: Case) -> str:
    """Equal text for runs in the same voxels under the same load."""
    sizes = [(b.pitch, b.voxels_high, b.surface_cells) for b in case.config.bodies]
    return f"{sizes} {case.truth_key} {case.load}"


def _errors(
    row: Row, truth: Truth, full: Row | None, stands_in: bool, record: Record
) -> dict[str, TruthError]:
    """The complete error, and differences of runs that differ in one property."""
    arrays = record.arrays_of(row)
    times = np.asarray(row["times_s"])
    later = times > 0

    def read(arrays: Arrays, name: str = "surface") -> AtPoints:
        return AtPoints(arrays[name][later], arrays["is_lost"])

    def between(points: AtPoints, reference: AtPoints) -> TruthError:
        return error_at_points(times[later], points, reference)

    run_points = read(arrays)
    expected = truth.points.expected
    reference = AtPoints(np.asarray(expected.temperature)[later], expected.is_lost)
    errors = {"whole": between(run_points, reference)}
    if full is not None:
        full_points = read(record.arrays_of(full))
        errors["discretisation"] = between(full_points, reference)
        # An octree in place of its full volume has no share of its own.
        if not stands_in:
            errors["structure"] = between(run_points, full_points)
    for share, variant in (("time", "converged"), ("reading", "constant")):
        if variant in arrays:
            errors[share] = between(read(arrays, variant), run_points)
    return errors


_SHARES = ("whole", "discretisation", "structure", "time", "reading")


def _worst(loads: list[dict[str, Any]]) -> Row:
    """Largest errors of all loads and saved times."""
    worst: Row = {}
    for share in _SHARES:
        errors = [load[share] for load in loads if share in load]
        if errors:
            worst[f"{share}_kelvin"] = max(e["worst_rms_kelvin"] for e in errors)
    complete = [load["whole"] for load in loads]
    if complete:
        percent = [e["worst_rms_percent"] for e in complete]
        worst["rms_percent"] = max((p for p in percent if p is not None), default=None)
        worst["p99_kelvin"] = max(e["worst_p99_kelvin"] for e in complete)
        worst["bias_kelvin"] = max((e["worst_bias_kelvin"] for e in complete), key=abs)
        worst["lost_fraction"] = max(e["worst_lost_fraction"] for e in complete)
    return worst


_DASH = "\N{EN DASH}"


def _number(name: str) -> Callable[[Row], str]:
    def words(line: Row) -> str:
        value = line.get(name)
        return _DASH if value is None else padded(value)

    return words


def _of_voxels(line: Row) -> str:
    if line["shares_voxels"]:
        return "same voxels"
    return _number("discretisation_kelvin")(line)


_LINE: list[Column] = [
    ("nodes", "{nodes:,}"),
    ("error K", _number("whole_kelvin")),
    ("error %", _number("rms_percent")),
    ("voxels K", _of_voxels),
    ("structure K", _number("structure_kelvin")),
    ("time K", _number("time_kelvin")),
    ("reading K", _number("reading_kelvin")),
    ("run", lambda line: seconds(line["run_time_s"])),
]


def _by_time(name: str) -> Callable[[Row], str]:
    def words(row: Row) -> str:
        values = row["whole"][name]
        return ", ".join(_DASH if v is None else padded(v) for v in values)

    return words


_BY_LOAD: list[Column] = [
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
    "voxels": "error of the full volume of these voxels, or of their octree without "
    "one; structures of the reference's own voxels share their error with it",
    "structure": "difference from that full volume or octree",
    "time": "difference from the run in steps a quarter as long; this and the next "
    "are measured up to a million nodes, of runs that control their error in time",
    "reading": "difference between the temperatures of the nearest nodes and those "
    "corrected by the heat flux, as in all other columns",
    "run": "all passes of the solver until the error in time holds, compiled; the "
    "fastest of the loads",
}


def _cost(name: str, form: Callable[[Any], str]) -> Callable[[Row], str]:
    return lambda row: ", ".join(form(cost[name]) for cost in row["costs"])


def _own_by_time(row: Row) -> str:
    own_error = row["own_error"]
    pairs = zip(own_error["rms_kelvin"], own_error["is_bound"], strict=True)
    return ", ".join(f"bound {padded(v)}" if b else padded(v) for v, b in pairs)


def _orders(row: Row) -> str:
    orders = row["own_error"]["order"]
    return ", ".join(_DASH if p is None else f"{p:.2f}" for p in orders)


# The reference and its two coarser runs, the finest first.
_REFERENCE: list[Column] = [
    ("pitch mm", _cost("pitch_m", lambda pitches: f"{1e3 * pitches[0]:.3g}")),
    ("nodes", _cost("nodes", "{:,}".format)),
    ("memory", _cost("memory_bytes", readable_bytes)),
    ("run", _cost("run_time_s", seconds)),
    ("own error K at each time", _own_by_time),
    ("observed order", _orders),
]


def write_budget(
    lines: Sequence[Row], truths: Sequence[Truth], config: SweepConfig, folder: Path
) -> None:
    """Print the table, and write it with all its loads and times as a page."""
    references = [truth._asdict() for truth in truths]
    own_kelvin = max(truth.own_error["worst_rms_kelvin"] for truth in truths)
    is_bound = any(any(truth.own_error["is_bound"]) for truth in truths)
    structure = config.truth.structure.kind.replace("_", " ")
    about = "at most about" if is_bound else "about"
    caption = (
        f"Reference: {structure} of {references[0]['costs'][0]['nodes']:,} nodes, "
        f"itself off by {about} {padded(own_kelvin)} K"
    )
    names: list[Column] = [
        (axis.replace("_", " "), lambda line, axis=axis: line["choice"][axis])
        for axis in config.axes
    ]
    left = tuple(range(len(names)))
    by_load = [
        {**line, "load": load, **errors}
        for line in lines
        for load, errors in line["by_load"].items()
    ]
    all_loads = table_of(by_load, columns=[*names, *_BY_LOAD], left=left)
    sections: list[page.Section] = [
        table_of(
            lines,
            columns=[*names, *_LINE],
            title="parts of the error",
            caption=caption,
            names=len(names),
            left=left,
        ),
        page.paragraph(caption, note=True),
        *goals_table(config, lines),
        page.terms(list(_TERMS.items())),
        page.details("Every load and time", all_loads),
        page.details("References", table_of(references, _REFERENCE)),
        page.details("The config", page.pre(to_yaml(config))),
    ]
    publish(folder, "Where errors come from", sections)
