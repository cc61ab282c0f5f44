"""`experiments run front`: the front of a sweep, beside rivals, as a page."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from calibrate.runs.case import Case
from jaxthermo.config.loader import resolved as plain_scene
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.report.numbers import significant

from ..sweep.command import default_workers, sweep
from ..sweep.config import SweepConfig, load_sweep, resolved
from ..sweep.points import Choice, cases_of
from ..sweep.run import Options
from ..sweep.summary import about_reference
from .comparisons import (
    Call,
    Comparison,
    choice_loops,
    model_loops,
    pairs,
    time_pairs,
)
from .folder import SweepFolder, read_folder
from .pareto import Point, front, points_of, rivals_of
from .report import Findings, write_contents, write_report
from .rivals import Rivals
from .wording import sentence, structure_words


TOLERANCES = (1.0, 3.0)
"""Errors at which the front is compared with every kind of rival [%]."""


class SweepCases:
    """Cases of a sweep's points; the scene of each is read and checked once."""

    def __init__(self, config: SweepConfig):
        """No scene is read yet."""
        self.config = config
        self.loads = [load.name for load in config.loads]
        self._found: dict[str, dict[str, Case]] = {}

    def __call__(self, point: Point) -> dict[str, Case]:
        """The cases of a point by load."""
        key = json.dumps([point.choice, point.set])
        if key not in self._found:
            choice = Choice(tuple(point.choice.items()), dict(point.set or {}))
            own = {case.load: case for case in cases_of(self.config, choice)}
            self._found[key] = own
        return self._found[key]


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """The front of a sweep: of the folder of one, or of a config that is run first.

    Raises:
        InputError: if nothing is named, or the folder has no rows.
    """
    if config is None:
        raise InputError(
            "front: name the config of a sweep, or the folder of one that was run"
        )
    source, console = config, open_console()
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
    given, rows = load_sweep(source / "config.yaml"), read_folder(source)
    cases = SweepCases(given)
    head = {"config": resolved(given), "sweep": str(source)}
    title = f"Error against run time: {given.scene.stem.replace('-', ' ')}"
    problems = _problems(cases, _points(cases, rows))
    if len(problems) == 1:
        ((_, points),) = problems.items()
        # Rivals that others have added are of one problem.
        others = rivals_of(rows.rivals, set(cases.loads))
        return {
            **head,
            **_front(
                console,
                cases=cases,
                rows=rows,
                points=points,
                others=others,
                folder=folder,
                title=title,
            ),
        }
    fronts = {}
    for name, points in problems.items():
        print_line(console, f"{name}:")
        own = folder / name.replace("/", "-")
        own.mkdir(parents=True, exist_ok=True)
        made = _front(
            console,
            cases=cases,
            rows=rows,
            points=points,
            others=[],
            folder=own,
            title=f"{title}, {name}",
        )
        fronts[name] = {
            **made,
            "files": [f"{own.name}/{file}" for file in made["files"]],
        }
    write_contents(folder / "report.html", title, fronts)
    files = [file for each in fronts.values() for file in each["files"]]
    return {**head, "fronts": fronts, "files": [*files, "report.html"]}


def _problems(cases: SweepCases, points: Sequence[Point]) -> dict[str, Sequence[Point]]:
    """Points by what they have in common, where they have not all one reference.

    Choices of another material have other errors and times for reasons of their own: no
    front is through both.
    """
    groups: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        keys = tuple(case.truth_key for case in cases(point).values())
        groups.setdefault(keys, []).append(point)
    if len(groups) < 2:
        return {"": points}
    found: dict[str, Sequence[Point]] = {}
    for number, own in enumerate(groups.values(), 1):
        others = [point for point in points if point not in own]
        labels = [
            label
            for axis, label in own[0].choice.items()
            if {point.choice[axis] for point in own} == {label}
            and label not in {point.choice[axis] for point in others}
        ]
        found[", ".join(labels) or f"problem {number}"] = own
    return found


def _front(
    console: Console,
    cases: SweepCases,
    rows: SweepFolder,
    points: Sequence[Point],
    others: Sequence[Point],
    folder: Path,
    title: str,
) -> dict[str, Any]:
    """The front of points of one problem beside rivals, printed and as a page."""
    models = [other for other in others if other.models is not None]
    found, comparisons, remark = _beside(
        console, cases=cases, points=points, models=models, rows=rows, folder=folder
    )
    remarks = [remark] if remark else []
    about = [_about(cases, rows, points), *remarks]
    # In one folder with the sweep, the file has the rivals of this run as well.
    names = {rival.name for rival in found}
    found = [*(other for other in others if other.name not in names), *found]
    own, plain = list(points), resolved(cases.config)
    findings = Findings(
        title=title,
        about=about,
        folder=rows,
        points=own,
        rivals=found,
        comparisons=comparisons,
        config=plain,
    )
    files = write_report(findings, folder)
    for number, point in enumerate(front(points), 1):
        print_line(console, f"{number}. {sentence(point)}")
    for each in comparisons:
        print_line(console, each.sentence())
    return {
        "front": [_plain(point) for point in front(points)],
        "comparisons": [each.as_dict() for each in comparisons],
        "remarks": remarks,
        "processors": findings.processors,
        "files": files,
    }


def _points(cases: SweepCases, rows: SweepFolder) -> list[Point]:
    """Points of the sweep, with what they are in words."""
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
        return structure_words(plain_scene(body.structure), pitch, fitted)

    return [replace(point, words=words(point)) for point in points]


def _beside(
    console: Console,
    cases: SweepCases,
    points: Sequence[Point],
    models: Sequence[Point],
    rows: SweepFolder,
    folder: Path,
) -> tuple[list[Point], list[Comparison], str | None]:
    """Rivals, comparisons with them, and the reason where there are none."""
    loads, best = set(cases.loads), front(points)
    if not best:
        return [], [], "No choice was timed, and no rival was run."
    log = lambda text: print_line(console, text)
    try:
        rivals = Rivals(cases(best[0]), folder / "rivals.jsonl", log)
        needed = min(best[-1].errors["rms_percent"], *TOLERANCES)
        rivals.search(needed, TOLERANCES)
    except InputError as error:
        print_line(console, str(error))
        return [], [], f"There are no rivals: {error}."
    found = rivals_of(rivals.rows, loads)

    def loops(point: Point) -> Iterator[tuple[str, Call]]:
        if point.models is not None:
            return model_loops(rows.path, point.models)
        return choice_loops(cases(point))

    chosen = pairs(points, rivals=found, tolerances=TOLERANCES, models=models)
    comparisons = time_pairs(
        chosen, loops=loops, rivals=rivals, repeats=cases.config.repeats, log=log
    )
    least = min((rival.errors["rms_percent"] for rival in found), default=None)
    remark = f"Voxels of the rivals: {rivals.tried}"
    if least is not None:
        remark += f"; none has a smaller error than {significant(least)} %"
    return found, comparisons, f"{remark}."


def _about(cases: SweepCases, rows: SweepFolder, points: Sequence[Point]) -> str:
    own = [p.own_error_percent for p in points if p.own_error_percent is not None]
    given = cases.config.truth
    truth = f"{given.voxels_high} voxels high"
    if given.pitch is not None:
        truth = f"of {1e3 * given.pitch:g} mm voxels"
    text = f"{len(points)} choices under {', '.join(cases.loads)}"
    if rows.failed:
        text += f"; {len(rows.failed)} cases could not be run"
    text += f". Errors are against a reference {truth}"
    if own:
        text += f", which itself is off by about {max(own):.2g} %"
    every = [case for point in points for case in cases(point).values()]
    return " ".join([f"{text}.", *about_reference(every)])


def _plain(point: Point) -> dict[str, Any]:
    spread = lambda value: None if value is None else vars(value)
    return {
        "sentence": sentence(point),
        "choice": point.choice,
        "errors": point.errors,
        "loop_s": spread(point.time),
        "full_volume_times_faster": spread(point.ratio),
        "nodes": point.nodes,
        "memory_bytes": point.memory_bytes,
    }
