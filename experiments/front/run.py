"""`experiments run front`: the front of a sweep and its rivals as a page."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from calibrate.study.case import Case
from calibrate.study.command import default_workers, sweep
from calibrate.study.config import SweepConfig, load_sweep
from calibrate.study.front import Point, front, points_of, rivals_of
from calibrate.study.points import Choice, cases_of
from calibrate.study.summary import about_reference
from calibrate.study.sweep import Options
from calibrate.study.wording import sentence, structure_words
from jaxthermo.config.loader import resolved
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.report.numbers import significant

from .comparisons import (
    Call,
    Comparison,
    choice_loops,
    model_loops,
    pairs,
    time_pairs,
)
from .report import Findings, FrontResult, plain_spread, write_contents, write_report
from .rivals import Rivals, SweepFolder, read_folder


TOLERANCES = (1.0, 3.0)
"""Errors at which the front is compared with every kind of rival [%]."""


class SweepCases:
    """Cases of a sweep's points; the scene of each is read and checked once."""

    def __init__(self, config: SweepConfig):
        """No scene is read yet."""
        self.config = config
        self.loads = [load.name for load in config.loads]
        self._cases: dict[str, dict[str, Case]] = {}

    def __call__(self, point: Point) -> dict[str, Case]:
        """The cases of a point by load."""
        key = json.dumps([point.choice, point.set])
        if key not in self._cases:
            choice = Choice(tuple(point.choice.items()), dict(point.set or {}))
            cases = cases_of(self.config, choice)
            self._cases[key] = {case.load: case for case in cases}
        return self._cases[key]


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """The front of a sweep: of the folder of one, or of a config that is run first.

    Raises:
        InputError: if nothing is named, or the folder has no rows.
    """
    if config is None:
        raise InputError(
            "front: name the config of a sweep, or the folder of one that was run"
        )
    source = config
    console = open_console()
    if not config.is_dir():
        source = folder / "sweep"
        sweep(
            config,
            out=source,
            overrides=(),
            options=Options(
                workers=default_workers(), scheduler=None, retry=False, times=True
            ),
        )
    sweep_config = load_sweep(source / "config.yaml")
    rows = read_folder(source)
    cases = SweepCases(sweep_config)
    head = {"config": resolved(sweep_config), "sweep": str(source)}
    title = f"Error against run time: {sweep_config.scene.stem.replace('-', ' ')}"
    measured = partial(_front, console, cases=cases, rows=rows)
    problems = _problems(cases, _points(cases, rows))
    if len(problems) == 1:
        (points,) = problems.values()
        # Rivals of other commands belong to one problem.
        added_rivals = rivals_of(rows.rivals, set(cases.loads))
        result = measured(
            points=points, added_rivals=added_rivals, folder=folder, title=title
        )
        return {**head, **result}
    fronts: dict[str, FrontResult] = {}
    for name, points in problems.items():
        print_line(console, f"{name}:")
        subfolder = folder / name.replace("/", "-")
        subfolder.mkdir(parents=True, exist_ok=True)
        result = measured(
            points=points, added_rivals=[], folder=subfolder, title=f"{title}, {name}"
        )
        result["files"] = [f"{subfolder.name}/{file}" for file in result["files"]]
        fronts[name] = result
    write_contents(folder / "report.html", title=title, fronts=fronts)
    files = [file for result in fronts.values() for file in result["files"]]
    return {**head, "fronts": fronts, "files": [*files, "report.html"]}


def _problems(cases: SweepCases, points: Sequence[Point]) -> dict[str, Sequence[Point]]:
    """Points by their common labels, where they have several references.

    Errors and times of choices with different materials differ for other reasons than
    the choice of a model: they have no common front.
    """
    groups: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        keys = tuple(case.truth_key for case in cases(point).values())
        groups.setdefault(keys, []).append(point)
    if len(groups) < 2:
        return {"": points}
    problems: dict[str, Sequence[Point]] = {}
    for number, problem_points in enumerate(groups.values(), 1):
        further = [point for point in points if point not in problem_points]
        labels = [
            label
            for axis, label in problem_points[0].choice.items()
            if {point.choice[axis] for point in problem_points} == {label}
            and label not in {point.choice[axis] for point in further}
        ]
        problems[", ".join(labels) or f"problem {number}"] = problem_points
    return problems


def _front(
    console: Console,
    cases: SweepCases,
    rows: SweepFolder,
    points: Sequence[Point],
    added_rivals: Sequence[Point],
    folder: Path,
    title: str,
) -> FrontResult:
    """The front of one problem and its rivals, printed and as a page."""
    models = [rival for rival in added_rivals if rival.models is not None]
    compared = _compare_with_rivals(
        console, cases=cases, points=points, models=models, rows=rows, folder=folder
    )
    # In the folder of the sweep, the file has the rivals of this run as well.
    names = {rival.name for rival in compared.rivals}
    rivals = [rival for rival in added_rivals if rival.name not in names]
    findings = Findings(
        title=title,
        about=[_about(cases, rows=rows, points=points), compared.remark],
        folder=rows,
        points=list(points),
        rivals=[*rivals, *compared.rivals],
        comparisons=compared.comparisons,
        config=resolved(cases.config),
    )
    files = write_report(findings, folder)
    for number, point in enumerate(findings.best, 1):
        print_line(console, f"{number}. {sentence(point)}")
    for comparison in compared.comparisons:
        print_line(console, comparison.sentence())
    return {
        "front": [
            {
                "sentence": sentence(point),
                "choice": point.choice,
                "errors": point.errors,
                "loop_s": plain_spread(point.time),
                "full_volume_times_faster": plain_spread(point.ratio),
                "nodes": point.nodes,
                "memory_bytes": point.memory_bytes,
            }
            for point in findings.best
        ],
        "comparisons": [pair.as_dict() for pair in compared.comparisons],
        "remarks": [compared.remark],
        "processors": findings.processors,
        "files": files,
    }


def _points(cases: SweepCases, rows: SweepFolder) -> list[Point]:
    """Points of the sweep, with their structures in words."""
    points = points_of(rows.rows, rows.times, set(cases.loads))
    heights: dict[str, float] = {}

    def words(point: Point) -> str | None:
        body = cases(point)[cases.loads[0]].config.bodies[0]
        pitch = body.pitch
        if pitch is None:
            # Meshes of one file and height are loaded once.
            key = str((body.mesh, body.shape, body.solid))
            if key not in heights:
                heights[key] = float(np.ptp(body.build_mesh().bounds[:, 2]))
            pitch = heights[key] / float(body.voxels_high or 1)
        weights = getattr(body.structure, "weights", None)
        fitted = weights is not None and weights != type(weights)()
        return structure_words(resolved(body.structure), pitch=pitch, fitted=fitted)

    return [replace(point, words=words(point)) for point in points]


class _Compared(NamedTuple):
    """Rivals of a front and the comparisons with them."""

    rivals: list[Point]
    comparisons: list[Comparison]
    remark: str
    """Sentence on the rivals, or on the reason why there are none."""


def _compare_with_rivals(
    console: Console,
    cases: SweepCases,
    points: Sequence[Point],
    models: Sequence[Point],
    rows: SweepFolder,
    folder: Path,
) -> _Compared:
    """Measure rivals, and time them alternately with the choices of the front."""
    best = front(points)
    if not best:
        return _Compared([], [], "No choice was timed, and no rival was run.")
    log = partial(print_line, console)
    try:
        rivals = Rivals(cases(best[0]), path=folder / "rivals.jsonl", log=log)
        needed = min(best[-1].errors["rms_percent"], *TOLERANCES)
        rivals.search(needed, TOLERANCES)
    except InputError as error:
        print_line(console, str(error))
        return _Compared([], [], f"There are no rivals: {error}.")
    rival_points = rivals_of(rivals.rows, set(cases.loads))

    def loops(point: Point) -> Iterator[tuple[str, Call]]:
        if point.models is not None:
            return model_loops(rows.path, point.models)
        return choice_loops(cases(point))

    chosen_pairs = pairs(
        points, rivals=rival_points, tolerances=TOLERANCES, models=models
    )
    comparisons = time_pairs(
        chosen_pairs, loops=loops, rivals=rivals, repeats=cases.config.repeats, log=log
    )
    errors = [rival.errors["rms_percent"] for rival in rival_points]
    remark = f"Voxels of the rivals: {rivals.tried}"
    if errors:
        remark += f"; none has a smaller error than {significant(min(errors))} %"
    return _Compared(rival_points, comparisons, f"{remark}.")


def _about(cases: SweepCases, rows: SweepFolder, points: Sequence[Point]) -> str:
    own_errors = [
        p.own_error_percent for p in points if p.own_error_percent is not None
    ]
    reference = cases.config.truth
    truth = f"{reference.voxels_high} voxels high"
    if reference.pitch is not None:
        truth = f"of {1e3 * reference.pitch:g} mm voxels"
    text = f"{len(points)} choices under {', '.join(cases.loads)}"
    if rows.failed:
        text += f"; {len(rows.failed)} cases could not be run"
    text += f". Errors are against a reference {truth}"
    if own_errors:
        text += f", which itself is off by about {max(own_errors):.2g} %"
    cases_of_points = [case for point in points for case in cases(point).values()]
    return " ".join([f"{text}.", *about_reference(cases_of_points)])
