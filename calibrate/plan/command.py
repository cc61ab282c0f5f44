"""`calibrate plan`: a scene's cheapest model within a tolerance, as a scene file."""

import json
import sys
import textwrap
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict, cast

from rich.console import Console

from jaxthermo.__main__ import main as run_jaxthermo
from jaxthermo.accuracy.error_records import ReferenceErrors
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
from jaxthermo.report.table import Cell, Table

from ..problem.reference import RunCost, program_hash
from .candidate import pitches_of
from .search import Choice, search
from .trial import Tolerance, TrialRecord


_SCENE = "scene.yaml"
_PLAN = "plan.json"
_NOTHING_MEETS_IT = 3
"""Exit status where no candidate is within the tolerance."""

_KIND = "plan"
_VERSION = 1
_TIME = Unit("s", "a time", "10 ms")
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
    chosen: TrialRecord | None
    miss: str | None
    """Reason why no candidate is chosen."""
    run_time_s: Mapping[str, float] | None
    """Median and range of the chosen candidate's time."""
    reference: _ReferenceRecord
    trials: list[TrialRecord]
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
    return record if record["key"] == key and complete else None


def _search(
    console: Console,
    scene: SceneConfig,
    tolerance: Tolerance,
    key: str,
    folder: Path,
    path: Path,
) -> _PlanRecord:
    clock = time.perf_counter()
    cpu = time.process_time()
    pitches = pitches_of(scene)
    try:
        with terminal_progress(console) as progress, warnings.catch_warnings():
            # Coarse candidates warn of their voxels; the planned run has its own.
            warnings.simplefilter("ignore")
            choice = search(scene, tolerance=tolerance, progress=progress)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "stopped; the same command goes on from the references that are finished"
        ) from None
    wall_s = time.perf_counter() - clock
    cpu_s = time.process_time() - cpu
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
        "run_time_s": None if choice.time is None else choice.time._asdict(),
        "reference": {
            "refinement": choice.reference.refinement,
            "own_error": choice.reference.own_error,
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
    own_kelvin = finest.own_error["worst_rms_kelvin"]
    reference = (
        f"The reference has {cost['nodes']:,} nodes in blocks of 2^3 voxels of "
        f"{_millimetres(cost['pitch_m'])}, and is itself off by about "
        f"{finest.own_percent:.2g} % ({own_kelvin:.2g} K)."
    )
    if finest.excess > 0.5:
        reference += (
            " That is a large part of the tolerance: finer ones were too large."
        )
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
    return (
        f"no model is within {tolerance.words()}: the nearest, "
        f"{near.measured.candidate.words(pitches)}, has {near.error_words()} in "
        f"{near.time_words()} and {near.memory_words()}, "
        f"{near.measured.error / near.allowed:.3g} times the tolerance with the error "
        "of the reference: allow more, or give a finer mesh"
    )


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
