"""`simulate`: scene in, solution out; and the same program in segments for the CLI."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import is_traced, precision
from ...errors import InputError
from ...network.network import precise_sum
from ...scene.compile.compile import compile_scene
from ...scene.compile.program import Compiled, LedgerEntry, Program, State
from ...scene.scene import Scene
from ..implicit.adaptive import AdaptiveStepper
from ..solver_selection import choose
from ..solvers import AbstractSolver
from .ledger import Energy, empty_ledger, energies, in_order
from .observe import Observation, observe
from .schedule import END_ROUNDINGS, Interval, legs, save_times, schedule
from .solution import Run, Solution, keeping_digits, outcome, raise_failure
from .state import AbstractStepper, RunState
from .time_loop import advance


class Plan(NamedTuple):
    """A compiled scene and when it steps: all decisions made, nothing run."""

    scene: Scene
    """Laid out as the solver runs fast."""
    compiled: Compiled
    intervals: tuple[Interval, ...]
    saves: tuple[float, ...]
    limit: float | None
    """The stable step [s]; None if it is traced."""
    solver: AbstractSolver
    stepper: AbstractStepper
    why: str = "as given"
    """How the solver came to be chosen."""
    checkpoints: int | None = None
    """States that reverse mode keeps; None for all."""

    @property
    def steps(self) -> int:
        """In all."""
        return sum(interval.steps for interval in self.intervals)

    @property
    def dtype(self) -> Any:
        """Of the state."""
        return jnp.dtype(self.compiled.receipt.dtype)


def plan(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None,
    solver: AbstractSolver | None = None,
    prune: bool = True,
    reverse_memory: int | None = None,
) -> Plan:
    """Compile a scene and lay out its steps.

    Args:
        scene: bodies and terms.
        t1: end [s].
        save_at: times to keep [s].
        solver: of the user; None to have one chosen.
        prune: whether what does nothing is left out, see `compile_scene`.
        reverse_memory: for states that reverse mode keeps [bytes].

    Raises:
        InputError: for save times out of order, or a step above the stable one.
    """
    saves = save_times(t1, save_at)
    suited = scene if solver is None else solver.suited(scene)
    compiled = compile_scene(suited, len(saves), t1, prune)
    traced = is_traced(compiled.stable_step)
    known = None if traced else float(compiled.stable_step)
    why = "as given"
    if solver is None:
        solver, why = choose(known, t1)
        suited = solver.suited(scene)
        if suited is not scene:
            compiled = compile_scene(suited, len(saves), t1, prune)
    dt = solver.longest(known, t1, compiled.program.sampled)
    landings = (*compiled.program.breakpoints, *compiled.starts)
    least = solver.least_steps(len({*saves, *landings}))
    layout = schedule(t1, saves, landings, dt, least)
    longest = max((i.dt for i in layout), default=dt)
    stepper = solver.stepper(suited, compiled, longest, is_traced(scene))
    kept = None
    if reverse_memory is not None:
        kept = checkpoints(compiled.state, reverse_memory)
    if isinstance(stepper, AdaptiveStepper):
        stepper = replace(stepper, checkpoints=kept)
    return Plan(suited, compiled, layout, saves, known, solver, stepper, why, kept)


def start(plan: Plan) -> RunState:
    """The state at time 0."""
    entries = len(plan.compiled.program.entries)
    fresh = RunState(plan.compiled.state, empty_ledger(entries, plan.dtype))
    return plan.stepper.begin(fresh)


def imbalance(program: Program, states: State, nodes: list) -> Float[Array, " b"]:
    """Heat that conduction must move to even out each body at the start [J]."""
    found = []
    for body, state, address in zip(program.bodies, states, nodes, strict=True):
        if address is None:
            found.append(jnp.asarray(np.zeros((), state.dtype)))
            continue
        mean = body.network.stored(state) / body.network.total_capacity()
        excess = jnp.abs(state[address] - mean) * body.network.capacity_at(address)
        found.append(precise_sum(excess) / 2)
    return jnp.stack(found)


@eqx.filter_jit
def run_all(
    stepper: AbstractStepper, program: Program, state: RunState, layout
) -> tuple[RunState, Observation]:
    """Every leg, observed at its end; one program for any numbers of steps.

    Args:
        stepper: takes the steps.
        program: of the scene.
        state: at the start.
        layout: of the legs, as `layout_table` makes it.
    """

    def interval(carry, times):
        state, time = carry
        start, dt, steps, read = times
        # Empty rows of the layout leave the time of the last step as it is.
        time = jnp.where(steps > 0, read, time)
        return (advance(stepper, program, state, start, dt, steps), time), None

    def leg(state, intervals):
        begin = jnp.zeros((), intervals[0].dtype)
        (state, time), _ = jax.lax.scan(interval, (state, begin), intervals)
        return state, observe(program, state, time)

    return jax.lax.scan(leg, state, layout)


def _run_traced(plan: Plan, program: Program, state: RunState, legs_):
    """The same with fixed lengths, for reverse-mode differentiation."""
    seen, dtype = [], plan.dtype
    for leg in legs_:
        for i in leg:
            begin, dt = jnp.asarray(i.start, dtype), jnp.asarray(i.dt, dtype)
            state = advance(
                plan.stepper, program, state, begin, dt, i.steps, 0, plan.checkpoints
            )
        seen.append(observe(program, state, last_load(plan, leg[-1])))
    return state, jax.tree.map(lambda *each: jnp.stack(each), *seen)


def checkpoints(state: State, memory: int) -> int:
    """How many states reverse mode may keep.

    Args:
        state: of the run.
        memory: for them [bytes].

    Raises:
        InputError: if not even one fits.
    """
    size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(state))
    if memory < size:
        raise InputError(
            f"simulate: reverse_memory={memory} bytes holds no state, of {size} bytes"
        )
    return memory // size


def run(plan: Plan, state: RunState, traced: bool = False) -> Observation:
    """Everything from the start to the end, observed at the save times.

    Args:
        plan: of the run.
        state: at the start.
        traced: whether it must have fixed lengths, for reverse mode.
    """
    parts = by_program(plan)
    rows = max((len(legs(part)) for _, part in parts), default=0)
    width = max((len(leg) for _, p in parts for leg in legs(p)), default=0)
    seen, rows_saved = [], []
    for number, part in parts:
        program, own = plan.compiled.programs[number], legs(part)
        if traced:
            state, found = _run_traced(plan, program, state, own)
        else:
            layout = layout_table(plan, own, rows, width)
            state, found = run_all(plan.stepper, program, state, layout)
        seen.append(found)
        kept = np.flatnonzero([leg[-1].saved for leg in own])
        rows_saved.append(jnp.asarray(kept))
    if len(seen) == 1 and len(rows_saved[0]) == len(seen[0].finite):
        return seen[0]
    return _saved(tuple(seen), tuple(rows_saved))


@eqx.filter_jit
def _saved(
    seen: tuple[Observation, ...], rows: tuple[Int[Array, " _"], ...]
) -> Observation:
    """The rows of save times, of all parts in turn."""
    picked = [
        jax.tree.map(lambda a, kept=kept: a[kept], found)
        for found, kept in zip(seen, rows, strict=True)
    ]
    return jax.tree.map(lambda *each: jnp.concatenate(each), *picked)


def by_program(plan: Plan) -> list[tuple[int, tuple[Interval, ...]]]:
    """The intervals that each program takes, with its number."""
    number = [plan.compiled.number_at(i.start) for i in plan.intervals]
    return [
        (n, tuple(i for i, m in zip(plan.intervals, number, strict=True) if m == n))
        for n in sorted(set(number))
    ]


def last_load(plan: Plan, interval: Interval) -> Float[Array, ""]:
    """When the surface is read at an interval's end [s]: under its last loads."""
    return jnp.asarray(_read(plan, interval), plan.dtype)


def _read(plan: Plan, interval: Interval) -> float:
    before = (1 - plan.solver.load_time) * interval.dt
    # Told from the end in the run's own precision.
    rounding = END_ROUNDINGS * float(jnp.finfo(plan.dtype).eps) * abs(interval.end)
    return interval.end - max(before, rounding)


def layout_table(
    plan: Plan,
    legs_: tuple[tuple[Interval, ...], ...],
    rows: int = 0,
    width: int = 0,
):
    """Starts, steps, numbers of steps and when to read, a row a leg.

    The rest of the table takes no step.

    Args:
        plan: of the run.
        legs_: to be taken.
        dtype: of the times.
        rows: least number of rows, for one shape whatever the legs.
        width: least number of intervals in a row.
    """
    shape = max(len(legs_), rows), max(width, *(len(leg) for leg in legs_))
    starts, spans, counts = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int32)
    reads = np.zeros(shape)
    for row, leg in enumerate(legs_):
        starts[row, : len(leg)] = [i.start for i in leg]
        spans[row, : len(leg)] = [i.dt for i in leg]
        counts[row, : len(leg)] = [i.steps for i in leg]
        reads[row, : len(leg)] = [_read(plan, i) for i in leg]
    own = lambda values: jnp.asarray(values, plan.dtype)
    return own(starts), own(spans), jnp.asarray(counts), own(reads)


@eqx.filter_jit
def _balance(
    entries: tuple[LedgerEntry, ...],
    first: Observation,
    seen: Observation,
    even: Float[Array, " b"],
    from_start: bool,
) -> tuple[Observation, Energy]:
    """Observations at the save times, and the ledger."""
    at = seen
    if from_start:
        at = jax.tree.map(lambda one, a: jnp.concatenate([one[None], a]), first, at)
    stored = at.stored - first.stored[None]
    return at, energies(entries, stored, at.ledger.heat, at.ledger.moved, even)


def assemble_solution(
    scene: Scene,
    plan: Plan,
    first: Observation,
    seen: Observation,
    even: Float[Array, " b"],
) -> Solution:
    """A `Solution` from the observations at the start and at each leg's end."""
    entries = plan.compiled.program.entries
    at, energy = _balance(entries, first, seen, even, plan.saves[0] == 0.0)
    effort = jax.tree.map(lambda a: a[-1], seen.effort) if len(seen.finite) else None
    return Solution(
        times=jnp.asarray(plan.saves, energy.stored_J.dtype),
        surface_temperature=at.surface,
        mean_temperature=at.mean,
        energy=in_order(energy, entries),
        result=outcome(at.finite.all(), at.possible.all(), effort),
        run=Run(
            steps=plan.steps,
            dt=max((i.dt for i in plan.intervals), default=None),
            stable_step=plan.limit,
            solver=type(plan.solver).__name__,
            effort=effort,
        ),
        surfaces=plan.compiled.surfaces,
        terms=scene.terms,
        receipt=plan.compiled.receipt,
    )


def solve(scene: Scene, todo: Plan) -> Solution:
    """A planned run, from its start to its solution."""
    seen = None
    if todo.intervals:
        seen = run(todo, start(todo), is_traced(scene))
    return conclude(scene, todo, seen)


def conclude(scene: Scene, todo: Plan, seen: Observation | None) -> Solution:
    """What a run comes to.

    Args:
        scene: that was run.
        todo: how.
        seen: at the save times; None if there is nothing but the start.
    """
    program, state = todo.compiled.program, start(todo)
    first = observe(program, state, None)
    even = imbalance(program, state.theta, uneven_nodes(todo.scene))
    nothing = jax.tree.map(lambda a: a[None][:0], first)
    rows = nothing if seen is None else seen
    return assemble_solution(scene, todo, first, rows, even)


def simulate(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    solver: AbstractSolver | None = None,
    throw: bool = True,
    reverse_memory: int | None = None,
) -> Solution:
    """Temperatures of a scene's surface up to `t1`.

    One jitted program. It may itself be jitted, mapped or differentiated with respect
    to anything in the scene that is a number; then give the step in `solver`, and, for
    long runs in reverse mode, a `reverse_memory`.

    Args:
        scene: bodies and terms.
        t1: end [s].
        save_at: increasing times to keep [s]; the end if not given.
        solver: one of `solvers`; chosen from the scene if not given.
        throw: whether a run that failed raises instead of saying so in `result`.
        reverse_memory: for states that reverse mode keeps [bytes]; it takes steps anew
            from the nearest one. None keeps all.

    Raises:
        InputError: for times out of order, a step above the stable one, or too little
            memory.
        RuntimeError: if temperatures stop being finite and `throw` is set.
    """
    with precision(scene.dtype):
        todo = plan(scene, t1, save_at, solver, reverse_memory=reverse_memory)
        solution = solve(scene, todo)
    if throw and not is_traced(solution.result):
        raise_failure(solution.result)
    return keeping_digits(solution)


def uneven_nodes(scene: Scene) -> list:
    """Addresses of the nodes of each body that does not start at one temperature."""
    return [
        tuple(jnp.asarray(index) for index in body.structure.node_address())
        if callable(body.temperature)
        else None
        for body in scene.bodies
    ]
