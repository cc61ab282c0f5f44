"""Rivals of a sweep: full volumes by solvers written by hand, at many pitches.

For an error e a rival is run with the coarsest voxels and the fewest steps whose error
against the same reference, at the same points, is just not larger than e. Rows of
rivals are in the sweep's folder, which is read here too.
"""

import importlib
import statistics
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from calibrate.problem.reference import on_every_voxel
from calibrate.study.case import Case, build_case
from calibrate.study.evaluate import find_truth
from calibrate.study.front import Point, errors_of
from calibrate.study.rows import Row, append_rows, read_rows
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.extras import missing_package
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.provenance import processor
from jaxthermo.timing import timed_call

from ..harness.record import fingerprint, program_hash
from .linear_body import LinearBody, Run, linear_body
from .scipy_run import scipy_run


_Cells = Literal["crossings", "dominant_axis"]
_Threads = Literal["one", "all"]

_RKL2 = "numba RKL2"
_EXPLICIT = "numba explicit"
_SCIPY = "scipy TR-BDF2"

_HEIGHTS = (16, 20, 25, 32, 40, 50, 64, 80, 100, 125, 160, 200, 250, 320, 400, 500)
"""Numbers of voxels along z to try: each pitch is 1.25 times the next."""
_BETWEEN = 3
"""Number of divisions of the step to the first height within a tolerance."""
_COUNTS = (6, 8, 12, 18, 24, 36, 54, 72)
"""Numbers of steps to try with RKL2."""
_SCIPY_COUNTS = (9, 18, 36)
_ENOUGH = 0.01
"""Relative change of the error below which more steps are useless [-]."""
_REPEATS = 3
"""Number of timed runs."""
_LONG_S = 5.0
"""Time of a run above which it is timed once [s]."""
_MAX_S = 2.0
"""Time of a run above which no finer voxels are tried [s]."""
_COST_ORDER = 4
"""Power of the number of voxels along z with which a run time grows, at least."""

_SOURCES = tuple(
    Path(__file__).with_name(f"{name}.py")
    for name in ("linear_body", "numba_loops", "scipy_run")
)
"""Source files of the rivals."""


class _Setting(NamedTuple):
    """A rival with its voxels and steps."""

    solver: str
    voxels_high: int
    steps: int | None = None
    """Number of steps of the whole run; None for the stable ones."""
    cells: _Cells = "crossings"

    @property
    def name(self) -> str:
        """Name in the legend of the charts."""
        if self.cells == "crossings":
            return self.solver
        return f"{self.solver} on dominant-axis voxels"

    @property
    def choice(self) -> dict[str, str]:
        """Labels in the form of a sweep's choice."""
        steps = "stable steps" if self.steps is None else f"{self.steps} steps"
        return {"voxels": f"{self.voxels_high} high", "steps": steps}


TWELVE_STEPS = _Setting(solver=_RKL2, voxels_high=250, steps=12, cells="dominant_axis")

_Log = Callable[[str], None]


def _spans(run: Run) -> list[float]:
    """Wall times of a run, after one that compiles [s]."""
    first = timed_call(run.call)[1]
    repeats = _REPEATS if first < _LONG_S else 1
    return [timed_call(run.call)[1] for _ in range(repeats)]


class Rivals:
    """Rivals under all loads; rows in the file are not measured again."""

    def __init__(self, cases: Mapping[str, Case], path: Path, log: _Log):
        """Nothing is run yet.

        Args:
            cases: one of any choice under each load.
            path: file of the rows.
            log: called before each height.

        Raises:
            InputError: if numba is not installed.
        """
        self._cases = cases
        self._path = path
        self._log = log
        self._known = {row["id"]: row for row in read_rows(path) if "id" in row}
        self._rows: dict[tuple[_Setting, str], Row] = {}
        # Settings of one height are run under all loads, one after the other.
        self._body = lru_cache(maxsize=len(cases))(self._body_of)
        self._layout = cache(self._fastest_layout)
        try:
            self._numba = importlib.import_module("experiments.front.numba_loops")
        except ModuleNotFoundError as error:
            raise missing_package(
                "rivals need", package=str(error.name), extra="test"
            ) from error

    @property
    def rows(self) -> list[Row]:
        """Rows of all rivals that were run, or read from the file."""
        return list(self._rows.values())

    @property
    def tried(self) -> str:
        """Range of the tried voxels, in words."""
        heights = [setting.voxels_high for setting, _ in self._rows]
        if not heights:
            return "none: the reference is too coarse"
        return f"{min(heights)} to {max(heights)} voxels high"

    @property
    def heights(self) -> tuple[int, ...]:
        """Numbers of voxels along z to try: at most half that of the reference.

        Where the choices have the reference's own voxels, the rivals have them too.
        """
        case = next(iter(self._cases.values()))
        finest = case.truth.voxels_high
        if finest is None:
            mesh = case.config.bodies[0].build_mesh()
            height = float(np.ptp(mesh.bounds[:, 2]))
            finest = round(height / float(case.truth.pitch or 1))
        if case.shares_voxels and case.truth.structure.kind == "full_volume":
            return (finest,)
        return tuple(high for high in _HEIGHTS if high <= finest // 2)

    def search(self, needed: float, tolerances: Sequence[float]) -> None:
        """Measure ever finer voxels down to an error `needed` [%], or all of them.

        Between the last height above each of the tolerances [%] and the first within,
        more heights are measured.
        """
        errors: dict[int, float] = {}
        for high in self.heights:
            solvers = (_RKL2, _EXPLICIT, _SCIPY)
            fast = [name for name in solvers if self._is_fast(name, high)]
            if _RKL2 not in fast:
                break
            errors[high] = self._measure_height(high, fast)
            if errors[high] <= needed:
                break
        for tolerance in tolerances:
            heights = [high for high in errors if errors[high] <= tolerance]
            coarser = [high for high in errors if heights and high < heights[0]]
            if not coarser:
                continue
            ratio = heights[0] / coarser[-1]
            for step in range(1, _BETWEEN):
                high = round(coarser[-1] * ratio ** (step / _BETWEEN))
                if self._measure_height(high, (_RKL2,)) <= tolerance:
                    break
        if TWELVE_STEPS.voxels_high in self.heights and len(self.heights) > 1:
            self._error(TWELVE_STEPS)

    def _measure_height(self, high: int, solvers: Collection[str]) -> float:
        """Measure rivals in voxels of one size; return RKL2's smallest error [%]."""
        self._log(f"rivals: full volumes {high} voxels high")
        smallest = min(self._useful_errors(high))
        if _EXPLICIT in solvers:
            self._error(_Setting(_EXPLICIT, high))
        if _SCIPY in solvers:
            for count in _SCIPY_COUNTS:
                self._error(_Setting(_SCIPY, voxels_high=high, steps=count))
        return smallest

    def _is_fast(self, solver: str, high: int) -> bool:
        """False if coarser voxels have shown that a kind of rival takes too long."""
        times = [
            (setting.voxels_high, min(row["loop_s"]))
            for (setting, _), row in self._rows.items()
            if setting.name == solver
        ]
        if not times:
            return True
        # From the finest voxels so far: in coarse ones the time is that of calls.
        last = max(voxels_high for voxels_high, _ in times)
        fastest = min(seconds for voxels_high, seconds in times if voxels_high == last)
        return fastest * (high / last) ** _COST_ORDER < _MAX_S

    def _useful_errors(self, high: int) -> list[float]:
        """Errors of RKL2 up to the number of steps that hardly changes them [%]."""
        errors: list[float] = []
        alike = 0
        for count in _COUNTS:
            error = self._error(_Setting(_RKL2, voxels_high=high, steps=count))
            last = errors[-1] if errors else np.inf
            errors.append(error)
            # Two counts may have equally many steps in the decisive interval.
            alike = alike + 1 if abs(last - error) < _ENOUGH * error else 0
            if alike == 2:
                break
        return errors

    def _error(self, setting: _Setting) -> float:
        """Largest error of a rival under all loads [%]."""
        rows = [self._row(setting, load) for load in self._cases]
        return max(errors_of(row["error"])["rms_percent"] for row in rows)

    def _row(self, setting: _Setting, load: str) -> Row:
        if (setting, load) not in self._rows:
            case = self._case(load, high=setting.voxels_high, cells=setting.cells)
            key = fingerprint([case.id, *setting, program_hash(_SOURCES)])
            row = self._known.get(key)
            if row is None:
                row = {"id": key, **self._measured(setting, load=load, case=case)}
                append_rows(self._path, [row])
            self._rows[setting, load] = row
        return self._rows[setting, load]

    def _measured(self, setting: _Setting, load: str, case: Case) -> Row:
        body = self._body(load, setting.voxels_high, setting.cells)
        timed, run = self._timed(setting, load)
        truth = find_truth(case, self._log)
        solution = StoredSolution(
            np.asarray(body.save_times),
            surface_temperature=run.call(),
            surfaces=body.surfaces,
        )
        return {
            "name": setting.name,
            "load": load,
            "choice": setting.choice,
            "error": truth.points.error(solution).as_dict(),
            "own_error": truth.own_error,
            **timed,
            "nodes": len(body.cells),
            "steps": run.steps,
            "memory_bytes": run.memory_bytes,
            "processor": processor(),
        }

    def _timed(self, setting: _Setting, load: str) -> tuple[Row, Run]:
        """Times under the first load; others with equally many steps take as long."""
        first = next(iter(self._cases))
        # Numbers of linear iterations differ.
        if load != first and setting.solver != _SCIPY:
            same = self._row(setting, first)
            run = self._made(setting, load=load, threads=same["threads"])
            if run.steps == same["steps"]:
                shared = {name: same[name] for name in ("loop_s", "threads")}
                return {**shared, "timed_as": same["id"]}, run
        threads: tuple[_Threads, ...] = ("one", "all")
        tried = [
            (count, self._made(setting, load=load, threads=count))
            for count in (("one",) if setting.solver == _SCIPY else threads)
        ]
        # Threads share the work, or wait for each other: the faster form counts.
        times = [_spans(run) for _, run in tried]
        best = int(np.argmin([statistics.median(spans) for spans in times]))
        (used, run) = tried[best]
        spans = times[best]
        return {"loop_s": spans, "threads": used}, run

    def run(self, rival: Point, load: str) -> Run:
        """A measured rival that is ready to run under a load, in its fastest form."""
        setting = next(
            setting
            for setting, _ in self._rows
            if (setting.name, setting.choice) == (rival.kind, rival.choice)
        )
        threads = self._row(setting, load)["threads"]
        return self._made(setting, load=load, threads=threads)

    def _made(self, setting: _Setting, load: str, threads: _Threads) -> Run:
        body = self._body(load, setting.voxels_high, setting.cells)
        span = body.save_times[-1]
        if setting.solver == _SCIPY:
            return scipy_run(body, span / (setting.steps or 1))
        body = body.with_layout(self._layout(setting.voxels_high, setting.cells))
        if setting.steps is None:
            return self._numba.explicit_run(body, threads)
        dt = span / setting.steps
        return self._numba.rkl2_run(body, dt=dt, threads=threads)

    def _case(self, load: str, high: int, cells: _Cells) -> Case:
        case = self._cases[load]
        config = _full_volume(case.config, high=high, cells=cells)
        return Case(config=config, names=(), load=load, truth=case.truth)

    def _body_of(self, load: str, high: int, cells: _Cells) -> LinearBody:
        config = self._case(load, high=high, cells=cells).config
        span = config.time
        scene = build_case(config).scene
        return linear_body(scene, end=span.end, save_at=span.save_times)

    def _fastest_layout(self, high: int, cells: _Cells) -> str:
        """Layout of the state with which RKL2 is faster, in one thread."""
        body = self._body(next(iter(self._cases)), high, cells)
        dt = body.save_times[-1] / _COUNTS[0]
        seconds = {}
        for layout in ("compact", "dense"):
            run = self._numba.rkl2_run(body.with_layout(layout), dt=dt, threads="one")
            seconds[layout] = statistics.median(_spans(run))
        return min(seconds, key=lambda layout: seconds[layout])


def _full_volume(config: SceneConfig, high: int, cells: _Cells) -> SceneConfig:
    """Config with the full volume of `high` voxels along z, read at the surface."""
    if len(config.bodies) != 1:
        raise InputError("rivals written by hand have one body: this scene has more")
    full_volume = on_every_voxel(config)
    body: Any = full_volume.bodies[0]
    changes = {"voxels_high": high, "pitch": None, "surface_cells": cells}
    changes["surface_map"] = type(body).model_fields["surface_map"].default
    bodies = (body.model_copy(update=changes),)
    return full_volume.model_copy(update={"bodies": bodies})


class SweepFolder(NamedTuple):
    """Rows of a sweep, and those of rivals that other commands have added."""

    path: Path
    rows: list[Row]
    """One per finished case, without failed ones."""
    failed: list[Row]
    times: list[Row]
    rivals: list[Row]


def read_folder(path: Path) -> SweepFolder:
    """Read the folder of a sweep.

    Raises:
        InputError: if it has no rows, or a file cannot be read.
    """
    rows = read_rows(path / "rows.jsonl")
    if not rows:
        raise InputError(
            f"{path}: holds no rows of a sweep: name the folder of an "
            "`experiments sweep`, or the config of one"
        )
    finished = [row for row in rows if "failed" not in row]
    failed = [row for row in rows if "failed" in row]
    return SweepFolder(
        path=path,
        rows=finished,
        failed=failed,
        times=read_rows(path / "times.jsonl"),
        rivals=read_rows(path / "rivals.jsonl"),
    )
