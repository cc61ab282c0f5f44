"""Work to a given error in time: every solver against the explicit loop, in one run.

The standard scene in steel and in copper, on the full volume and on the octree. The
error is of time alone: against a run of the same structure at a quarter of its stable
step, as `surface_error` has it. Every solver is tried from coarse to fine until it is
within the error that is asked; that run is timed, in turn with the explicit loop.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jaxthermo as jt
from jaxthermo.integrate.explicit import stage_count
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.run.simulate import integrate, run_plan

from ..harness.meshes import COPPER, END, SAVE_AT, STEEL, standard_scene
from ..harness.present import named, show, table_of
from ..harness.timing import interleaved, ratio_of, ratio_text, timing_of


# Asked [%].
_ERROR = 0.1

# In copper the explicit step is 29 times as short for the same voxels.
_MATERIALS = {"steel": STEEL, "copper": COPPER}
_STRUCTURES: dict[str, Callable[..., Any]] = {
    "full volume": jt.FullVolume,
    "octree": jt.Octree,
}
# Steps of a run that are tried, and errors per adaptive step [K].
_COUNTS = (18, 24, 36, 48, 72, 108, 144, 216)
_TOLERANCES = (0.3, 0.1, 0.03, 0.01)


class _Found(NamedTuple):
    # The cheapest run of a solver that is within the error.
    how: str
    todo: Plan
    error: float
    evaluations: int


def _tries() -> dict[str, Iterator[tuple[str, Any]]]:
    # From coarse to fine, so that the first within the error is the cheapest.
    fixed = lambda kind: ((f"{n} steps", kind(dt=END / n)) for n in _COUNTS)
    adaptive = ((f"{e:g} K a step", jt.TRBDF2(error=e)) for e in _TOLERANCES)
    return {
        "super time stepping": fixed(jt.SuperTimeStepping),
        "TRBDF2": fixed(jt.TRBDF2),
        "TRBDF2, adaptive": adaptive,
    }


def _evaluations(todo: Plan, solution: jt.Solution) -> int:
    """Evaluations of all conductances: stages, or iterations of linear solves."""
    effort = solution.run.statistics
    if effort is not None:
        return int(effort.linear_iterations) + 2 * int(effort.newton_iterations)
    stable = float(todo.compiled.stable_step)
    each = lambda i: stage_count(i.dt, stable) if i.dt > stable * 1.000001 else 1
    return sum(i.steps * each(i) for i in todo.intervals)


def _cheapest(scene: jt.Scene, tries, reference: jt.Solution) -> _Found | None:
    for how, solver in tries:
        todo = plan_run(scene, END, SAVE_AT, solver)
        found = run_plan(todo)
        error = float(jt.surface_error(found, reference).worst_rms_percent)
        if found.result == jt.RESULTS.successful and error <= _ERROR:
            return _Found(how, todo, error, _evaluations(todo, found))
    return None


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
    # Only the compiled loop is timed, not the set-up of the scene.
    calls = {
        name: partial(integrate, todo, initial_state(todo))
        for name, todo in runs.items()
    }
    spans = interleaved(calls, repeats)
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
        rows[name] = {
            "how": each.how,
            "error_percent": each.error,
            "evaluations": each.evaluations,
            "times_s": spans[name],
            "faster": ratio_of(spans["explicit"], spans[name]),
        }
    return {"stable_step_s": stable, "solvers": rows}


def run(folder: Path, height: int = 250, repeats: int = 3) -> dict[str, Any]:
    """Times, evaluations and errors of every solver, by material and structure."""
    result: dict[str, Any] = {"height": height, "error_percent": _ERROR, "runs": {}}
    for made, material in _MATERIALS.items():
        for kind, structure in _STRUCTURES.items():
            scene, result["mesh"] = standard_scene(material, structure, height)
            found = _measure(scene, repeats)
            result["runs"][f"{made}, {kind}"] = found
            _show(f"{made}, {kind}, {height} high", found)
    return result


def _show(title: str, found: dict[str, Any]) -> None:
    # A solver that no try brings within the error has no numbers.
    if_run = lambda text: lambda row: text(row) if "times_s" in row else ""
    columns = [
        ("", "{name}"),
        ("steps", "{how}"),
        ("error %", if_run("{error_percent:.3f}".format_map)),
        ("evaluations", if_run("{evaluations}".format_map)),
        ("run", if_run(lambda row: timing_of(row["times_s"]).text())),
        ("times faster", if_run(lambda r: ratio_text(r.get("faster", (1, 1, 1))))),
    ]
    title = f"{title}: error in time at most {_ERROR:g} %"
    show(table_of(named(found["solvers"]), columns, title))
