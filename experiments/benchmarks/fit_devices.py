"""The Jacobian of a step of a fit on two devices, compared with one, by its values.

In turn in a process of its own, which has two devices: where there are no others, they
share the threads of one processor, and a device alone uses all of them where an
operation is large enough. Both must give the same numbers. Times of all threads tell
what is computed twice, where other programs use the processor too.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from calibrate.problem.targets import surface_target
from calibrate.solvers.levenberg_marquardt import jacobian_rows
from calibrate.solvers.search import make_objective, residuals
from jaxthermo.arrays import precision
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.parallel.batch import on_every_device, on_first_device
from jaxthermo.parallel.devices import mesh_of, provide_devices
from jaxthermo.timing import interleaved

from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, standard_scene, statue
from ..harness.processes import in_new_process
from .steps import STRUCTURES


QUICK = {"height": 32, "repeats": 2, "counts": (2,)}
_DEVICES = 2
_MAX_DIFFERENCE = 1e-4
"""Largest difference of results on one and on two devices, over the largest value."""
_BLOCKS = "blocks x4"
_VALUES = {
    "weights.within": 1.0,
    "weights.surface_distance": 1.0,
    "weights.nearest_capacity": 1.0,
    "weights.non_orthogonal": 1.0,
    "material.conductivity": 16.0,
    "material.specific_heat": 500.0,
    "material.density": 8000.0,
    "convection.heat_transfer_coefficient": 10.0,
}
"""Values that are fitted, in the order in which they are added."""


class _Times(TypedDict):
    """Times of every call on one and on two devices."""

    wall_s: dict[str, list[float]]
    processor_s: dict[str, list[float]]


class _Row(_Times):
    name: str
    values: int


class _Result(MeasuredResult):
    devices: int
    rows: list[_Row]


def run(
    folder: Path,
    height: int = 250,
    repeats: int = 15,
    counts: tuple[int, ...] = (2, 4, 8),
) -> _Result:
    """Times on one and on two devices.

    Args:
        folder: of the result.
        height: of the statue, in voxels.
        repeats: of every call.
        counts: numbers of fitted values.
    """
    # Devices are made before the first computation of a process.
    rows = in_new_process(_measure, height, repeats, counts)
    measured = [measurement for row in rows for measurement in _measurements(row)]
    return {"devices": _DEVICES, "rows": rows, "measurements": plain_rows(measured)}


def _measurements(row: _Row) -> list[Measurement]:
    name = row["name"]
    wall = row["wall_s"]
    processor = row["processor_s"]
    peer = "one device"
    return [
        *compared(name, wall["two"], {peer: wall["one"]}),
        *compared(
            name=f"{name}, of all threads",
            ours=processor["two"],
            peers={peer: processor["one"]},
            overhead=True,
        ),
    ]


def _measure(height: int, repeats: int, counts: tuple[int, ...]) -> list[_Row]:
    provide_devices(_DEVICES)
    mesh_name, grid = statue(height)
    scene = standard_scene(STRUCTURES[_BLOCKS](grid))
    label = f"{mesh_name}, {height} high, {_BLOCKS}"
    rows: list[_Row] = []
    for count in counts:
        problem = _problem(scene, count)
        with precision(problem.dtype.name):
            calls = _calls(problem)
            names = {"Jacobian": f"Jacobian of {count} values"}
            if count == counts[0]:
                names["run"] = "run without derivatives"
            for key, name in names.items():
                times = _timed(calls[key], repeats)
                rows.append({"name": f"{label}: {name}", "values": count, **times})
    return rows


def _problem(scene: jt.Scene, count: int) -> Problem:
    """Fit of some values to the run of their start values."""
    case_run = ParametricRun((END / 4, END / 2))
    case_result = case_run(scene, case_run.step_table(scene))
    times = jnp.asarray(case_run.save_times)
    data = StoredSolution(times, case_result.surface_temperature, case_result.surfaces)
    target = surface_target(data, jnp.dtype(scene.dtype))
    fitted = [
        Parameter(name=name, start=(start,), lower=0.01 * start, upper=100 * start)
        for name, start in list(_VALUES.items())[:count]
    ]
    case = Case(name="sun", scene=scene, run=case_run, target=target)
    return Problem(ParameterSet(tuple(fitted)), (case,))


_Calls = dict[str, Callable[[], Any]]


def _calls(problem: Problem) -> dict[str, _Calls]:
    start = problem.start()
    objective_and_start = (
        make_objective(problem, problem.step_tables_at(start)),
        start,
    )
    batch = problem.batch()

    @eqx.filter_jit
    def evaluate(mesh, *arguments):
        return on_first_device(mesh, lambda values: residuals(*values), arguments)

    calls_by_task: dict[str, _Calls] = {"Jacobian": {}, "run": {}}
    for name, mesh in {"one": None, "two": mesh_of(_DEVICES)}.items():
        objective, z = on_every_device(mesh, objective_and_start)
        calls_by_task["Jacobian"][name] = partial(
            jacobian_rows, residuals, objective, z, batch, mesh
        )
        calls_by_task["run"][name] = partial(evaluate, mesh, z, objective)
    return calls_by_task


def _timed(calls: _Calls, repeats: int) -> _Times:
    """Wall times in turn, and those of the processor [s]."""
    results = {
        name: np.concatenate(list(map(np.ravel, jax.tree.leaves(call()))))
        for name, call in calls.items()
    }
    scale = float(np.abs(results["one"]).max())
    largest_difference("results", results, tolerance=_MAX_DIFFERENCE * scale)
    processor: dict[str, list[float]] = {name: [] for name in calls}

    def counted(name: str) -> None:
        clock = time.process_time()
        jax.block_until_ready(calls[name]())
        processor[name].append(time.process_time() - clock)

    counted_calls = {name: partial(counted, name) for name in calls}
    wall = interleaved(counted_calls, repeats, there_and_back=True)
    # The first call compiles.
    return {
        "wall_s": wall,
        "processor_s": {n: spans[1:] for n, spans in processor.items()},
    }
