"""The plan of a run: when to step, by which solver; nothing has been run yet."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...arrays import is_traced
from ...errors import InputError, require, shortened
from ...findings import found, values_of
from ...module import replaced
from ...physics.time_varying import just_before
from ...scene.compile.compile import compile_scene
from ...scene.compile.memory import with_memory_of
from ...scene.compile.on_devices import placed_on_devices
from ...scene.compile.program import Compiled, Program
from ...scene.scene import Scene
from ..explicit import RKL2Stepper, stage_count
from ..implicit.adaptive import AdaptiveStepper
from ..ledger import empty_ledger
from ..solvers import (
    MAX_REFINED_EVENTS,
    AbstractSolver,
    ErrorControl,
    ForwardEuler,
    SuperTimeStepping,
    select_solver,
)
from ..stepper import AbstractStepper, RunState


_MAX_INTERVAL_STEPS = 2**31 - 1
"""Steps of one interval: the loop counts them in 32 bits."""

_FIRST_STEPS_AFTER_EVENT = 4
"""Smallest number of steps after an event in the first pass of several."""


@dataclass(frozen=True)
class Interval:
    """Equal steps from `start` to `end` [s]."""

    start: float
    end: float
    steps: int
    saved: bool
    """True if `end` is a save time."""

    @property
    def dt(self) -> float:
        """Length of one step [s]."""
        return (self.end - self.start) / self.steps


def checked_save_times(t1: float | int, save_at) -> tuple[float, ...]:
    """Return the checked save times [s]; the end time alone if none are given."""
    number = not isinstance(t1, str | type(None)) and np.ndim(t1) == 0
    if not number or not math.isfinite(t1) or t1 < 0:
        raise InputError(f"t1={t1!r}: give an end time of at least 0 s")
    try:
        listed = (t1,) if save_at is None else tuple(save_at)
        times = () if isinstance(save_at, str) else tuple(float(t) for t in listed)
    except (TypeError, ValueError):
        raise InputError(
            f"save_at={shortened(save_at)}: give a list of times in seconds, such as "
            "[30.0, 60.0]"
        ) from None
    if not times:
        raise InputError("save_at is empty: give at least one time, or leave it out")
    # Negated, so that NaN is refused too.
    if any(not b > a for a, b in zip(times, times[1:], strict=False)):
        raise InputError(f"save_at={list(times)}: the times must increase")
    if not (times[0] >= 0 and times[-1] <= t1):
        raise InputError(f"save_at={list(times)}: the times must lie in [0, {t1:g}] s")
    return times


def _schedule(
    t1: float | int,
    saves: tuple[float, ...],
    event_times: tuple[float, ...],
    max_dt: float,
    min_steps: int = 1,
) -> tuple[Interval, ...]:
    """Divide a run into intervals that end at save times, event times and the end.

    Events are times that a step must end at, such as breakpoints of the terms' values;
    those outside (0, t1) are ignored. The longest step `max_dt` may be infinite.
    """
    if not max_dt > 0:
        raise InputError(
            f"the largest stable step is {max_dt:g} s: check the materials and terms "
            "for values far out of range"
        )
    ends = sorted({*saves, *(t for t in event_times if 0 < t < t1), t1} - {0.0})
    intervals = []
    start = 0.0
    for end in ends:
        # A quotient that exceeds a whole number by rounding must not cost a step more.
        steps = max(min_steps, math.ceil((end - start) / max_dt * (1 - 1e-9)))
        if steps > _MAX_INTERVAL_STEPS:
            raise InputError(
                f"{end - start:g} s take {steps:.2g} steps of {max_dt:.3g} s, the "
                "largest stable step: simulate a shorter time, or use a coarser pitch"
            )
        intervals.append(
            Interval(start=start, end=end, steps=steps, saved=end in saves)
        )
        start = end
    return tuple(intervals)


def _more_after_events(
    intervals: tuple[Interval, ...], event_times: tuple[float, ...]
) -> tuple[Interval, ...]:
    # What is switched changes fast at first, and may be saved soon.
    if len(event_times) > MAX_REFINED_EVENTS:
        return intervals
    switched = {0.0, *event_times}

    def refined(interval: Interval) -> Interval:
        if interval.start not in switched:
            return interval
        steps = max(interval.steps, _FIRST_STEPS_AFTER_EVENT)
        return replace(interval, steps=steps)

    return tuple(map(refined, intervals))


def save_intervals(
    intervals: tuple[Interval, ...],
) -> tuple[tuple[Interval, ...], ...]:
    """Group intervals by the save time that they lead to, the rest in a last group."""
    # Only the end of a group is observed: thousands of event times cost no memory.
    groups: list[tuple[Interval, ...]] = []
    group: list[Interval] = []
    for interval in intervals:
        group.append(interval)
        if interval.saved:
            groups.append(tuple(group))
            group = []
    return tuple([*groups, tuple(group)] if group else groups)


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
    control: ErrorControl | None = None
    """Error that the run is repeated for: these are the steps of its first pass, see
    `time_error`. None for a run of one pass."""

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
    control_error: bool = False,
) -> Plan:
    """Compile a scene and schedule its steps.

    Arguments and errors are those of `simulate`; `prune` omits terms that have no
    effect, see `compile_scene`. With `control_error` the plan of an `ErrorControl`,
    which is used where no solver is given, is that of its first pass, if numbers are
    known; else a solver is selected.
    """
    solvers = "a solver, such as ForwardEuler(), or None"
    require(
        solver,
        classes=(AbstractSolver, type(None)),
        argument="simulate(solver=)",
        give=solvers,
    )
    saves = checked_save_times(t1, save_at)
    # Steps after the last saved time would be in no result: the run ends there, and
    # its solver and its bounds of temperatures are those of that time.
    requested_end = t1
    t1 = saves[-1]
    requested_solver = ErrorControl() if solver is None else solver
    control = requested_solver if isinstance(requested_solver, ErrorControl) else None
    selected = None if isinstance(requested_solver, ErrorControl) else requested_solver
    arranged = scene if selected is None else selected.arranged(scene)
    method = ForwardEuler.method if selected is None else selected.method
    compiled = compile_scene(
        arranged, saves=len(saves), end=t1, prune=prune, method=method
    )
    limit = compiled.stable_step
    stable_step = None if is_traced(limit) else float(limit)
    reason = "as given"
    note = None
    if control is not None and not (control_error and t1 > 0):
        control = None
    elif control is not None and is_traced((scene, compiled)):
        # To repeat a run until a condition holds takes known numbers.
        control = None
        note = "error in time not estimated: values are traced"
    if selected is None:
        # The selection needs the stable step, and so a compiled scene; an implicit
        # solver arranges the bodies differently, which takes a second compilation.
        selected, reason = _selected(
            control, program=compiled.program, stable_step=stable_step, t1=t1
        )
        arranged = selected.arranged(scene)
        if arranged is not scene:
            method = selected.method
            compiled = compile_scene(
                arranged, saves=len(saves), end=t1, prune=prune, method=method
            )
    if t1 < requested_end:
        compiled = _with_note(
            compiled,
            f"the run stops at the last saved time, {t1:g} s: nothing up to its end, "
            f"{requested_end:g} s, would be saved",
        )
    if note is not None:
        compiled = _with_note(compiled, note)
    # Poses and source positions are recomputed at `starts`, so steps end there too.
    max_dt = selected.max_dt(stable_step, t1, compiled.program.sampled)
    event_times = (*compiled.breakpoints, *compiled.starts)
    min_steps = selected.min_steps(len({*saves, *event_times}))
    intervals = _schedule(
        t1, saves=saves, event_times=event_times, max_dt=max_dt, min_steps=min_steps
    )
    if control is not None and selected.dt is not None:
        intervals = _more_after_events(intervals, event_times)
    # Stages and multigrid follow the longest step taken, which may be far shorter
    # than the longest allowed.
    longest = max((i.dt for i in intervals), default=max_dt)
    if control is not None and isinstance(selected, SuperTimeStepping):
        assert stable_step is not None
        # All passes, each with steps half as long, run in one program.
        fixed = RKL2Stepper(stage_count(longest, stable_step))
        stepper = fixed.for_any_step(stable_step, compiled.receipt.dtype)
    else:
        stepper = selected.stepper(
            arranged,
            compiled=compiled,
            stable_step=stable_step,
            max_dt=longest,
            traced=is_traced(scene),
        )
    if stepper.method != method:
        compiled = with_memory_of(
            compiled, scene=arranged, saves=len(saves), method=stepper.method
        )
    checkpoints = None
    if reverse_memory is not None:
        size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(compiled.start))
        checkpoints = reverse_memory // size
        if checkpoints < 1:
            raise InputError(
                f"simulate: reverse_memory={reverse_memory} bytes is less than one "
                f"state of {size} bytes; give more memory, or leave it out to store "
                "every state"
            )
    if isinstance(stepper, AdaptiveStepper):
        stepper = replace(stepper, checkpoints=checkpoints)
    programs, stepper = placed_on_devices(
        (compiled.programs, stepper), arranged, compiled.program
    )
    compiled = replaced(compiled, programs=programs)
    return Plan(
        scene=arranged,
        compiled=compiled,
        intervals=intervals,
        save_times=saves,
        stable_step=stable_step,
        solver=selected,
        stepper=stepper,
        solver_reason=reason,
        checkpoints=checkpoints,
        control=control,
    )


def plan_once(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None,
    solver: AbstractSolver | None = None,
    reverse_memory: int | None = None,
) -> Plan:
    """Plan a run that controls its error; a scene that was planned keeps its plan.

    Arguments and errors are those of `plan_run`.
    """
    plans: list[Plan] = []

    def make() -> Plan:
        plans.append(
            plan_run(
                scene,
                t1=t1,
                save_at=save_at,
                solver=solver,
                reverse_memory=reverse_memory,
                control_error=True,
            )
        )
        return plans[0]

    # Within another function that is traced, hardly anything of a run is known.
    solver_values = values_of(solver)
    if solver_values is None or is_traced((scene, jnp.zeros(()))):
        return make()

    def find() -> tuple[Plan, bool]:
        # Without the scene, which would then exist as long as its plan.
        is_same_scene = make().scene is scene
        return (
            plans[0]._replace(scene=_NO_SCENE) if is_same_scene else plans[0]
        ), is_same_scene

    saves = checked_save_times(t1, save_at)
    key = ("plan", float(t1), saves, solver_values, reverse_memory)
    plan, is_same_scene = found((scene,), key, find)
    if plans:
        return plans[0]
    plan = without_searches(plan)
    return plan._replace(scene=scene) if is_same_scene else plan


def without_searches(plan: Plan) -> Plan:
    """Return a plan whose receipt lists no searches in geometry."""
    receipt = replace(plan.compiled.receipt, searches=())
    return plan._replace(compiled=replaced(plan.compiled, receipt=receipt))


_NO_SCENE: Any = None
"""Stands for the scene in a remembered plan."""


def _selected(
    control: ErrorControl | None,
    program: Program,
    stable_step: float | None,
    t1: float | int,
) -> tuple[AbstractSolver, str]:
    symmetric = all(body.network.linear.is_symmetric for body in program.bodies)
    if control is None or stable_step is None:
        return select_solver(stable_step, t1, symmetric)
    return control.first(stable_step, t1, symmetric, program.sampled)


def _with_note(compiled: Compiled, note: str) -> Compiled:
    receipt = compiled.receipt
    return replace(compiled, receipt=replace(receipt, notes=(*receipt.notes, note)))


def initial_state(plan: Plan) -> RunState:
    """Return the state at time 0, in arrays of its own, which a run may overwrite."""
    entries = len(plan.compiled.program.entries)
    state = RunState(plan.compiled.state, empty_ledger(entries, plan.dtype))
    return plan.stepper.begin(state)


def observation_time(plan: Plan, interval: Interval) -> float:
    """Return the time of the loads with which the surface is observed at the end [s].

    It is within the last step, so that a load that is switched at the end of the
    interval still counts as it was.
    """
    before_end = (1 - plan.solver.load_fraction) * interval.dt
    return min(interval.end - before_end, just_before(interval.end, plan.dtype))


class StepTable(NamedTuple):
    """Steps as arrays: one row per save interval, one column per interval in it.

    An argument of the compiled program, so that one program serves every schedule.
    Unused columns have 0 steps.
    """

    start: Float[Any, "rows columns"]
    """Start of each interval [s]."""
    dt: Float[Any, "rows columns"]
    """Length of its steps [s]."""
    steps: Int[Any, "rows columns"]
    """Number of steps of each interval."""
    observation_time: Float[Any, " rows"]
    """Time of the loads with which the surface is observed after each row [s]."""


def step_table(
    plan: Plan,
    groups: tuple[tuple[Interval, ...], ...],
    min_rows: int = 0,
    min_columns: int = 0,
) -> StepTable:
    """Tabulate the steps of save intervals, of at least the given shape."""
    rows = max(len(groups), min_rows)
    columns = max(min_columns, *(len(group) for group in groups))
    table = np.zeros((3, rows, columns))
    observed = np.zeros(rows)
    for row, group in enumerate(groups):
        steps = [(i.start, i.dt, i.steps) for i in group]
        table[:, row, : len(group)] = np.transpose(steps)
        observed[row] = observation_time(plan, group[-1])
    # Computed in float64 on the host, rounded once.
    start, dt = table[:2].astype(plan.dtype)
    return StepTable(
        start=start,
        dt=dt,
        steps=table[2].astype(np.int32),
        observation_time=observed.astype(plan.dtype),
    )


def program_groups(
    plan: Plan,
) -> list[tuple[Program, tuple[tuple[Interval, ...], ...]]]:
    """Return the programs of a run in order, with the save intervals of each.

    There are several where bodies or sources move: one for each of their snapshots.
    """
    intervals_by_number: dict[int, list[Interval]] = {}
    for interval in plan.intervals:
        number = plan.compiled.number_at(interval.start)
        intervals_by_number.setdefault(number, []).append(interval)
    return [
        (plan.compiled.programs[number], save_intervals(tuple(intervals)))
        for number, intervals in sorted(intervals_by_number.items())
    ]


def saved_numbers(groups: tuple[tuple[Interval, ...], ...]) -> Int[np.ndarray, " _"]:
    """Return the numbers of the save intervals that end at a save time."""
    return np.flatnonzero([group[-1].saved for group in groups])


class _StepBlock(NamedTuple):
    """Steps of one program of a run."""

    program: Program
    table: StepTable
    saved_rows: Int[np.ndarray, " _"]
    """Rows of the table that end at a save time."""


def step_blocks(plan: Plan, takes_steps: bool = True) -> list[_StepBlock]:
    """Tabulate the steps of each program of a run, or none of them."""
    pairs = program_groups(plan)
    # One shape for all programs, which differ in numbers only: compiled once.
    rows = max(len(groups) for _, groups in pairs)
    columns = max(len(group) for _, groups in pairs for group in groups)
    blocks = []
    for program, groups in pairs:
        table = step_table(plan, groups, min_rows=rows, min_columns=columns)
        if not takes_steps:
            table = table._replace(steps=np.zeros_like(table.steps))
        blocks.append(_StepBlock(program, table, saved_numbers(groups)))
    return blocks
