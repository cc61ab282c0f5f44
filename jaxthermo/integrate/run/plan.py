"""The plan of a run: when to step, by which solver; nothing has been run yet."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...arrays import device_array, is_traced, split_times
from ...errors import InputError, require
from ...physics.windows import Window
from ...scene.compile.body_names import body_labels
from ...scene.compile.compile import compile_scene
from ...scene.compile.groups import BodyGroup, body_groups
from ...scene.compile.memory import Method, with_memory_of
from ...scene.compile.on_devices import placed_on_devices
from ...scene.compile.program import Compiled, Program
from ...scene.compile.time_values import with_open_functions
from ...scene.scene import Scene
from ..explicit import RKL2Stepper
from ..implicit.adaptive import AdaptiveStepper
from ..ledger import empty_ledger
from ..part_stepper import StagePart, in_parts
from ..solvers import (
    AbstractSolver,
    ErrorControl,
    ForwardEuler,
    SuperTimeStepping,
    select_solver,
)
from ..stepper import AbstractStepper, RunState
from .schedule import (
    Interval,
    checked_save_times,
    more_after_events,
    narrowed,
    save_intervals,
    schedule,
)


_NOT_ESTIMATED = (
    "error in time not estimated: values are traced; run the scene once with known "
    "numbers, or with a shorter `dt`, to see it"
)


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
    def groups(self) -> tuple[BodyGroup, ...]:
        """Bodies that conduct as one network, one state a group."""
        return body_groups(self.scene, self.compiled.classes)

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
    scene = with_open_functions(scene)
    # Steps after the last saved time would be in no result: the run ends there, and
    # its solver and its bounds of temperatures are those of that time.
    end = saves[-1]
    choice = _compiled_for(
        ErrorControl() if solver is None else solver,
        scene=scene,
        saves=saves,
        prune=prune,
        control_error=control_error,
    )
    scene = choice.scene
    compiled = choice.compiled
    if end < t1:
        compiled = with_note(
            compiled,
            f"the run stops at the last saved time, {end:g} s: nothing up to its end, "
            f"{t1:g} s, would be saved",
        )
    if choice.note is not None:
        compiled = with_note(compiled, choice.note)
    # Poses and source positions are recomputed at `starts`, so steps end there too.
    solver = choice.solver
    max_dt = solver.max_dt(choice.stable_step, end, compiled.program.sampled)
    event_times = (*compiled.breakpoints, *compiled.starts)
    min_steps = solver.min_steps(len({*saves, *event_times}))
    intervals = schedule(
        end, saves=saves, event_times=event_times, max_dt=max_dt, min_steps=min_steps
    )
    if choice.control is not None and solver.dt is not None:
        intervals = more_after_events(intervals, event_times)
    # Stages and multigrid follow the longest step taken, which may be far shorter
    # than the longest allowed.
    stepper = _stepper(choice, max((i.dt for i in intervals), default=max_dt))
    if stepper.method != "implicit" and choice.stable_step is not None:
        compiled = with_limiting_body(compiled, scene)
    if stepper.method != choice.method:
        compiled = with_memory_of(
            compiled, scene=scene, saves=len(saves), method=stepper.method
        )
    checkpoints = checkpoint_count(reverse_memory, compiled)
    if isinstance(stepper, AdaptiveStepper):
        stepper = replace(stepper, checkpoints=checkpoints)
    programs, stepper = placed_on_devices(
        (compiled.programs, stepper), scene, compiled.program
    )
    return Plan(
        scene=scene,
        compiled=replace(compiled, programs=programs),
        intervals=intervals,
        save_times=saves,
        stable_step=choice.stable_step,
        solver=solver,
        stepper=stepper,
        solver_reason=choice.reason,
        checkpoints=checkpoints,
        control=choice.control,
    )


class _Choice(NamedTuple):
    """The solver of a run, and the scene compiled for it."""

    solver: AbstractSolver
    reason: str
    """Why this solver was selected."""
    scene: Scene
    """The scene, its bodies arranged as the solver runs fast."""
    compiled: Compiled
    method: Method
    """Kind of steps for which its memory was forecast."""
    stable_step: float | None
    """Largest stable explicit step [s]; None if it is traced."""
    control: ErrorControl | None
    """Error that the run is repeated for; None for a run of one pass."""
    note: str | None
    """Note for the receipt."""


def _compiled_for(
    solver: AbstractSolver,
    scene: Scene,
    saves: tuple[float, ...],
    prune: bool,
    control_error: bool,
) -> _Choice:
    """Compile a scene for its solver, or for the one that error control selects."""
    end = saves[-1]
    compiled_with: AbstractSolver = ForwardEuler()
    if not isinstance(solver, ErrorControl):
        compiled_with = solver
    arranged = compiled_with.arranged(scene)

    def compile_arranged(arranged: Scene, solver: AbstractSolver) -> Compiled:
        return compile_scene(
            arranged,
            saves=len(saves),
            end=end,
            prune=prune,
            method=solver.method,
            save_times=saves,
        )

    compiled = compile_arranged(arranged, compiled_with)
    limit = compiled.stable_step
    stable_step = None if is_traced(limit) else float(limit)
    choice = _Choice(
        solver=solver,
        reason="as given",
        scene=arranged,
        compiled=compiled,
        method=compiled_with.method,
        stable_step=stable_step,
        control=None,
        note=None,
    )
    if not isinstance(solver, ErrorControl):
        return choice
    if control_error and end > 0:
        # To repeat a run until a condition holds takes known numbers.
        if scene.is_traced or is_traced(compiled):
            note = _NOT_ESTIMATED
            choice = choice._replace(note=note)
        else:
            choice = choice._replace(control=solver)
    # The selection needs the stable step, and so a compiled scene; an implicit solver
    # arranges the bodies differently, which takes a second compilation.
    selected, reason = _selected(
        choice.control, program=compiled.program, stable_step=stable_step, t1=end
    )
    choice = choice._replace(solver=selected, reason=reason)
    arranged = selected.arranged(scene)
    if arranged is scene:
        return choice
    return choice._replace(
        scene=arranged,
        compiled=compile_arranged(arranged, selected),
        method=selected.method,
    )


def _stepper(choice: _Choice, longest: float) -> AbstractStepper:
    """Return the stepper of a run whose longest step is known [s]."""
    if choice.control is not None and isinstance(choice.solver, SuperTimeStepping):
        dtype = choice.compiled.receipt.dtype

        def stepper_of(stage_part: StagePart) -> RKL2Stepper:
            # All passes, each with steps half as long, run in one program.
            return RKL2Stepper(stage_part.stages).for_any_step(
                stage_part.stable_step, dtype
            )

        return in_parts(choice.compiled, longest, stepper_of)
    return choice.solver.stepper(
        choice.scene,
        compiled=choice.compiled,
        stable_step=choice.stable_step,
        max_dt=longest,
        traced=choice.scene.is_traced,
    )


def checkpoint_count(reverse_memory: int | None, compiled: Compiled) -> int | None:
    """Return the number of states that fit into the memory; None for all."""
    if reverse_memory is None:
        return None
    values = sum(math.prod(shape) for shape in compiled.state_shapes)
    size = values * jnp.dtype(compiled.receipt.dtype).itemsize
    checkpoints = reverse_memory // size
    if checkpoints < 1:
        raise InputError(
            f"simulate: reverse_memory={reverse_memory} bytes is less than one state "
            f"of {size} bytes; give more memory, or leave it out to store every state"
        )
    return checkpoints


def without_searches(plan: Plan) -> Plan:
    """Return a plan whose receipt lists no searches in geometry."""
    receipt = replace(plan.compiled.receipt, searches=())
    return plan._replace(compiled=replace(plan.compiled, receipt=receipt))


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


def with_note(compiled: Compiled, note: str) -> Compiled:
    """Return a compiled scene with one more note in its receipt."""
    receipt = compiled.receipt
    return replace(compiled, receipt=replace(receipt, notes=(*receipt.notes, note)))


def with_limiting_body(compiled: Compiled, scene: Scene) -> Compiled:
    """Return a compiled scene with the body that limits its steps in the receipt."""
    limit = float(compiled.stable_step)
    if len(scene.bodies) == 1 or math.isinf(limit):
        return compiled
    body = body_labels(scene)[int(compiled.stable_rates.stiffest_body)]
    return with_note(compiled, f"the stable step, {limit:.3g} s, is that of {body}")


def initial_state(plan: Plan) -> RunState:
    """Return the state at time 0, in arrays of its own, which a run may overwrite."""
    entries = len(plan.compiled.program.entries)
    state = RunState(plan.compiled.state, empty_ledger(entries, plan.dtype))
    return plan.stepper.begin(state)


def window_of(interval: Interval, dtype: Any) -> Window:
    """Return the window of an interval, from whose start its steps count time."""
    length = np.asarray(interval.end - interval.start)
    return Window(
        start=device_array(split_times(interval.start), dtype),
        length=device_array(length, dtype),
    )


def observation_time(plan: Plan, interval: Interval) -> float:
    """Return the time of the loads with which the surface is observed at the end.

    It counts from the start of the interval [s], in whose window a load that is
    switched at its end is as it was before.
    """
    before_end = (1 - plan.solver.load_fraction) * interval.dt
    return interval.end - interval.start - before_end


class StepTable(NamedTuple):
    """Steps as arrays: one row per save interval, one column per interval in it.

    An argument of the compiled program, so that one program serves every schedule.
    Unused columns have 0 steps.
    """

    start: Float[Any, "rows columns 2"]
    """Start of each interval as a rounded time and the remainder [s]."""
    dt: Float[Any, "rows columns"]
    """Length of its steps [s]."""
    steps: Int[Any, "rows columns"]
    """Number of steps of each interval."""
    observation_time: Float[Any, " rows"]
    """Time of the loads with which the surface is observed after each row, from the
    start of its last interval with steps [s]."""


def step_table(
    plan: Plan,
    groups: tuple[tuple[Interval, ...], ...] | None = None,
    min_rows: int = 0,
    min_columns: int = 0,
) -> StepTable:
    """Tabulate the steps of save intervals, of at least the given shape.

    `groups` are the save intervals; None for all those of the plan.
    """
    if groups is None:
        groups = save_intervals(plan.intervals)
    rows = max(len(groups), min_rows)
    columns = max(min_columns, *(len(group) for group in groups))
    table = np.zeros((3, rows, columns))
    observed = np.zeros(rows)
    for row, group in enumerate(groups):
        steps = [(i.start, i.dt, i.steps) for i in group]
        table[:, row, : len(group)] = np.transpose(steps)
        observed[row] = observation_time(plan, group[-1])
    # Computed in float64 on the host, rounded once.
    return StepTable(
        start=np.moveaxis(split_times(table[0]), 0, -1).astype(plan.dtype),
        dt=table[1].astype(plan.dtype),
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
    pairs = [(program, narrowed(groups)) for program, groups in program_groups(plan)]
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
