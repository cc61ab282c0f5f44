"""Chapter 3: parameters for a tolerance, by the error and the work of structures."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from calibrate.study.case import Case, build_case, plan_case
from calibrate.study.front import Point, points_of
from calibrate.study.sweep import Options, run_sweep
from calibrate.study.times import time_case
from jaxthermo.progress import SILENT
from jaxthermo.report.chart import Chart
from jaxthermo.timing import Spread

from ...harness.line_chart import ALONE, LINE_AND_DOT, CurvePoint, log_chart
from ...harness.present import from_to
from ..bodies import CONFIGS
from ..exhibit import Finding, Numbers, Verdict, exhibit


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
_REPEATS = 5


class Swept(NamedTuple):
    """Points of all choices, and the cases of each by its labels."""

    points: list[Point]
    cases: Mapping[tuple[tuple[str, str], ...], Sequence[Case]]
    work: dict[str, int]
    """Evaluations of heat rates, of one node each, by the name of the choice; unlike
    times they are equal in every run."""
    reference_error: float
    """Error of the reference itself [%]."""

    def cheapest(
        self, tolerance: float, structures: Sequence[str] | None = None
    ) -> Point | None:
        """Least work of those whose error and the reference's meet a tolerance."""
        allowed = math.sqrt(max(tolerance**2 - self.reference_error**2, 0.0))
        within = (
            choice
            for choice in self.points
            if _error(choice) <= allowed
            and (structures is None or choice.choice["structure"] in structures)
        )
        return next(within, None)


@exhibit("section-3-parameters", "3")
def _parameters_for_a_tolerance(quick: bool) -> Finding:
    """Sweep structures, voxels and solvers, and pick the cheapest for a tolerance."""
    swept = _sweep(quick)
    rows = []
    work_over_best = {}
    best_choices = {}
    timed: dict[str, dict[str, float]] = {}
    for tolerance in _TOLERANCES:
        best = swept.cheapest(tolerance)
        if best is None:
            continue
        of_thesis = swept.cheapest(tolerance, _THESIS)
        best_choices[f"{tolerance:g}"] = best.choice
        if of_thesis is not None:
            ratio = swept.work[of_thesis.name] / swept.work[best.name]
            work_over_best[f"{tolerance:g}"] = ratio
        for origin, choice in (("all", best), ("the thesis' own", of_thesis)):
            if choice and not quick and choice.name not in timed:
                timed[choice.name] = _timed(swept, choice)
            row = {"tolerance_percent": tolerance, "of": origin, **_row(swept, choice)}
            if choice and choice.name in timed:
                row |= timed[choice.name]
            rows.append(row)
    return Finding(
        Verdict.NOT_REPRODUCIBLE,
        {
            "own_error_percent": swept.reference_error,
            "best": best_choices,
            "best_words": {
                f"within {tolerance} %:": _words(choice)
                for tolerance, choice in best_choices.items()
            },
            "work_over_best": work_over_best,
            "work_range": from_to(work_over_best.values(), ".2g")
            if work_over_best
            else "an unknown number of",
            "times": timed,
            "by_tolerance": rows,
            "choices": [_row(swept, choice) for choice in swept.points],
        },
        {"parameters": _chart(swept)},
    )


def _sweep(quick: bool) -> Swept:
    with TemporaryDirectory() as folder:
        overrides = _QUICK if quick else ()
        options = Options(times=False)
        sweep = run_sweep(_SWEEP, Path(folder), overrides, options, SILENT)
        rows = [sweep.rows[case.id] for case in sweep.cases]
    points = points_of(rows, [], {load.name for load in sweep.config.loads})
    work = {
        choice.name: choice.nodes
        * _evaluations(sweep.choices[tuple(choice.choice.items())])
        for choice in points
    }
    points.sort(key=lambda choice: work[choice.name])
    return Swept(
        points=points,
        cases=sweep.choices,
        work=work,
        reference_error=max(choice.own_error_percent or 0.0 for choice in points),
    )


def _evaluations(cases: Sequence[Case]) -> int:
    """Largest number of evaluations of a choice: steps, or their stages."""
    counts = []
    for case in cases:
        plan = plan_case(case.config, build_case(case.config).scene)
        counts.append(plan.steps * getattr(plan.stepper, "stages_taken", 1))
    return max(counts)


def _error(choice: Point) -> float:
    return choice.errors["rms_percent"]


def _words(labels: Mapping[str, str]) -> str:
    structure, height, solver = labels.values()
    return f"{structure}, {height} voxels high, {solver}"


def _row(swept: Swept, choice: Point | None) -> Numbers:
    if choice is None:
        return {"choice": "none of these"}
    return {
        "choice": _words(choice.choice),
        "error_percent": _error(choice),
        "error_K": choice.errors["rms_kelvin"],
        "nodes": choice.nodes,
        "steps": choice.steps,
        "work": swept.work[choice.name],
    }


def _timed(swept: Swept, choice: Point) -> dict[str, float]:
    """Run time of a choice, and how much longer the full volume of its voxels takes."""
    times = time_case(swept.cases[tuple(choice.choice.items())][0], _REPEATS)
    loop = Spread.of(times["loop_s"]).median
    full = Spread.of(times["full_volume_loop_s"]).median
    return {"loop_s": loop, "times_faster": full / loop}


def _chart(swept: Swept) -> Chart:
    points = []
    for choice in swept.points:
        name = choice.choice["structure"].removesuffix(", fitted")
        # No more curves than colours: blocks of all sizes are one, without a line.
        is_block = name.startswith("blocks")
        points.append(
            CurvePoint(
                curve="blocks" if is_block else name,
                x=swept.work[choice.name],
                y=_error(choice),
                text=f"{_words(choice.choice)}: {_error(choice):.3g} %",
                marks=ALONE if is_block else LINE_AND_DOT,
            )
        )
    return log_chart(
        points=points,
        x_title="work: evaluations of all nodes",
        y_title="largest error [% of the surface's range]",
        title="Error and work of structures on the figurine",
    )
