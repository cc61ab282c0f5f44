"""The plan of a run: compiled scene, solver and steps; nothing has been run yet."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import is_traced
from ...errors import InputError
from ...network.network import precise_sum
from ...scene.compile.compile import compile_scene
from ...scene.compile.program import Compiled, State
from ...scene.scene import Scene
from ..implicit.adaptive import AdaptiveStepper
from ..solvers import AbstractSolver, select_solver
from ..stepper import AbstractStepper, RunState
from .ledger import empty_ledger
from .schedule import END_ROUNDINGS, Interval, save_times, schedule


class Plan(NamedTuple):
    """A compiled scene with its solver and steps: every decision before the run."""

    scene: Scene
    """The scene, its bodies arranged as the solver runs fast."""
    compiled: Compiled
    intervals: tuple[Interval, ...]
    save_times: tuple[float, ...]
    stable_step: float | None
    """Largest stable explicit step [s]; None if it is traced."""
    solver: AbstractSolver
    stepper: AbstractStepper
    solver_reason: str = "as given"
    """Why this solver was selected, for the terminal."""
    checkpoints: int | None = None
    """Number of states that reverse mode stores; None for all."""

    @property
    def steps(self) -> int:
        """Number of steps of the whole run."""
        return sum(interval.steps for interval in self.intervals)

    @property
    def dtype(self) -> Any:
        """Floating-point type of the state."""
        return jnp.dtype(self.compiled.receipt.dtype)


def plan_run(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None,
    solver: AbstractSolver | None = None,
    prune: bool = True,
    reverse_memory: int | None = None,
) -> Plan:
    """Compile a scene and schedule its steps.

    Arguments and errors are those of `simulate`; `prune` omits terms that have no
    effect, see `compile_scene`.
    """
    saves = save_times(t1, save_at)
    arranged = scene if solver is None else solver.arranged(scene)
    compiled = compile_scene(arranged, len(saves), t1, prune)
    traced = is_traced(compiled.stable_step)
    stable_step = None if traced else float(compiled.stable_step)
    reason = "as given"
    if solver is None:
        # The selection needs the stable step, and so a compiled scene; an implicit
        # solver arranges the bodies differently, which takes a second compilation.
        solver, reason = select_solver(stable_step, t1)
        arranged = solver.arranged(scene)
        if arranged is not scene:
            compiled = compile_scene(arranged, len(saves), t1, prune)
    # Poses and source positions are recomputed at `starts`, so steps end there too.
    max_dt = solver.max_dt(stable_step, t1, compiled.program.sampled)
    event_times = (*compiled.program.breakpoints, *compiled.starts)
    min_steps = solver.min_steps(len({*saves, *event_times}))
    intervals = schedule(t1, saves, event_times, max_dt, min_steps)
    # Stages and multigrid follow the longest step taken, which may be far shorter
    # than the longest allowed.
    longest = max((i.dt for i in intervals), default=max_dt)
    stepper = solver.stepper(arranged, compiled, longest, is_traced(scene))
    checkpoints = None
    if reverse_memory is not None:
        checkpoints = _checkpoint_count(compiled.state, reverse_memory)
    if isinstance(stepper, AdaptiveStepper):
        stepper = replace(stepper, checkpoints=checkpoints)
    parts = (arranged, compiled, intervals, saves, stable_step, solver, stepper)
    return Plan(*parts, reason, checkpoints)


def _checkpoint_count(state: State, memory: int) -> int:
    size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(state))
    if memory < size:
        raise InputError(
            f"simulate: reverse_memory={memory} bytes is less than one state of {size} "
            "bytes; give more memory, or leave it out to store every state"
        )
    return memory // size


def initial_state(plan: Plan) -> RunState:
    """Return the state at time 0."""
    entries = len(plan.compiled.program.entries)
    state = RunState(plan.compiled.state, empty_ledger(entries, plan.dtype))
    return plan.stepper.begin(state)


def equalization_heat(plan: Plan, states: State) -> Float[Array, " b"]:
    """Return the heat that conduction moves to make each body uniform [J].

    It scales the ledger's error where a body starts unevenly and no mechanism acts.
    """
    heat = []
    parts = zip(plan.scene.bodies, plan.compiled.program.bodies, states, strict=True)
    for body, part, state in parts:
        if not callable(body.temperature):
            heat.append(jnp.asarray(np.zeros((), state.dtype)))
            continue
        address = tuple(jnp.asarray(index) for index in body.structure.node_address())
        mean = part.network.stored(state) / part.network.total_capacity()
        excess = jnp.abs(state[address] - mean) * part.network.capacity_at(address)
        heat.append(precise_sum(excess) / 2)
    return jnp.stack(heat)


def intervals_by_program(plan: Plan) -> list[tuple[int, tuple[Interval, ...]]]:
    """Return the index of each compiled program with the intervals that it runs."""
    index = [plan.compiled.number_at(i.start) for i in plan.intervals]
    return [
        (n, tuple(i for i, m in zip(plan.intervals, index, strict=True) if m == n))
        for n in sorted(set(index))
    ]


def observation_time(plan: Plan, interval: Interval) -> float:
    """Return the time of the loads with which the surface is observed at the end [s].

    It is within the last step, so that a load that is switched at the end of the
    interval still counts as it was.
    """
    before_end = (1 - plan.solver.load_fraction) * interval.dt
    # In the run's own precision the time must differ from the end.
    rounding = END_ROUNDINGS * float(jnp.finfo(plan.dtype).eps) * abs(interval.end)
    return interval.end - max(before_end, rounding)


class StepTable(NamedTuple):
    """Steps as arrays: one row per save interval, one column per interval in it.

    An argument of the compiled program, so that one program serves every schedule.
    Unused columns have 0 steps.
    """

    start: Float[Array, "rows columns"]
    """Start of each interval [s]."""
    dt: Float[Array, "rows columns"]
    """Length of its steps [s]."""
    steps: Int[Array, "rows columns"]
    observation_time: Float[Array, "rows columns"]
    """Time of the loads with which the surface is observed at its end [s]."""


def step_table(
    plan: Plan,
    groups: tuple[tuple[Interval, ...], ...],
    min_rows: int = 0,
    min_columns: int = 0,
) -> StepTable:
    """Tabulate the steps of save intervals, of at least the given shape."""
    shape = max(len(groups), min_rows), max(min_columns, *(len(g) for g in groups))
    start, dt, observed = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    steps = np.zeros(shape, np.int32)
    for row, group in enumerate(groups):
        start[row, : len(group)] = [i.start for i in group]
        dt[row, : len(group)] = [i.dt for i in group]
        steps[row, : len(group)] = [i.steps for i in group]
        observed[row, : len(group)] = [observation_time(plan, i) for i in group]
    # Computed in float64 on the host, rounded once.
    typed = lambda values: jnp.asarray(values, plan.dtype)
    return StepTable(typed(start), typed(dt), jnp.asarray(steps), typed(observed))
