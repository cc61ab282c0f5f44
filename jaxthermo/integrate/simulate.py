"""`simulate`: scene in, solution out; and the same program in segments for the CLI."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..array_types import Scalar
from ..errors import InputError
from ..network.network import precise_sum
from ..physics.values import SAMPLES
from ..precision import precision
from ..scene.compile import compile_scene
from ..scene.program import Compiled, Program, State
from ..scene.scene import Scene
from ..tracing import is_traced
from .euler import ForwardEuler, RunState, advance, stable_step
from .ledger import Energy, Ledger, empty_ledger
from .schedule import Interval, legs, save_times, schedule
from .solution import RESULTS, Run, Solution


class Observation(NamedTuple):
    """What is kept of a state at a saved time."""

    surface: Float[Array, " s"]
    """[K]"""
    mean: Float[Array, " b"]
    """[K]"""
    stored: Float[Array, ""]
    """Above the references [J]."""
    finite: Bool[Array, ""]
    possible: Bool[Array, ""]
    """Whether no part of the surface is below 0 K, but for rounding."""
    ledger: Ledger


@eqx.filter_jit
def observe(
    program: Program, state: RunState, time: Float[Array, ""] | None
) -> Observation:
    """Surface temperatures, means and energies of a state.

    Args:
        program: what made it.
        state: at some moment.
        time: of the loads that led to it [s], the middle of the last step: a load that
            is switched at that moment is still read as it was. None at the start.
    """
    surface, mean, stored = [], [], []
    for body, theta in zip(program.bodies, state.theta, strict=True):
        here = body.reading.read(theta, time)
        heat = body.network.stored(theta)
        surface.append(body.reference + here)
        mean.append(body.reference + heat / body.network.total_capacity())
        stored.append(heat)
    total, outside = jnp.stack(stored).sum(), jnp.concatenate(surface)
    return Observation(
        surface=outside,
        mean=jnp.stack(mean),
        stored=total,
        finite=jnp.isfinite(total),
        possible=outside.min() > -1e-3,
        ledger=state.ledger,
    )


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
    scene: Scene, t1: float | int, save_at: Sequence[float] | None, solver: ForwardEuler
) -> Plan:
    """Compile a scene and lay out its steps.

    Raises:
        InputError: for save times out of order, or a step above the stable one.
    """
    saves = save_times(t1, save_at)
    compiled = compile_scene(scene, len(saves))
    limit = stable_step(compiled.program, compiled.hottest(t1), t1)
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
    layout = schedule(t1, saves, compiled.program.knots, dt)
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
    mechanisms = len(plan.compiled.program.mechanisms)
    return RunState(plan.compiled.state, empty_ledger(mechanisms, plan.dtype))


def imbalance(program: Program, thetas: State, nodes: list) -> Float[Array, ""]:
    """Heat that conduction must move to even out each body at the start [J]."""
    total = jnp.zeros((), thetas[0].dtype)
    for body, theta, address in zip(program.bodies, thetas, nodes, strict=True):
        if address is None:
            continue
        mean = body.network.stored(theta) / body.network.total_capacity()
        capacity = body.network.capacity()
        capacity = capacity[address] if capacity.ndim else capacity
        excess = jnp.abs(theta[address] - mean) * capacity
        total = total + precise_sum(excess) / 2
    return total


@eqx.filter_jit
def run_all(program: Program, state: RunState, layout) -> Observation:
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

    return jax.lax.scan(leg, state, layout)[1]


def _run_traced(program: Program, state: RunState, legs_, dtype) -> Observation:
    """The same with fixed lengths, for reverse-mode differentiation."""
    seen = []
    for leg in legs_:
        for i in leg:
            begin, dt = jnp.asarray(i.start, dtype), jnp.asarray(i.dt, dtype)
            state = advance(program, state, begin, dt, i.steps)
        seen.append(observe(program, state, last_load(leg[-1], dtype)))
    return jax.tree.map(lambda *each: jnp.stack(each), *seen)


def last_load(interval: Interval, dtype: Any) -> Float[Array, ""]:
    """When the loads of an interval's last step were taken [s]."""
    return jnp.asarray(interval.end - interval.dt / 2, dtype)


def layout_table(legs_: tuple[tuple[Interval, ...], ...], dtype):
    """Starts, steps and numbers of steps, a row a leg; the rest takes no step."""
    shape = len(legs_), max(len(leg) for leg in legs_)
    starts, spans, counts = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int32)
    for row, leg in enumerate(legs_):
        starts[row, : len(leg)] = [i.start for i in leg]
        spans[row, : len(leg)] = [i.dt for i in leg]
        counts[row, : len(leg)] = [i.steps for i in leg]
    return jnp.asarray(starts, dtype), jnp.asarray(spans, dtype), jnp.asarray(counts)


@eqx.filter_jit
def _balance(
    first: Observation,
    seen: Observation,
    even: Float[Array, ""],
    rows: int,
    from_start: bool,
) -> tuple[Observation, Float[Array, " t"], Float[Array, " t"]]:
    """Observations at the save times, heat stored since the start, and residual."""
    at = jax.tree.map(lambda a: a[:rows], seen)
    if from_start:
        at = jax.tree.map(lambda one, a: jnp.concatenate([one[None], a]), first, at)
    stored = at.stored - first.stored
    throughput = at.ledger.moved.sum(axis=1) + even
    error = stored - at.ledger.heat.sum(axis=1)
    return at, stored, error / jnp.where(throughput > 0, throughput, 1)


def assemble_solution(
    scene: Scene,
    plan: Plan,
    first: Observation,
    seen: Observation,
    even: Float[Array, ""],
) -> Solution:
    """A `Solution` from the observations at the start and at each leg's end."""
    rows = sum(interval.saved for interval in plan.intervals)
    at, stored, residual = _balance(first, seen, even, rows, plan.saves[0] == 0.0)
    heat = at.ledger.heat
    names = plan.compiled.program.mechanisms
    result = RESULTS.where(
        at.finite.all(),
        RESULTS.where(at.possible.all(), RESULTS.successful, RESULTS.below_zero),
        RESULTS.nonfinite,
    )
    return Solution(
        times=jnp.asarray(plan.saves, stored.dtype),
        surface_temperature=at.surface,
        mean_temperature=at.mean,
        energy=Energy(
            stored_J=stored,
            mechanisms={name: heat[:, k] for k, name in enumerate(names)},
            residual_relative=residual,
        ),
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
        program, state = todo.compiled.program, start(todo)
        first = observe(program, state, None)
        even = imbalance(program, state.theta, uneven_nodes(scene))
        if not todo.intervals:
            seen = jax.tree.map(lambda a: a[None][:0], first)
        elif is_traced(scene):
            seen = _run_traced(program, state, legs(todo.intervals), todo.dtype)
        else:
            layout = layout_table(legs(todo.intervals), todo.dtype)
            seen = run_all(program, state, layout)
        solution = assemble_solution(scene, todo, first, seen, even)
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
