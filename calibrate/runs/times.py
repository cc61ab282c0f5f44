"""Run times of cases, one after the other: the second pass of a sweep.

A time is that of the compiled loop with the surface read at the saved times, after a
warm-up, until its results are there. The explicit loop of the full volume in the same
voxels is timed in turn with it, so that a slower moment of the machine meets both.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.plan import (
    Plan,
    StepTable,
    initial_state,
    plan_run,
    save_intervals,
    step_table,
)
from jaxthermo.integrate.run.simulate import run_plan, simulate, take_steps
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.provenance import processor
from jaxthermo.scene.scene import Scene
from jaxthermo.timing import timed_call

from ..problem.reference import on_every_voxel
from .case import Case
from .evaluate import Row
from .scenes import build_case, plan_case


_MAX_CALLS = 3
"""Largest number of the user's calls that are timed."""
_MAX_FULL_S = 0.5
"""Time of a loop of the full volume, beyond which it takes a part of its steps [s]."""
_MIN_STEPS = 8
"""Smallest number of steps of such a part."""


@dataclass(frozen=True, eq=False)
class Loop:
    """A compiled loop over all steps of a run, with the surface read."""

    run: Callable[[], Any]
    plan: Plan
    compile_s: float
    fraction: float = 1.0
    """Fraction of the steps that it takes."""
    reading_s: float = 0.0
    """Time of a run without steps, which a part takes as the whole does [s]."""

    def seconds(self) -> float:
        """Wall time of the whole run [s], by its part where it takes one."""
        spent = timed_call(self.run)[1]
        if self.fraction == 1.0:
            return spent
        return self.reading_s + (spent - self.reading_s) / self.fraction


def time_case(case: Case, repeats: int) -> Row:
    """Time a case, and the full volume's explicit loop in turn with it.

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
    # What is found in geometry was found for the errors, and is read again.
    planned = time.perf_counter() - clock
    set_up = built.voxels_s + built.structures_s + planned
    # Before other programs: the first call compiles what the loop then finds. It has
    # this plan, which it would have to make.
    call = lambda: _call(config, built.scene)
    first_call = planned + timed_call(call)[1]
    loop = compiled_loop(plan)
    loop.seconds()
    full = _full_volume(_FullKey(config))
    spans: dict[str, list[float]] = {"loop_s": [], "full_volume_loop_s": []}
    for _ in range(repeats):
        spans["loop_s"].append(loop.seconds())
        spans["full_volume_loop_s"].append(full.seconds())
    calls = [timed_call(call)[1] for _ in range(min(repeats, _MAX_CALLS))]
    return {
        "id": case.id,
        "choice": dict(case.names),
        "load": case.load,
        **spans,
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
    span, solver = config.time, config.solver.build()
    with warnings.catch_warnings():
        # They are in the row of the case's error.
        warnings.simplefilter("ignore")
        found = simulate(scene, span.end, span.save_times, solver=solver)
    return found.surface_temperature


def _steps(plan: Plan) -> int | None:
    # Under error control the number of passes is known only after the run.
    return None if plan.control is not None else plan.steps


def compiled_loop(plan: Plan) -> Loop:
    """Compile the loop of a plan; nothing but the loop is in its time.

    A run that controls its error in time, or in which something moves, is timed whole:
    all passes and what decides between them.
    """
    clock = time.perf_counter()
    if plan.control is not None or len(plan.compiled.programs) > 1:

        def whole() -> Any:
            with precision(plan.scene.dtype):
                return run_plan(plan).surface_temperature

        jax.block_until_ready(whole())
        return Loop(whole, plan, time.perf_counter() - clock)
    with precision(plan.scene.dtype):
        table = step_table(plan, save_intervals(plan.intervals))
        run = _compiled(plan, table)
    return Loop(lambda: run(table), plan, time.perf_counter() - clock)


def _compiled(plan: Plan, table: StepTable) -> Callable[[StepTable], Any]:
    """Compile the loop for any table of this shape."""
    given = plan.stepper, plan.compiled.program, initial_state(plan)
    jax.block_until_ready(given[1:])
    # A function of its own, so that nothing compiled before is used again.
    own = lambda *parts: take_steps(*parts)
    made = eqx.filter_jit(own).lower(*given, table).compile()

    def run(table: StepTable) -> Any:
        with precision(plan.scene.dtype):
            return made(*given, table)[1]

    return run


class _FullKey:
    """Config of a full volume by what its run follows from."""

    def __init__(self, config: SceneConfig):
        self.config = on_every_voxel(config)
        self.text = self.config.model_dump_json()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _FullKey) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)


@lru_cache(maxsize=1)
def _full_volume(key: _FullKey) -> Loop:
    """Warm explicit loop of the full volume, of all steps or a part of them."""
    scene, span = build_case(key.config).scene, key.config.time
    clock = time.perf_counter()
    with precision(scene.dtype):
        plan = plan_run(
            scene, t1=span.end, save_at=span.save_times, solver=ForwardEuler()
        )
        table = step_table(plan, save_intervals(plan.intervals))
        run = _compiled(plan, table)
    compile_s = time.perf_counter() - clock
    none, few = _shortened(table, 0), _shortened(table, _MIN_STEPS)
    run(none)
    reading_s = min(timed_call(lambda: run(none))[1] for _ in range(3))
    fraction = _fraction(few, table)
    per_run = (timed_call(lambda: run(few))[1] - reading_s) / fraction
    if per_run > _MAX_FULL_S:
        longest = int(np.asarray(table.steps).max())
        steps = max(_MIN_STEPS, int(longest * _MAX_FULL_S / per_run))
        table, whole = _shortened(table, steps), table
        fraction = _fraction(table, whole)
    else:
        fraction = 1.0
    loop = Loop(
        run=lambda: run(table),
        plan=plan,
        compile_s=compile_s,
        fraction=fraction,
        reading_s=reading_s,
    )
    loop.seconds()
    return loop


def _shortened(table: StepTable, steps: int) -> StepTable:
    return table._replace(steps=jnp.minimum(table.steps, steps))


def _fraction(part: StepTable, whole: StepTable) -> float:
    return float(np.asarray(part.steps).sum() / np.asarray(whole.steps).sum())
