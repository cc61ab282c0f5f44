"""Work to a given error in time: every solver against the explicit loop, in one run.

The standard scene in steel and in copper, on the full volume and on the octree. The
error is of time alone: against a run of the same structure at a quarter of its stable
step, as `surface_error` has it. Every solver is tried from coarse to fine until it is
within the error that is asked; that run is timed, in turn with the explicit loop.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import jaxthermo as jt
from jaxthermo.integrate.explicit.rkl2 import stage_count
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.run.simulate import integrate, run_plan
from jaxthermo.integrate.run.solution import RESULTS
from jaxthermo.timing import Timing

from .standard import COPPER, END, SAVE_AT, STEEL, standard_scene


ERROR = 0.1
"""Asked [%]."""

MATERIALS = {"steel": STEEL, "copper": COPPER}
STRUCTURES: dict[str, Callable[..., Any]] = {
    "full volume": jt.FullVolume,
    "octree": jt.Octree,
}
COUNTS = (18, 24, 36, 48, 72, 108, 144, 216)
"""Steps of a run that are tried."""

TOLERANCES = (0.3, 0.1, 0.03, 0.01)
"""Of adaptive steps [K]."""


class Found(NamedTuple):
    """The cheapest run of a solver that is within the error."""

    how: str
    todo: Plan
    error: float
    evaluations: int


def _tries() -> dict[str, Iterator[tuple[str, Any]]]:
    """Solvers, each from coarse to fine."""
    fixed = lambda kind: ((f"{n} steps", kind(dt=END / n)) for n in COUNTS)
    adaptive = ((f"{e:g} K a step", jt.TRBDF2(error=e)) for e in TOLERANCES)
    return {
        "super time stepping": fixed(jt.SuperTimeStepping),
        "TRBDF2": fixed(jt.TRBDF2),
        "TRBDF2, adaptive": adaptive,
    }


def _evaluations(todo: Plan, solution: jt.Solution) -> int:
    """Of all conductances of the body: stages, or iterations of linear solves."""
    effort = solution.run.statistics
    if effort is not None:
        return int(effort.linear_iterations) + 2 * int(effort.newton_iterations)
    stable = float(todo.compiled.stable_step)
    each = lambda i: stage_count(i.dt, stable) if i.dt > stable * 1.000001 else 1
    return sum(i.steps * each(i) for i in todo.intervals)


def _cheapest(scene: jt.Scene, tries, reference: jt.Solution) -> Found | None:
    for how, solver in tries:
        todo = plan_run(scene, END, SAVE_AT, solver)
        found = run_plan(todo)
        error = float(jt.surface_error(found, reference).worst_rms_percent)
        if found.result == RESULTS.successful and error <= ERROR:
            return Found(how, todo, error, _evaluations(todo, found))
    return None


def _timed(runs: dict[str, Plan], repeats: int) -> dict[str, list[float]]:
    """Wall times of each, in turn, after one that compiles; scene set-up apart."""
    call = lambda todo: jax.block_until_ready(integrate(todo, initial_state(todo)))
    spans: dict[str, list[float]] = {name: [] for name in runs}
    for todo in runs.values():
        call(todo)
    for _ in range(repeats):
        for name, todo in runs.items():
            clock = time.perf_counter()
            call(todo)
            spans[name].append(time.perf_counter() - clock)
    return spans


def _measure(scene: jt.Scene, repeats: int) -> dict[str, Any]:
    explicit = plan_run(scene, END, SAVE_AT, jt.ForwardEuler())
    stable = float(explicit.compiled.stable_step)
    reference = jt.simulate(scene, END, SAVE_AT, solver=jt.ForwardEuler(dt=stable / 4))
    euler = run_plan(explicit)
    found = {
        name: _cheapest(scene, tries, reference) for name, tries in _tries().items()
    }
    runs = {"explicit": explicit}
    runs |= {name: each.todo for name, each in found.items() if each is not None}
    spans = _timed(runs, repeats)
    rows = {
        "explicit": {
            "how": f"{explicit.steps} steps",
            "error_percent": float(
                jt.surface_error(euler, reference).worst_rms_percent
            ),
            "evaluations": explicit.steps,
            "times_s": spans["explicit"],
        }
    }
    for name, each in found.items():
        if each is None:
            rows[name] = {"how": "not within the error"}
            continue
        ratio = np.array(spans["explicit"]) / np.array(spans[name])
        rows[name] = {
            "how": each.how,
            "error_percent": each.error,
            "evaluations": each.evaluations,
            "times_s": spans[name],
            "faster": [float(np.median(ratio)), float(ratio.min()), float(ratio.max())],
        }
    return {"stable_step_s": stable, "solvers": rows}


def run(folder: Path, height: int = 250, repeats: int = 3) -> dict[str, Any]:
    """Times, evaluations and errors of every solver for every material and structure.

    Args:
        folder: for files, of which there are none.
        height: voxels along up.
        repeats: of each measurement.
    """
    del folder
    result: dict[str, Any] = {"height": height, "error_percent": ERROR, "runs": {}}
    for made, material in MATERIALS.items():
        for kind, structure in STRUCTURES.items():
            scene, result["mesh"] = standard_scene(material, structure, height)
            found = _measure(scene, repeats)
            result["runs"][f"{made}, {kind}"] = found
            _show(f"{made}, {kind}, {height} high", found)
    return result


def _show(title: str, found: dict[str, Any]) -> None:
    table = Table(title=f"{title}: error in time at most {ERROR:g} %")
    for column in ("", "steps", "error %", "evaluations", "run", "times faster"):
        table.add_column(column, justify="left" if not column else "right")
    for name, row in found["solvers"].items():
        if "times_s" not in row:
            table.add_row(name, row["how"], "", "", "", "")
            continue
        spans = row["times_s"]
        text = Timing(float(np.median(spans)), min(spans), max(spans)).text()
        faster = "{:.2f} ({:.2f}-{:.2f})".format(*row.get("faster", (1, 1, 1)))
        table.add_row(
            name, row["how"], f"{row['error_percent']:.3f}",
            str(row["evaluations"]), text, faster,
        )  # fmt: skip
    Console().print(table)
