"""Run times of cases, one after the other: the second pass of a sweep.

A time is that of the compiled loop with the surface read at the saved times, after a
warm-up, until its results are ready. It is measured alternately with the explicit loop
of the full volume in the same voxels, so that a slow moment of the machine meets both.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.parametric_run import stable_solver
from jaxthermo.integrate.run.plan import (
    Plan,
    StepTable,
    plan_run,
    step_table,
)
from jaxthermo.integrate.run.simulate import (
    first_loop,
    run_plan,
    simulate,
    take_steps,
)
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.integrate.stepper import LoopArguments
from jaxthermo.provenance import processor
from jaxthermo.scene.scene import Scene
from jaxthermo.timing import Spans, interleaved, ratio_of, timed_call

from ..config.fit_record import SpeedRatio, Speedup
from ..problem.reference import on_every_voxel
from .case import Case, Keyed, build_case, has_fixed_steps, plan_case
from .rows import Row


_MAX_CALLS = 3
"""Largest number of the user's calls that are timed."""
_MAX_FULL_S = 0.5
"""Time of a full-volume loop beyond which only some of its steps are run [s]."""
_MIN_STEPS = 8
"""Smallest number of steps of a shortened loop."""


@dataclass(frozen=True, eq=False)
class Loop:
    """A compiled loop over all steps of a run, with the surface read."""

    run: Callable[[], Any]
    plan: Plan
    compile_s: float
    fraction: float = 1.0
    """Fraction of the steps that are run."""
    reading_s: float = 0.0
    """Time of a run without steps, equal for a shortened and a complete loop [s]."""

    def complete(self, seconds: float) -> float:
        """Wall time of the complete run [s] from that of `run`, which may be cut."""
        if self.fraction == 1.0:
            return seconds
        return self.reading_s + (seconds - self.reading_s) / self.fraction

    def seconds(self) -> float:
        """Wall time of the complete run [s], measured once."""
        return self.complete(timed_call(self.run)[1])


def time_case(case: Case, repeats: int) -> Row:
    """Time a case alternately with the full volume's explicit loop.

    Args:
        case: one that runs without error.
        repeats: of both loops.

    Returns:
        The row of `times.jsonl`, all in seconds.
    """
    config = case.config
    built = build_case(config)
    clock = time.perf_counter()
    plan = plan_case(config, built.scene)
    # Results about the geometry are cached since the errors were computed.
    planned = time.perf_counter() - clock
    set_up = built.voxels_s + built.structures_s + planned

    def call() -> Any:
        return _call(config, built.scene)

    # Before other programs: the first call compiles what the loop then reuses. It
    # uses this plan, whose time counts with it.
    first_call = planned + timed_call(call)[1]
    loop = compiled_loop(plan)
    loop.seconds()
    full_config = on_every_voxel(config)
    full = _full_volume(Keyed(full_config.model_dump_json(), full_config))
    spans = interleaved({"loop": loop.run, "full": full.run}, repeats, warm_up=False)
    calls = [timed_call(call)[1] for _ in range(min(repeats, _MAX_CALLS))]
    return {
        "id": case.id,
        "choice": dict(case.names),
        "load": case.load,
        "loop_s": spans["loop"],
        "full_volume_loop_s": [full.complete(span) for span in spans["full"]],
        "call_s": calls,
        "first_call_s": first_call,
        "known_set_up_s": set_up,
        "compile_s": loop.compile_s,
        "steps": _steps(plan),
        "solver": type(plan.solver).__name__,
        "full_volume": {
            "nodes": full.plan.compiled.receipt.nodes,
            "steps": full.plan.steps,
            "timed_fraction": full.fraction,
        },
        "processor": processor(),
    }


def _call(config: SceneConfig, scene: Scene) -> Any:
    span = config.time
    solver = config.solver.build()
    with warnings.catch_warnings():
        # They are in the row of the case's error.
        warnings.simplefilter("ignore")
        solution = simulate(scene, span.end, span.save_times, solver=solver)
    return solution.surface_temperature


def _steps(plan: Plan) -> int | None:
    # Under error control the number of passes is known only after the run.
    return None if plan.control is not None else plan.steps


def compiled_loop(plan: Plan) -> Loop:
    """Compile the loop of a plan; nothing but the loop is in its time.

    A run that controls its error in time, or in which something moves, is timed with
    all of its passes and the decisions between them.
    """
    clock = time.perf_counter()
    if not has_fixed_steps(plan):
        complete_run = partial(_run, plan)
        jax.block_until_ready(complete_run())
        return Loop(complete_run, plan=plan, compile_s=time.perf_counter() - clock)
    with precision(plan.scene.dtype):
        table = step_table(plan)
        run = _compiled(plan, table)
    compile_s = time.perf_counter() - clock
    return Loop(lambda: run(table), plan=plan, compile_s=compile_s)


def _compiled(plan: Plan, table: StepTable) -> Callable[[StepTable], Any]:
    """Compile the loop for any table of this shape."""
    first = first_loop(plan, table)
    jax.block_until_ready((first.arguments.program, first.theta))

    # A new function object, whose program is not in the cache of jit.
    def loop(arguments: LoopArguments, theta: Any) -> Any:
        return take_steps(arguments, theta)

    compiled = eqx.filter_jit(loop).lower(first.arguments, first.theta).compile()

    def run(table: StepTable) -> Any:
        with precision(plan.scene.dtype):
            return compiled(first.arguments._replace(steps=table), first.theta)[1]

    return run


@lru_cache(maxsize=1)
def _full_volume(config: Keyed[SceneConfig]) -> Loop:
    """Warm explicit loop of the full volume, with all or some of its steps."""
    scene = build_case(config.value).scene
    span = config.value.time
    clock = time.perf_counter()
    with precision(scene.dtype):
        plan = plan_run(
            scene, t1=span.end, save_at=span.save_times, solver=ForwardEuler()
        )
        table = step_table(plan)
        run = _compiled(plan, table)
    compile_s = time.perf_counter() - clock
    no_steps = _shortened(table, 0)
    few_steps = _shortened(table, _MIN_STEPS)
    run(no_steps)
    reading_s = min(timed_call(lambda: run(no_steps))[1] for _ in range(3))
    seconds = timed_call(lambda: run(few_steps))[1] - reading_s
    per_run = seconds / _fraction(few_steps, table)
    timed = table
    if per_run > _MAX_FULL_S:
        longest = int(np.asarray(table.steps).max())
        steps = max(_MIN_STEPS, int(longest * _MAX_FULL_S / per_run))
        timed = _shortened(table, steps)
    fraction = _fraction(timed, table)
    loop = Loop(
        run=lambda: run(timed),
        plan=plan,
        compile_s=compile_s,
        fraction=fraction,
        reading_s=reading_s,
    )
    loop.seconds()
    return loop


def _shortened(table: StepTable, steps: int) -> StepTable:
    return table._replace(steps=jnp.minimum(table.steps, steps))


def _fraction(shortened: StepTable, table: StepTable) -> float:
    return float(np.asarray(shortened.steps).sum() / np.asarray(table.steps).sum())


_REPEATS = 3
_MAX_REPEATED_SECONDS = 20.0
"""Time of one repeat, beyond which runs are timed once [s]."""


def measure_speed(config: SceneConfig, default: Scene, fitted: Scene) -> Speedup:
    """Time the compiled loops of a case, with its surface read at the saved times."""
    full = on_every_voxel(config).build()
    span = config.time
    solver = config.solver.build()
    runs = {
        "full_volume": (full, ForwardEuler()),
        "default": (default, stable_solver(solver, default, span.last)),
        "fitted": (fitted, stable_solver(solver, fitted, span.last)),
    }
    with precision(config.dtype):
        plans = {
            name: plan_run(scene, t1=span.end, save_at=span.save_times, solver=stepper)
            for name, (scene, stepper) in runs.items()
        }
        calls = {name: partial(_run, planned) for name, planned in plans.items()}
        # The first runs compile.
        total = sum(timed_call(call)[1] for call in calls.values())
        repeats = _REPEATS if total < _MAX_REPEATED_SECONDS else 1
        spans = interleaved(calls, repeats, warm_up=False)
    return {
        **_ratios(spans, "fitted"),
        "default": _ratios(spans, "default"),
        "nodes": {n: p.compiled.receipt.nodes for n, p in plans.items()},
        "steps": {n: p.steps for n, p in plans.items()},
        "solver": {n: type(p.solver).__name__ for n, p in plans.items()},
        "run_time_s": spans,
    }


def _ratios(spans: Spans, name: str) -> SpeedRatio:
    ratio = ratio_of(spans["full_volume"], spans[name])
    return {"times_faster": ratio.median, "min": ratio.low, "max": ratio.high}


def _run(planned: Plan) -> Any:
    with precision(planned.scene.dtype):
        return run_plan(planned).surface_temperature
