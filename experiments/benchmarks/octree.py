"""The octree compared with the full volume of its voxels, at the octree's own error.

Its error against the full volume, both in steps so short that they do not count, is
that of the octree itself. Each of the two then takes the fewest steps of RKL2 with
which its error against the same full volume is at most that and a twentieth more; these
loops are timed in turn.
"""

import bisect
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.integrate.explicit import RKL2Stepper
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.report.numbers import with_range
from jaxthermo.timing import Spread, interleaved, ratio_of
from jaxthermo.voxels.grid import VoxelGrid

from ..harness.agreement import require_within
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, HEIGHT, SAVE_AT, standard_scene, thesis_meshes
from ..harness.present import show, table_of
from .loops import loop_of


QUICK = {"height": 48, "repeats": 2}

_COUNTS = (*range(4, 12), *range(12, 36, 2), *range(36, 73, 4))
"""Steps of a run, at least: every saved time is the end of one."""
_CONVERGED = 144
_MARGIN = 1.05
"""Error that the steps may bring it to, over the octree's own."""
_BOUND = 1.3
"""Speed relative to the full volume below which an octree is not worth it."""


class _Choice(NamedTuple):
    plan: Plan
    error: float
    """Against the full volume in short steps [%]."""


class _Description(TypedDict):
    """The steps that a structure takes, and its error [%]."""

    nodes: int
    steps: int
    stages: int
    error: float


class _Compared(TypedDict):
    """Both structures at one error, their times and the ratio of these."""

    own_error: float
    octree: _Description
    full: _Description
    times_s: dict[str, list[float]]
    ratio: Spread


class _Row(_Compared):
    mesh: str


class _Result(MeasuredResult):
    height: int
    rows: list[_Row]


def run(folder: Path, height: int = 250, repeats: int = 7) -> _Result:
    """Times at one error of a statue, and of the figurine if that is another one."""
    meshes = dict([next(iter(thesis_meshes().items()))])
    meshes.setdefault("figurine", figurine(HEIGHT))
    rows: list[_Row] = []
    for name, mesh in meshes.items():
        grid = jt.voxelize(mesh, HEIGHT / height)
        rows.append({"mesh": name, **_compared(grid, repeats)})
    text = "{nodes:,} nodes, {steps} x {stages} stages, {error:.2g} %"

    def described_in(key: str) -> Callable[[dict], str]:
        return lambda row: text.format_map(row[key])

    columns = [
        ("", "{mesh}"),
        ("its own error", "{own_error:.2g} %"),
        ("octree", described_in("octree")),
        ("full volume", described_in("full")),
        ("times as fast", lambda row: with_range(*row["ratio"])),
    ]
    show(table_of(rows, columns, f"{height} high, {END:g} s, this host"))
    measured = [measurement for row in rows for measurement in _measurements(row)]
    return {"height": height, "rows": rows, "measurements": plain_rows(measured)}


def _plan(scene: jt.Scene, steps: int) -> Plan:
    solver = jt.SuperTimeStepping(dt=END / steps)
    return plan_run(scene, t1=END, save_at=SAVE_AT, solver=solver)


def _compared(grid: VoxelGrid, repeats: int) -> _Compared:
    scenes = {
        "octree": standard_scene(jt.Octree(grid)),
        "full": standard_scene(jt.FullVolume(grid)),
    }
    truth = run_plan(_plan(scenes["full"], _CONVERGED))

    def error(plan: Plan) -> float:
        return float(jt.surface_error(run_plan(plan), truth).worst_rms_percent)

    converged_error = error(_plan(scenes["octree"], _CONVERGED))
    choices = {}
    for name, scene in scenes.items():

        def is_accurate(steps: int, scene: jt.Scene = scene) -> bool:
            return error(_plan(scene, steps)) <= _MARGIN * converged_error

        # The error falls with the number of steps: the first that is enough.
        index = bisect.bisect_left(_COUNTS, True, key=is_accurate)
        plan = _plan(scene, (*_COUNTS, _CONVERGED)[index])
        choice_error = require_within(
            f"error of the {name} structure",
            error(plan),
            tolerance=_MARGIN * converged_error,
            unit="%",
        )
        choices[name] = _Choice(plan, choice_error)
    calls = {name: loop_of(choice.plan) for name, choice in choices.items()}
    spans = interleaved(calls, repeats)
    return {
        "own_error": converged_error,
        "octree": _described(choices["octree"]),
        "full": _described(choices["full"]),
        "times_s": spans,
        "ratio": ratio_of(spans["full"], spans["octree"]),
    }


def _described(choice: _Choice) -> _Description:
    plan = choice.plan
    assert isinstance(plan.stepper, RKL2Stepper)
    return {
        "nodes": plan.compiled.receipt.nodes,
        "steps": plan.steps,
        "stages": plan.stepper.stages_taken,
        "error": choice.error,
    }


def _measurements(row: _Row) -> list[Measurement]:
    octree = row["octree"]
    full = row["full"]
    spans = row["times_s"]
    slow = float(np.median(row["ratio"])) < _BOUND
    verdict = "; no reason to use it in place of the full volume" if slow else ""
    peer = f"full volume, {full['steps']} x {full['stages']} stages"
    return compared(
        name=f"{row['mesh']}: octree at an error of {row['own_error']:.2g} %",
        ours=spans["octree"],
        peers={peer: spans["full"]},
        bound=_BOUND,
        note=f"{octree['nodes']:,} nodes of {full['nodes']:,}, {octree['steps']} x "
        f"{octree['stages']} stages{verdict}",
    )
