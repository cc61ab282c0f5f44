"""Errors of cases: those of one shape in one program, each case a row.

A row holds plain values. A case that cannot be run is a row too, with the reason.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from jaxthermo.accuracy.error_records import ReferenceErrors
from jaxthermo.accuracy.truth_error import TruthPoints, truth_points
from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.made_solution import make_solution
from jaxthermo.integrate.run.plan import Plan, step_table
from jaxthermo.integrate.run.simulate import (
    FirstLoop,
    first_loop,
    run_plan,
    take_steps,
)
from jaxthermo.integrate.run.solution import RESULTS, Observation, Solution
from jaxthermo.integrate.run.surface_reading import SurfaceReading
from jaxthermo.memo.found import on_device
from jaxthermo.parallel.batch import from_first_device, over_devices
from jaxthermo.parallel.devices import mesh_of

from ..problem.reference import Log, RunCost, refined_reference
from .case import Case, Keyed, build_case, has_fixed_steps, loop_size, plan_case
from .picture import difference_picture
from .rows import Row


class Truth(NamedTuple):
    """A reference at points, with its own error and its costs."""

    points: TruthPoints
    own_error: ReferenceErrors
    costs: tuple[RunCost, ...]


def find_truth(case: Case, log: Log) -> Truth:
    """Run the reference of a case with two coarser ones, or load them."""
    # One for all choices under a load.
    return _truth(Keyed(case.truth_key, (case, log)))


@lru_cache(maxsize=16)
def _truth(request: Keyed[tuple[Case, Log]]) -> Truth:
    case, log = request.value
    settings = case.truth
    reference = refined_reference(case.config, settings=settings, log=log)
    points = truth_points(reference.solution, count=settings.points, seed=settings.seed)
    own_error = reference.own_error.as_dict()
    return Truth(points=points, own_error=own_error, costs=reference.costs)


MAX_TOGETHER = 16
"""Largest number of cases in one program."""
_MAX_BYTES = 2 * 2**30
"""Estimated memory of all cases in one program [bytes]."""


class Evaluated(NamedTuple):
    """A row, and the picture of its errors; None for a case that failed."""

    row: Row
    picture: bytes | None


class _Planned(NamedTuple):
    case: Case
    plan: Plan
    seconds: float


def evaluate(case: Case, truth: Truth) -> Evaluated:
    """Run one case alone and measure its error against the reference."""
    return evaluate_group([case], {case.load: truth})[0]


def evaluate_group(
    cases: Sequence[Case], truths: Mapping[str, Truth], devices: int = 1
) -> list[Evaluated]:
    """Run cases, those whose arrays have the same shapes in one program.

    Args:
        cases: in any order.
        truths: reference of each load by its name.
        devices: number of devices that share the cases of a program.

    Returns:
        A row for each case, in their order.
    """
    evaluated: dict[int, Evaluated] = {}
    waiting: list[tuple[int, _Planned]] = []
    for number, case in enumerate(cases):
        try:
            waiting.append((number, _plan(case)))
        except Exception as error:
            evaluated[number] = failed(case, error)
    for batch in _batches(waiting):
        members = [planned for _, planned in batch]
        results = _run(members, truths, devices)
        for (number, _), result in zip(batch, results, strict=True):
            evaluated[number] = result
    return [evaluated[number] for number in range(len(cases))]


def failed(case: Case, error: BaseException) -> Evaluated:
    """The row of a case that cannot be run, with the reason."""
    # One case of many must not end the others, whatever went wrong in it.
    lines = str(error).strip().splitlines() or [""]
    error_type = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    return Evaluated({**case.head, "failed": f"{error_type}{lines[0]}"[:500]}, None)


def _plan(case: Case) -> _Planned:
    clock = time.perf_counter()
    plan = plan_case(case.config, build_case(case.config).scene)
    return _Planned(case, plan, time.perf_counter() - clock)


def _batches(
    waiting: list[tuple[int, _Planned]],
) -> Iterator[list[tuple[int, _Planned]]]:
    """Split planned cases into those that can run in one program."""
    groups: dict[Any, list[tuple[int, _Planned]]] = {}
    for entry in waiting:
        groups.setdefault(_shape(entry[1].plan), []).append(entry)
    for group in groups.values():
        memory = group[0][1].plan.compiled.receipt.memory_bytes
        size = int(np.clip(_MAX_BYTES // max(memory, 1), 1, MAX_TOGETHER))
        for first in range(0, len(group), size):
            yield group[first : first + size]


def _shape(plan: Plan) -> Any:
    """Equal for plans that differ in numbers only; never for those that run alone."""
    if not has_fixed_steps(plan) or not plan.intervals:
        return object()
    with precision(plan.scene.dtype):
        arrays, static = eqx.partition(_loop(plan), eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    shapes = tuple((leaf.shape, str(leaf.dtype)) for leaf in leaves)
    # Functions and texts in the program are compared as they are.
    return (shapes, str(tree), str(jax.tree.leaves(static)))


def _loop(plan: Plan) -> FirstLoop:
    return first_loop(plan, on_device(step_table(plan)))


def _run(
    batch: list[_Planned], truths: Mapping[str, Truth], devices: int
) -> list[Evaluated]:
    clock = time.perf_counter()
    plans = [planned.plan for planned in batch]
    try:
        with precision(plans[0].scene.dtype):
            if len(plans) == 1:
                solutions = [run_plan(plans[0])]
            else:
                rows = _together([_loop(plan) for plan in plans], devices)
                solutions = [
                    make_solution(plan, jax.tree.map(lambda a, n=n: a[n], rows))
                    for n, plan in enumerate(plans)
                ]
    except Exception as error:
        return [failed(planned.case, error) for planned in batch]
    seconds = (time.perf_counter() - clock) / len(batch)
    evaluated = []
    readings: dict[Any, SurfaceReading] = {}
    for planned, solution in zip(batch, solutions, strict=True):
        try:
            truth = truths[planned.case.load]
            reading = _reading(truth, solution=solution, readings=readings)
            judged = _judged(planned, solution=solution, truth=truth, reading=reading)
            judged.row["together"] = len(batch)
            judged.row["took_s"] += planned.seconds + seconds
            evaluated.append(judged)
        except Exception as error:
            evaluated.append(failed(planned.case, error))
    return evaluated


def _together(loops: list[FirstLoop], devices: int) -> Observation:
    """Observations of runs that differ in numbers, along a new first axis."""
    pairs = [eqx.partition(loop, eqx.is_array) for loop in loops]
    static = pairs[0][1]
    flat = [jax.tree.leaves(arrays) for arrays, _ in pairs]
    tree = jax.tree.structure(pairs[0][0])
    # Arrays that all have in common, such as the indices of links, are stored once.
    differs = [
        not all(_equal(a, row[0]) for a in row[1:]) for row in zip(*flat, strict=True)
    ]
    columns = zip(*flat, strict=True)
    stacked = [
        jnp.stack(row) if varies else row[0]
        for row, varies in zip(columns, differs, strict=True)
    ]
    mesh = None if devices == 1 else mesh_of(devices)
    observations = _mapped(
        stacked, differs=tuple(differs), tree=tree, static=static, mesh=mesh
    )
    # The rest is computed on one device, one case after the other.
    return from_first_device(mesh, jax.block_until_ready(observations))


@eqx.filter_jit
def _mapped(
    leaves: list[jax.Array],
    differs: tuple[bool, ...],
    tree: Any,
    static: Any,
    mesh: Mesh | None,
) -> Observation:
    # One function for all batches: the next one of this shape is not compiled again.
    def run_case(varying: list[jax.Array]) -> Observation:
        loop = eqx.combine(jax.tree.unflatten(tree, varying), static)
        return take_steps(loop.arguments, loop.theta)[1]

    axes = [0 if varies else None for varies in differs]

    def run_cases(varying: Any, shared: Any) -> tuple[Observation, None]:
        return jax.vmap(run_case, in_axes=(axes,))(eqx.combine(varying, shared)), None

    return over_devices(mesh, run_cases, *eqx.partition(leaves, list(differs)))[0]


def _equal(a: jax.Array, b: jax.Array) -> bool:
    return a is b or bool(np.array_equal(np.asarray(a), np.asarray(b)))


def _reading(
    truth: Truth, solution: Solution, readings: dict[Any, SurfaceReading]
) -> SurfaceReading:
    """Reading of the reference's points, once for all cases in the same voxels."""
    places = (id(s.geometry.fragment_position) for s in solution.surfaces)
    key = (id(truth), *places)
    if key not in readings:
        readings[key] = truth.points.reading(solution.surfaces)
    return readings[key]


def _judged(
    planned: _Planned, solution: Solution, truth: Truth, reading: SurfaceReading
) -> Evaluated:
    if solution.result != RESULTS.successful:
        raise InputError(RESULTS[solution.result])
    clock = time.perf_counter()
    with precision(planned.plan.scene.dtype):
        error = truth.points.error(solution, reading)
    if not np.isfinite(np.asarray(error.rms_kelvin)).all():
        raise InputError("the error is not finite")
    picture = difference_picture(truth.points, solution, reading)
    receipt = planned.plan.compiled.receipt
    size = loop_size(planned.plan)
    residual = np.abs(np.asarray(solution.energy.residual_relative)).max()
    row = {
        **planned.case.head,
        "error": error.as_dict(),
        "own_error": truth.own_error,
        "nodes": receipt.nodes,
        "links": receipt.links,
        "steps": solution.run.steps,
        "memory_bytes": receipt.memory_bytes,
        "loop_size": None if size is None else list(size),
        # Largest of the saved times, over the heat that moved.
        "energy_residual": float(residual),
        "together": 1,
        "warnings": list(receipt.warnings),
        "took_s": time.perf_counter() - clock,
        "picture": None,
    }
    return Evaluated(row, picture)
