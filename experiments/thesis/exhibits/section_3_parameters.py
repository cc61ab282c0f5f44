"""Section 3: parameters for a tolerance, by the error and the work of structures."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from calibrate.study.case import Case, build_case, plan_case
from calibrate.study.front import Point, points_of
from calibrate.study.sweep import Log, Options, run_sweep
from calibrate.study.times import time_case
from jaxthermo.report.chart import Chart
from jaxthermo.report.table import Cell, Table
from jaxthermo.timing import Spread

from ...harness.present import from_to
from ..bodies import CONFIGS
from ..exhibit import Exhibit, Finding, Note, Part, Plot, Row, Verdict
from ..line_chart import log_chart, point


_SWEEP = CONFIGS / "sweeps" / "parameters.yaml"
# Tolerances of the surface's error [% of its range].
_TOLERANCES = (10.0, 5.0, 3.0, 2.0, 1.0)
_THESIS = ("full volume", "single shell", "2 levels", "irregular levels")
_QUICK = (
    "loads=[{name: +x}]",
    "sampling.points=[{structure: [full volume, single shell, irregular levels], "
    "voxels_high: 48, solver: explicit}, {structure: [blocks x2, blocks x3], "
    "voxels_high: 96, solver: RKL2 19}]",
)
# Letters of a cell from which it goes over several lines.
_LONG = 34
# Runs of each that is timed.
_REPEATS = 5
# Measured tables of the documentation: file, table, and heading.
_DATA = Path(__file__).parents[3] / "docs" / "data"
_TRACKED = (
    ("front", "best", "Measured before: fronts of three meshes"),
    ("plan", "beside_sweeps", "Measured before: plans beside fronts"),
    ("fits", "buddha", "Measured before: fits of the Happy Buddha, 250 high"),
)


class _Swept(NamedTuple):
    """Points of all choices, and the cases of each by its labels."""

    points: list[Point]
    cases: dict[tuple[tuple[str, str], ...], list[Case]]
    work: dict[str, int]
    """Evaluations of heat rates, of one node each, by the name of the choice; unlike
    times they are the same in every run."""
    own_error: float
    """Error of the reference itself [%]."""


def _swept(quick: bool) -> _Swept:
    overrides = _QUICK if quick else ()
    with TemporaryDirectory() as folder:
        given = Options(times=False)
        sweep = run_sweep(_SWEEP, Path(folder), overrides, given, Log())
        rows = [sweep.rows[case.id] for case in sweep.cases]
    points = points_of(rows, [], {load.name for load in sweep.config.loads})
    own = max(each.own_error_percent or 0.0 for each in points)
    work = {
        each.name: each.nodes * _evaluations(sweep.choices[tuple(each.choice.items())])
        for each in points
    }
    points.sort(key=lambda each: work[each.name])
    return _Swept(points, sweep.choices, work, own)


def _evaluations(cases: Sequence[Case]) -> int:
    """Largest number of evaluations of a choice: steps, or their stages."""
    counts = []
    for case in cases:
        plan = plan_case(case.config, build_case(case.config).scene)
        counts.append(plan.steps * getattr(plan.stepper, "stages_taken", 1))
    return max(counts)


def _error(each: Point) -> float:
    return each.errors["rms_percent"]


def _cheapest(
    swept: _Swept, tolerance: float, kinds: Sequence[str] | None = None
) -> Point | None:
    """Least work of those whose error and the reference's keep a tolerance."""
    allowed = math.sqrt(max(tolerance**2 - swept.own_error**2, 0.0))
    within = [
        each
        for each in swept.points
        if _error(each) <= allowed and (not kinds or each.choice["structure"] in kinds)
    ]
    return within[0] if within else None


def _words(each: Point | None) -> str:
    if each is None:
        return "none of these"
    structure, high, solver = each.choice.values()
    return f"{structure}, {high} voxels high, {solver}"


def _note(swept: _Swept, each: Point | None, times: dict[str, dict[str, Any]]) -> str:
    if each is None:
        return ""
    work = swept.work[each.name]
    text = f"{_error(each):.2g} %, {each.nodes:,} nodes, work {work:.2g}"
    if each.name in times:
        own = times[each.name]
        text += (
            f"; {own['words']}, explicit full volume of its voxels "
            f"{own['times_faster']:.2g} times as long"
        )
    return text


def _timed(swept: _Swept, chosen: Sequence[Point]) -> dict[str, dict[str, Any]]:
    """Run times of choices, each in turn with the full volume of its voxels."""
    found = {}
    for each in chosen:
        row = time_case(swept.cases[tuple(each.choice.items())][0], _REPEATS)
        own, full = (Spread.of(row[k]) for k in ("loop_s", "full_volume_loop_s"))
        found[each.name] = {
            "words": own.text(),
            "times_faster": full.median / own.median,
        }
    return found


def _chart(swept: _Swept) -> Chart:
    marks = []
    for each in swept.points:
        text = f"{_words(each)}: {_error(each):.3g} %"
        name = each.choice["structure"].removesuffix(", fitted")
        # No more curves than colours: blocks of all sizes are one, without a line.
        is_block = name.startswith("blocks")
        curve = "blocks" if is_block else name
        at = swept.work[each.name], _error(each)
        marks.append(point(curve, *at, text, mark=is_block))
    axes = "work: evaluations of all nodes", "largest error [% of the surface's range]"
    return log_chart(marks, *axes, "Error and work of structures on the figurine")


def _point_table(swept: _Swept) -> Table:
    rows = [
        [
            _words(each),
            Cell(f"{_error(each):.3g} %", is_number=True),
            f"{each.errors['rms_kelvin']:.3g} K",
            f"{each.nodes:,}",
            f"{each.steps:,}",
            f"{swept.work[each.name]:.2e}",
        ]
        for each in swept.points
    ]
    columns = ("choice", "error", "", "nodes", "steps", "work")
    return Table(columns, rows, "All choices, the least work first")


def _tracked_tables() -> list[Part]:
    """Tables that the documentation keeps, with the command and machine of each."""
    found: list[Part] = []
    for file, name, title in _TRACKED:
        path = _DATA / f"{file}.json"
        if not path.is_file():
            continue
        data = json.loads(path.read_text(encoding="utf-8"))
        table = data["tables"][name]
        columns = [column.replace("`", "") for column in table["columns"]]
        rows = [[cell.replace("`", "") for cell in row] for row in table["rows"]]
        caption = f"{data['about']} {data['command']}; {data['machine']}."
        every = range(len(columns))
        shown = [[Cell(cell, wraps=len(cell) > _LONG) for cell in row] for row in rows]
        found.append(Table(columns, shown, title, caption, left=every))
    return found


def _measure(quick: bool) -> Finding:
    swept = _swept(quick)
    best = {t: _cheapest(swept, t) for t in _TOLERANCES}
    theirs = {t: _cheapest(swept, t, _THESIS) for t in _TOLERANCES}
    every = {e.name: e for e in (*best.values(), *theirs.values()) if e is not None}
    times = {} if quick else _timed(swept, list(every.values()))
    met = {t: each for t, each in best.items() if each is not None}
    saved = {
        t: swept.work[other.name] / swept.work[each.name]
        for t, each in met.items()
        if (other := theirs[t]) is not None
    }
    reason = (
        "The thesis announces optimal parameters and then names none: no number of "
        "levels, no weight, no step, no tolerance. Here, on the figurine: "
        + "; ".join(f"within {t:g} % {_words(each)}" for t, each in met.items())
        + ". "
        + (
            "The cheapest of the thesis' own structures takes "
            f"{from_to(saved.values(), '.2g')} times the work "
            f"({', '.join(f'{t:g} %' for t in saved)})."
            if saved
            else "None of the thesis' own structures keeps any of these."
        )
        + " `calibrate plan SCENE --tolerance 3%` finds the model for any scene."
    )
    rows = tuple(
        Row(
            f"within {t:g} %, {words}",
            None,
            _words(each[t]),
            _note(swept, each[t], times),
        )
        for t in _TOLERANCES
        for words, each in (("of all", best), ("of the thesis' own", theirs))
        if t in met
    )
    missed = [f"{t:g} %" for t in _TOLERANCES if t not in met]
    if missed:
        rows = (*rows, Row(f"within {', '.join(missed)}", None, _words(None)))
    chosen = (
        ("scene", "the built-in figurine in stainless steel, one side in the sun"),
        (
            "error",
            "largest root mean square over the surface, against finer voxels, which "
            f"are off by {swept.own_error:.2g} % themselves: both keep a tolerance "
            "together",
        ),
        ("work", "evaluations of all nodes, which do not depend on the machine"),
        *(
            [("reduced", "the thesis' own structures in 48 voxels alone")]
            if quick
            else []
        ),
    )
    caption = "Lines join one structure in several voxels; diamonds are blocks."
    parts = (
        Plot("parameters", _chart(swept), caption),
        _point_table(swept),
        *_tracked_tables(),
        Note("Tables measured before are read from docs/data, not measured again."),
    )
    numbers = {
        "own_error_percent": swept.own_error,
        "best": {f"{t:g}": each.choice for t, each in met.items()},
        "work_over_best": {f"{t:g}": ratio for t, ratio in saved.items()},
        "times": times,
    }
    verdict = Verdict.NOT_REPRODUCIBLE
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="section-3-parameters",
    title="parameters for a tolerance",
    place="3",
    claims=("C16",),
    measure=_measure,
)
