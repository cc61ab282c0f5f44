"""`calibrate plan`: a scene's cheapest model within a tolerance, as a scene file."""

import json
import math
import re
import sys
import textwrap
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict, cast

from rich.console import Console

from jaxthermo.__main__ import main as run_jaxthermo
from jaxthermo.accuracy.error_records import ReferenceErrors, finite_number
from jaxthermo.archive import read_record, signed, text_hash
from jaxthermo.atomic import replacing, write_json
from jaxthermo.config.loader import config_hash, load_config, resolved, to_yaml
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.types.quantities import (
    NUMBER,
    TEMPERATURE_DIFFERENCE,
    Unit,
    to_si,
)
from jaxthermo.console.progress import terminal_progress
from jaxthermo.console.results_folder import results_folder
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor, provenance
from jaxthermo.report.numbers import count
from jaxthermo.report.table import Cell, Table

from ..problem.reference import RunCost, program_hash
from ..study.rows import Row, Rows
from .candidate import pitches_of
from .search import MAX_OWN_ERROR, Choice, search
from .tolerance import Tolerance


_SCENE = "scene.yaml"
_PLAN = "plan.json"
_ROWS = "rows.jsonl"
"""Candidates of all tolerances that were run in a folder."""
_NOTHING_MEETS_IT = 3
"""Exit status where no candidate is within the tolerance."""

_KIND = "plan"
_VERSION = 1
_TIME = Unit("s", "a time", "10 ms")
_SEARCH_TIME = Unit("s", "a time", "2 min")
_MEMORY = Unit("byte", "an amount of memory", "2 GB")
_WIDTH = 96
_LISTED = 12
"""Rows of the table of candidates at most."""


def tolerance_of(
    percent: str | None, kelvin: str | None, run_time: str | None, memory: str | None
) -> Tolerance:
    """Tolerance of the options as they are given.

    Raises:
        InputError: for a value that is no positive number of its unit, or no error.
    """
    if percent is None and kelvin is None:
        raise InputError(
            "plan: give a --tolerance such as 1%, or --kelvin 0.2, or both"
        )
    if percent is not None and not percent.strip().endswith(("%", "percent")):
        raise InputError(
            f"--tolerance {percent}: give it in percent of the surface's range, such "
            "as 1%, or an error in kelvin as --kelvin 0.2"
        )
    fraction = _positive("--tolerance", percent, NUMBER)
    return Tolerance(
        percent=None if fraction is None else 100 * fraction,
        kelvin=_positive("--kelvin", kelvin, TEMPERATURE_DIFFERENCE),
        run_time=_positive("--time-budget", run_time, _TIME),
        memory=_positive("--memory", memory, _MEMORY),
    )


def search_time_of(text: str | None) -> float:
    """Time of a search [s] of the option as it is given; infinite without it.

    Raises:
        InputError: for a value that is no positive time.
    """
    if text is None:
        return math.inf
    # A unit of length elsewhere.
    minutes = re.sub(r"(?<=[\d.])\s*m\s*$", " min", text)
    seconds = _positive("--search-time", minutes, _SEARCH_TIME)
    assert seconds is not None
    return seconds


def _positive(option: str, text: str | None, unit: Unit) -> float | None:
    if text is None:
        return None
    try:
        value = to_si(text, unit)
    except InputError as error:
        raise InputError(f"{option}: {error}") from error
    if value <= 0:
        raise InputError(f"{option} {text}: must be above 0")
    return value


def plan(
    path: Path,
    overrides: tuple[str, ...],
    tolerance: Tolerance,
    out: Path,
    search_time: float,
    again: bool,
    run: bool,
) -> None:
    """Run `calibrate plan`; exits with status 3 if nothing is within the tolerance."""
    console = open_console()
    scene = load_config(path, overrides)
    with results_folder(out) as folder:
        if (folder / _SCENE).exists() and (folder / _SCENE).samefile(path):
            raise InputError(f"--out {out}: would replace {path}: name another folder")
        key = _key(scene, tolerance)
        record = None if again else _earlier_plan(folder, key)
        if record is None:
            record = _search(
                console,
                scene=scene,
                tolerance=tolerance,
                key=key,
                folder=folder,
                path=path,
                search_time=search_time,
                again=again,
            )
        else:
            print_line(console, f"as planned before, in {folder}; --again plans anew")
    for line in record["words"]:
        print_line(console, line)
    if record["chosen"] is None:
        sys.stderr.write(f"calibrate: {record['miss']}\n")
        sys.exit(_NOTHING_MEETS_IT)
    print_line(console, f"jaxthermo simulate {folder / _SCENE}")
    if run:
        run_jaxthermo(["simulate", str(folder / _SCENE), "--out", str(folder / "run")])


def _key(scene: SceneConfig, tolerance: Tolerance) -> str:
    # Times are those of one processor.
    inputs = [config_hash(scene), list(tolerance), program_hash(True), processor()]
    return text_hash(json.dumps(inputs))


class _ReferenceRecord(TypedDict):
    """The reference of a plan, in `plan.json`."""

    refinement: float
    own_error: ReferenceErrors
    error_percent: float | None
    """Error that it is taken to have [%]."""
    error_kelvin: float
    """Error that it is taken to have [K]."""
    excess: float
    """That error over the tolerance [-]."""
    cost: RunCost


class _PlanRecord(TypedDict):
    """`plan.json` without its signature."""

    key: str
    """Hash of what the plan depends on."""
    config: Mapping[str, object]
    """The scene as plain values."""
    tolerance: Mapping[str, float | None]
    words: list[str]
    """The plan in sentences."""
    chosen: Row | None
    miss: str | None
    """Reason why no candidate is chosen."""
    is_complete: bool
    """False if the search was ended by its time: the same command goes on."""
    run_time_s: Mapping[str, float] | None
    """Median and range of the chosen candidate's time."""
    reference: _ReferenceRecord
    trials: list[Row]
    wall_s: float
    cpu_s: float
    provenance: Mapping[str, object]


def _earlier_plan(folder: Path, key: str) -> _PlanRecord | None:
    """An earlier plan of the same scene, tolerance, program and processor."""
    try:
        content = read_record(
            folder / _PLAN, format_name=_KIND, version=_VERSION, remedy="plan again"
        )
    except InputError:  # missing or damaged
        return None
    record = cast(_PlanRecord, content)
    complete = record["chosen"] is None or (folder / _SCENE).is_file()
    if record["key"] != key or not record["is_complete"]:
        return None
    return record if complete else None


def _search(
    console: Console,
    scene: SceneConfig,
    tolerance: Tolerance,
    key: str,
    folder: Path,
    path: Path,
    search_time: float,
    again: bool,
) -> _PlanRecord:
    clock = time.perf_counter()
    cpu = time.process_time()
    pitches = pitches_of(scene)
    rows = Rows(folder / _ROWS, program_hash(True))
    if again:
        rows.by_id.clear()
    try:
        with terminal_progress(console) as progress, warnings.catch_warnings():
            # Coarse candidates warn of their voxels; the planned run has its own.
            warnings.simplefilter("ignore")
            choice = search(
                scene,
                tolerance=tolerance,
                rows=rows,
                search_time=search_time,
                progress=progress,
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped: {count(len(rows.by_id), 'candidate')} are in {rows.path}, and "
            "the same command goes on from there and from the references that are "
            "finished"
        ) from None
    finally:
        rows.close()
    wall_s = time.perf_counter() - clock
    cpu_s = time.process_time() - cpu
    if choice.trials:
        console.print(_table(choice, pitches).rich())
    words = _words(choice, pitches)
    best = choice.best
    record: _PlanRecord = {
        "key": key,
        "config": resolved(scene),
        "tolerance": tolerance._asdict(),
        "words": words,
        "chosen": None if best is None else best.as_json(),
        "miss": None if best else _miss(choice, tolerance, pitches),
        "is_complete": choice.is_complete,
        "run_time_s": None if choice.time is None else choice.time._asdict(),
        "reference": {
            "refinement": choice.reference.refinement,
            "own_error": choice.reference.own_error,
            "error_percent": finite_number(choice.reference.percent),
            "error_kelvin": choice.reference.kelvin,
            "excess": choice.reference.excess,
            "cost": choice.reference.cost,
        },
        "trials": [trial.as_json() for trial in choice.trials],
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "provenance": provenance(config_hash(scene)),
    }
    if best is not None:
        config = best.measured.candidate.applied(scene, pitches)
        head = [f"Made by `calibrate plan {path.name}`, tolerance {tolerance.words()}."]
        with replacing(folder / _SCENE) as temporary:
            text = _comment([*head, *words]) + to_yaml(config)
            temporary.write_text(text, encoding="utf-8")
    else:
        # An earlier plan's scene would pass for one of this tolerance.
        (folder / _SCENE).unlink(missing_ok=True)
    write_json(folder / _PLAN, signed(_KIND, _VERSION, dict(record)))
    return record


def _words(choice: Choice, pitches: tuple[float, ...]) -> list[str]:
    """Sentences on the chosen model and on the reference that it was compared with."""
    finest = choice.reference
    cost = finest.cost
    cells = "cells" if cost.get("structure") == "sheet" else "blocks of 2^3 voxels"
    reference = (
        f"The reference has {cost['nodes']:,} nodes in {cells} of "
        f"{_millimetres(cost['pitch_m'])}, and is itself off by about "
        f"{finest.percent:.2g} % ({finest.kelvin:.2g} K), which counts: the "
        f"difference from it may be {max(0.0, finest.allowed):.2g} of the tolerance."
    )
    if finest.excess > MAX_OWN_ERROR:
        reference += " Finer ones would take too long."
    if not choice.is_complete:
        reference += " The search was ended by its time; the same command goes on."
    if choice.best is None or choice.time is None:
        return [reference]
    measured = choice.best.measured
    model = _sentence(measured.candidate.words(pitches))
    best_words = (
        f"{model}: {choice.best.error_words()} in {choice.time.text()} on "
        f"{processor()}; {measured.nodes:,} nodes, {choice.best.memory_words()}."
    )
    rivals = [t for t in choice.trials if t is not choice.best and t.is_within]
    next_best = min(rivals, key=lambda t: t.measured.run_time, default=None)
    compared = f"{len(choice.trials)} candidates were run"
    if next_best is not None:
        compared += (
            f"; the next within the tolerance took {next_best.time_words()} "
            f"({next_best.measured.candidate.words(pitches)})"
        )
    return [best_words, reference, f"{compared}."]


def _miss(choice: Choice, tolerance: Tolerance, pitches: tuple[float, ...]) -> str:
    near = choice.nearest
    own_excess = choice.reference.excess
    if near is None:
        reached = "no candidate was run in the time of the search"
        if own_excess >= 1:
            reached = (
                f"the finest reference is itself off by {choice.reference.percent:.2g} "
                f"% ({choice.reference.kelvin:.2g} K), {own_excess:.3g} times that"
            )
    else:
        reached = (
            f"the nearest, {near.measured.candidate.words(pitches)}, has "
            f"{near.error_words()} in {near.time_words()} and {near.memory_words()}, "
            f"{near.measured.error + own_excess:.3g} times the tolerance with the "
            "error of the reference"
        )
    remedy = "allow more, or give a finer mesh"
    if not choice.is_complete:
        remedy = "give a longer --search-time, with which the same command goes on"
    return f"no model is within {tolerance.words()}: {reached}: {remedy}"


def _table(choice: Choice, pitches: tuple[float, ...]) -> Table:
    ordered = sorted(choice.trials, key=lambda trial: trial.measured.run_time)
    rows = [
        [
            trial.measured.candidate.words(pitches),
            Cell(f"{trial.percent:.3g} %", trial.is_within, is_number=True),
            f"{trial.kelvin:.3g} K",
            trial.time_words(),
            f"{trial.measured.nodes:,}",
            trial.memory_words(),
        ]
        for trial in ordered[:_LISTED]
    ]
    columns = ("model", "error", "", "time", "nodes", "memory")
    return Table(columns, rows, title="candidates, the fastest first")


def _millimetres(pitches: list[float]) -> str:
    return ", ".join(f"{1e3 * pitch:.3g} mm" for pitch in dict.fromkeys(pitches))


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _comment(lines: list[str]) -> str:
    wrapped = (line for text in lines for line in textwrap.wrap(text, _WIDTH))
    return "".join(f"# {line}\n" for line in wrapped)
