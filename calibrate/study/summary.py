"""The results of a sweep: a line for each choice, as table, page and `result.json`."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any, NotRequired, TypedDict, cast

from jaxthermo.atomic import write_json
from jaxthermo.config.loader import resolved, to_yaml
from jaxthermo.provenance import processor, provenance
from jaxthermo.report import page
from jaxthermo.report.chart import chart_svg
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table
from jaxthermo.timing import Spread

from ..problem.reference import program_hash
from .case import Case
from .config import OptunaSampling, RandomSampling, SobolSampling, SweepConfig
from .front import Cost, points_of
from .front_charts import error_against, numbered, tooltips
from .rows import Row
from .sweep import Sweep, worst_percent
from .tuning import Tuning, sections as tuning_sections


_COLUMNS = (
    "error %",
    "error K",
    "99 % K",
    "nodes",
    "steps",
    "energy",
    "loop",
    "full volume",
)


class _LoopTimes(TypedDict, total=False):
    """Times of the slowest load [s]; none if a load was not timed."""

    loop_s: float
    loop_min_s: float
    loop_max_s: float
    full_volume_loop_s: float


class _ChoiceLine(_LoopTimes):
    """A choice in `result.json`; with failed loads it has a label and reasons only."""

    choice: dict[str, str]
    """Label by axis."""
    failed: list[str]
    """Reason by load."""
    rms_percent: float | None
    """Largest error of all saved times and loads [%]; None for an infinite one."""
    rms_kelvin: float
    p99_kelvin: float
    lost_fraction: float
    nodes: int
    steps: int
    energy_residual: float


class _CaseCounts(TypedDict):
    all: int
    finished: int
    failed: int
    timed: int


class _SweepResult(TypedDict):
    """`result.json` as far as the page shows it."""

    program_hash: str
    config_hash: str
    commit: NotRequired[str]
    processor: str
    cases: _CaseCounts
    choices: list[_ChoiceLine]
    fit: NotRequired[Tuning]


def lines(sweep: Sweep) -> list[_ChoiceLine]:
    """Choices with their errors and times over all loads, the smallest error first."""
    lines: list[_ChoiceLine] = []
    for names, cases in sweep.choices.items():
        rows = [sweep.rows[case.id] for case in cases if case.id in sweep.rows]
        if not rows:
            continue
        failed = [f"{r['load']}: {r['failed']}" for r in rows if "failed" in r]
        choice = dict(names)
        if failed:
            failed_line = {"choice": choice, "failed": failed}
            lines.append(cast(_ChoiceLine, failed_line))
            continue
        errors = [row["error"] for row in rows]
        # Rows of earlier versions have none.
        residuals = [row.get("energy_residual", 0.0) for row in rows]
        times = [sweep.times.get(case.id) for case in cases]
        line: _ChoiceLine = {
            "choice": choice,
            "failed": failed,
            "rms_percent": worst_percent(rows),
            "rms_kelvin": _largest(errors, "worst_rms_kelvin"),
            "p99_kelvin": _largest(errors, "worst_p99_kelvin"),
            "lost_fraction": _largest(errors, "worst_lost_fraction"),
            "nodes": max(row["nodes"] for row in rows),
            "steps": max(row["steps"] for row in rows),
            "energy_residual": max(residuals),
            **_run_times(times),
        }
        lines.append(line)
    return sorted(lines, key=_rank)


def _rank(line: _ChoiceLine) -> tuple[bool, float]:
    return bool(line["failed"]), line.get("rms_percent") or float("inf")


def _largest(errors: Sequence[Row], name: str) -> float:
    return max(error[name] or 0.0 for error in errors)


def _run_times(rows: list[Row | None]) -> _LoopTimes:
    timed = [row for row in rows if row is not None and "failed" not in row]
    if len(timed) < len(rows) or not timed:
        return {}
    slowest = max(timed, key=lambda row: statistics.median(row["loop_s"]))
    loop = Spread.of(slowest["loop_s"])
    return {
        "loop_s": loop.median,
        "loop_min_s": loop.low,
        "loop_max_s": loop.high,
        "full_volume_loop_s": statistics.median_high(slowest["full_volume_loop_s"]),
    }


def table(sweep: Sweep, limit: int | None = None) -> Table:
    """Choices as a table, the best first."""
    choice_lines = lines(sweep)
    rows = [_row(line) for line in choice_lines[:limit]]
    axes = list(sweep.config.axes)
    title = "Error against the reference, the largest over all loads and saved times"
    caption = f"Run times: {processor()}." if sweep.times else ""
    left = tuple(range(len(axes)))
    names = [axis.replace("_", " ") for axis in axes]
    return Table(
        columns=[*names, *_COLUMNS], rows=rows, title=title, caption=caption, left=left
    )


def _row(line: _ChoiceLine) -> list[str | Cell]:
    names = [*line["choice"].values()]
    if line["failed"]:
        reason = Cell(line["failed"][0], wraps=True, columns=len(_COLUMNS))
        return [*names, reason]
    loop = ""
    full_volume = ""
    if "loop_s" in line and "full_volume_loop_s" in line:
        loop = seconds(line["loop_s"])
        full_volume = seconds(line["full_volume_loop_s"])
    error = line["rms_percent"]
    percent = "infinite" if error is None else f"{error:.3g}"
    return [
        *names,
        percent,
        f"{line['rms_kelvin']:.3g}",
        f"{line['p99_kelvin']:.3g}",
        f"{line['nodes']:,}",
        f"{line['steps']:,}",
        f"{line['energy_residual']:.0e}",
        loop,
        full_volume,
    ]


def write_results(sweep: Sweep, fit: Tuning | None = None) -> None:
    """Write `result.json` and `report.html` into the folder of a sweep.

    Args:
        sweep: that has been run.
        fit: comparison with a fit, if there is one.
    """
    failures = [
        {key: row[key] for key in ("id", "choice", "load", "failed")}
        for row in sweep.rows.values()
        if "failed" in row
    ]
    result = {
        "experiment": "sweep",
        **provenance(sweep.hash, _seed(sweep.config)),
        "program_hash": program_hash(),
        "config": resolved(sweep.config),
        "cases": {
            "all": len(sweep.cases),
            "finished": sum(case.id in sweep.rows for case in sweep.cases),
            "failed": len(failures),
            "timed": sum("loop_s" in row for row in sweep.times.values()),
        },
        "failures": failures,
        "choices": lines(sweep),
        **({} if fit is None else {"fit": fit}),
    }
    write_json(sweep.folder / "result.json", result)
    _write_page(sweep, cast(_SweepResult, result))


def goals_table(config: SweepConfig, lines: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Smallest error within the nodes of each goal; no table without goals.

    Args:
        config: of the sweep.
        lines: with `choice`, `nodes` and `rms_percent`; those of failed cases have no
            error.
    """
    rows: list[list[str | Cell]] = []
    for goal in config.goals or ():
        judged = [line for line in lines if line.get("rms_percent") is not None]
        fitting = [line for line in judged if line["nodes"] <= goal.nodes]
        goal_cells = [f"{goal.nodes:,}", f"{goal.error_percent:g}"]
        if not fitting:
            rows.append([*goal_cells, Cell("none", False), "", ""])
            continue
        best = min(fitting, key=lambda line: line["rms_percent"])
        percent = best["rms_percent"]
        name = ", ".join(best["choice"].values())
        best_cell = Cell(f"{percent:.3g}", met=percent <= goal.error_percent)
        rows.append([*goal_cells, best_cell, name, f"{best['nodes']:,}"])
    headings = ("nodes at most", "% at most", "best %", "choice", "nodes")
    return [Table(headings, rows, title="goals", left=(3,))] if rows else []


def about_reference(cases: Sequence[Case]) -> list[str]:
    """Sentence on the parts of the errors of choices with the reference's voxels."""
    shared = sum(case.shares_voxels for case in cases)
    if not shared:
        return []
    which = "All choices" if shared == len(cases) else "Some choices"
    return [
        f"{which} have the voxels of the reference: their errors are of structure, of "
        "steps and of reading the surface, and not of the voxels."
    ]


def _charts(sweep: Sweep) -> list[page.Section]:
    """Error against run time and nodes, with the differences of each choice."""
    finished = [row for row in sweep.rows.values() if "failed" not in row]
    loads = {load.name for load in sweep.config.loads}
    points = points_of(finished, sweep.times.values(), loads)
    costs: tuple[Cost, ...] = ("time_s", "nodes")
    drawn = [
        error_against(cost, points)
        for cost in costs
        if len({point.cost(cost) for point in points}) > 1
    ]
    charts = [numbered(chart_svg(chart), points) for chart in drawn if chart]
    if not charts:
        return []
    words = (
        "A step joins the choices that no other one beats in both error and cost. A "
        "point tells its choice, and shows where it differs from the reference."
    )
    return [
        page.heading("Error against cost"),
        words,
        *charts,
        tooltips(points, sweep.folder),
    ]


def _seed(config: SweepConfig) -> int | None:
    match config.sampling:
        case RandomSampling() | SobolSampling() | OptunaSampling() as drawn:
            return drawn.seed
    return None


def _write_page(sweep: Sweep, result: _SweepResult) -> None:
    counts = result["cases"]
    config = sweep.config
    own_errors = [row["own_error"] for row in sweep.rows.values() if "own_error" in row]
    sections: list[page.Section] = [
        f"{counts['finished']} of {counts['all']} cases are finished, of which "
        f"{counts['failed']} failed; {counts['timed']} are timed.",
        "The error of a choice is that of the worst of its loads at its worst saved "
        "time: the root mean square of the difference from the reference over "
        f"{config.truth.points:,} points of the surface.",
        *about_reference(sweep.cases),
    ]
    if own_errors:
        largest = max(own_error["worst_rms_kelvin"] for own_error in own_errors)
        sections.append(f"The reference itself is off by about {largest:.3g} K.")
    if "fit" in result:
        sections += tuning_sections(sweep, result["fit"])
    sections += _charts(sweep)
    sections += [page.heading("Choices"), table(sweep)]
    sections += goals_table(config, result["choices"])
    if sweep.times:
        sections.append(
            page.paragraph(
                "Loop: median of the compiled time loop with the surface read at the "
                "saved times, of the slowest load. Full volume: explicit loop in the "
                f"same voxels, timed alternately. {result['processor']}.",
                note=True,
            )
        )
    energy = (
        "99 % K: difference that 99 % of the surface stays below. Energy: heat that "
        "the ledger leaves unexplained, over the heat that moved."
    )
    sections.append(page.paragraph(energy, note=True))
    sections += [
        page.heading("Origin"),
        page.terms(
            [
                ("config", result["config_hash"]),
                ("program", result["program_hash"]),
                ("commit", result.get("commit", "installed")),
                ("processor", result["processor"]),
            ]
        ),
        page.details("Config", page.pre(to_yaml(config))),
    ]
    name = config.scene.stem.replace("-", " ").replace("_", " ")
    page.write_page(sweep.folder / "report.html", f"Sweep: {name}", sections)
