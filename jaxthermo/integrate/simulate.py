"""`simulate`: scene in, solution out; and the same program in segments for the CLI."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..array_types import Scalar
from ..errors import InputError
from ..network.network import precise_sum
from ..physics.values import SAMPLES
from ..precision import precision
from ..scene.compile import compile_scene
from ..scene.program import Compiled, Entry, Program, State
from ..scene.scene import Scene
from ..tracing import is_traced
from .euler import ForwardEuler, RunState, advance
from .ledger import Energy, empty_ledger, energies, in_order
from .observe import Observation, observe
from .schedule import Interval, legs, save_times, schedule
from .solution import RESULTS, Run, Solution


class Plan(NamedTuple):
    """A compiled scene and when it steps: all decisions made, nothing run."""

    compiled: Compiled
    intervals: tuple[Interval, ...]
    saves: tuple[float, ...]
    limit: float | None
    """The stable step [s]; None if it is traced."""

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
    solver: ForwardEuler,
    prune: bool = True,
) -> Plan:
    """Compile a scene and lay out its steps.

    Args:
        scene: bodies and terms.
        t1: end [s].
        save_at: times to keep [s].
        solver: with its step, or the stable one.
        prune: whether what does nothing is left out, see `compile_scene`.

    Raises:
        InputError: for save times out of order, or a step above the stable one.
    """
    saves = save_times(t1, save_at)
    compiled = compile_scene(scene, len(saves), t1, prune)
    limit = compiled.stable_step
    if is_traced(limit):
        if solver.dt is None:
            raise InputError(
                "simulate: the stable step depends on traced values; give the step, "
                "as in solver=ForwardEuler(dt=0.1)"
            )
        dt, known = _positive_step(solver.dt), None
    else:
        dt, known = _checked_step(solver, float(limit)), float(limit)
    if compiled.program.sampled and solver.dt is None and t1 > 0:
        dt = min(dt, t1 / SAMPLES)
    landings = (*compiled.program.knots, *compiled.starts)
    layout = schedule(t1, saves, landings, dt)
    return Plan(compiled, layout, saves, known)


def _positive_step(dt: Scalar) -> float:
    step = float(dt)
    if not step > 0:
        raise InputError(f"solver: dt={step:g} is no step; give a positive time")
    return step


def _checked_step(solver: ForwardEuler, limit: float) -> float:
    if solver.dt is None:
        return limit
    dt = _positive_step(solver.dt)
    if dt > limit * (1 + 1e-6):
        raise InputError(
            f"solver: dt={dt:g} s is too long: the largest stable step of this scene "
            f"is {limit:.6g} s; give that or less, or no dt to have it chosen"
        )
    return dt


def start(plan: Plan) -> RunState:
    """The state at time 0."""
    entries = len(plan.compiled.program.entries)
    return RunState(plan.compiled.state, empty_ledger(entries, plan.dtype))


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
def run_all(program: Program, state: RunState, layout) -> tuple[RunState, Observation]:
    """Every leg, observed at its end; one program for any numbers of steps."""

    def interval(carry, times):
        state, time = carry
        start, dt, steps = times
        # Empty rows of the layout leave the time of the last step as it is.
        time = jnp.where(steps > 0, start + dt * (steps.astype(dt.dtype) - 0.5), time)
        return (advance(program, state, start, dt, steps), time), None

    def leg(state, intervals):
        begin = jnp.zeros((), intervals[0].dtype)
        (state, time), _ = jax.lax.scan(interval, (state, begin), intervals)
        return state, observe(program, state, time)

    return jax.lax.scan(leg, state, layout)


def _run_traced(program: Program, state: RunState, legs_, dtype):
    """The same with fixed lengths, for reverse-mode differentiation."""
    seen = []
    for leg in legs_:
        for i in leg:
            begin, dt = jnp.asarray(i.start, dtype), jnp.asarray(i.dt, dtype)
            state = advance(program, state, begin, dt, i.steps)
        seen.append(observe(program, state, last_load(leg[-1], dtype)))
    return state, jax.tree.map(lambda *each: jnp.stack(each), *seen)


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
    seen = []
    for number, part in parts:
        program, own = plan.compiled.programs[number], legs(part)
        if traced:
            state, found = _run_traced(program, state, own, plan.dtype)
        else:
            layout = layout_table(own, plan.dtype, rows, width)
            state, found = run_all(program, state, layout)
        saved = np.flatnonzero([leg[-1].saved for leg in own])
        seen.append(jax.tree.map(lambda a, kept=saved: a[kept], found))
    return jax.tree.map(lambda *each: jnp.concatenate(each), *seen)


def by_program(plan: Plan) -> list[tuple[int, tuple[Interval, ...]]]:
    """The intervals that each program takes, with its number."""
    number = [plan.compiled.number_at(i.start) for i in plan.intervals]
    return [
        (n, tuple(i for i, m in zip(plan.intervals, number, strict=True) if m == n))
        for n in sorted(set(number))
    ]


def last_load(interval: Interval, dtype: Any) -> Float[Array, ""]:
    """When the loads of an interval's last step were taken [s]."""
    return jnp.asarray(interval.end - interval.dt / 2, dtype)


def layout_table(
    legs_: tuple[tuple[Interval, ...], ...], dtype, rows: int = 0, width: int = 0
):
    """Starts, steps and numbers of steps, a row a leg; the rest takes no step.

    Args:
        legs_: to be taken.
        dtype: of the times.
        rows: least number of rows, for one shape whatever the legs.
        width: least number of intervals in a row.
    """
    shape = max(len(legs_), rows), max(width, *(len(leg) for leg in legs_))
    starts, spans, counts = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int32)
    for row, leg in enumerate(legs_):
        starts[row, : len(leg)] = [i.start for i in leg]
        spans[row, : len(leg)] = [i.dt for i in leg]
        counts[row, : len(leg)] = [i.steps for i in leg]
    return jnp.asarray(starts, dtype), jnp.asarray(spans, dtype), jnp.asarray(counts)


@eqx.filter_jit
def _balance(
    entries: tuple[Entry, ...],
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
    result = RESULTS.where(
        at.finite.all(),
        RESULTS.where(at.possible.all(), RESULTS.successful, RESULTS.below_zero),
        RESULTS.nonfinite,
    )
    return Solution(
        times=jnp.asarray(plan.saves, energy.stored_J.dtype),
        surface_temperature=at.surface,
        mean_temperature=at.mean,
        energy=in_order(energy, entries),
        result=result,
        run=Run(
            steps=plan.steps,
            dt=max((i.dt for i in plan.intervals), default=None),
            stable_step=plan.limit,
        ),
        surfaces=plan.compiled.surfaces,
        terms=scene.terms,
        receipt=plan.compiled.receipt,
    )


def solve(scene: Scene, todo: Plan) -> Solution:
    """A planned run, from its start to its solution."""
    seen = run(todo, start(todo), is_traced(scene)) if todo.intervals else None
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
    even = imbalance(program, state.theta, uneven_nodes(scene))
    nothing = jax.tree.map(lambda a: a[None][:0], first)
    rows = nothing if seen is None else seen
    return assemble_solution(scene, todo, first, rows, even)


def simulate(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    solver: ForwardEuler | None = None,
    throw: bool = True,
) -> Solution:
    """Temperatures of a scene's surface up to `t1`.

    One jitted program. It may itself be jitted, mapped or differentiated with respect
    to anything in the scene that is a number; then give the step in `solver`, and keep
    the runs short, since reverse mode stores every step.

    Args:
        scene: bodies and terms.
        t1: end [s].
        save_at: increasing times to keep [s]; the end if not given.
        solver: explicit Euler at the stable step if not given.
        throw: whether a run that failed raises instead of saying so in `result`.

    Raises:
        InputError: for times out of order, a step above the stable one, or too little
            memory.
        RuntimeError: if temperatures stop being finite and `throw` is set.
    """
    with precision(scene.dtype):
        todo = plan(scene, t1, save_at, solver or ForwardEuler())
        solution = solve(scene, todo)
    if throw and not is_traced(solution.result):
        raise_failure(solution.result)
    if jnp.result_type(float) == jnp.float64 or is_traced(solution):
        return solution
    return _keeping_digits(solution)


def _keeping_digits(solution: Solution) -> Solution:
    """A solution with its float64 in numpy arrays.

    Where JAX is not set to 64 bits it warns at every use of its own, and rounds.
    """
    double = lambda leaf: isinstance(leaf, jax.Array) and leaf.dtype == jnp.float64
    keep = lambda leaf: np.asarray(leaf) if double(leaf) else leaf
    return jax.tree.map(keep, solution)


def raise_failure(result: RESULTS) -> None:
    """Raise what went wrong, with its remedy, unless nothing did."""
    if result != RESULTS.successful:
        raise RuntimeError(RESULTS[result])


def uneven_nodes(scene: Scene) -> list:
    """Addresses of the nodes of each body that does not start at one temperature."""
    return [
        tuple(jnp.asarray(index) for index in body.structure.node_address())
        if callable(body.temperature)
        else None
        for body in scene.bodies
    ]
