"""`steady`: what a scene comes to when nothing changes any more.

    sum_j G_ij (T_j - T_i) + loads_i(T_i) = 0  [W] at every node,

by Newton's method, each step of it a linear solve that multigrid preconditions. There
is no step to measure a residual by, so both are done when they would move no node any
more: the preconditioner is close to the inverse, and its corrections to the error.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...arrays import is_traced, precision
from ...errors import InputError
from ...scene.compile.compile import compile_scene
from ...scene.compile.program import Program, State
from ...scene.motion import Motion
from ...scene.scene import Scene
from ..implicit.conjugate_gradient import ConjugateGradient, CorrectionNorm, max_abs
from ..implicit.context import ImplicitContext, arranged_for_solves, implicit_context
from ..implicit.jacobian import linearize
from ..implicit.newton_stage import (
    SolverStatistics,
    derivative_solver,
    solve_linear,
    stop_gradient,
    zero_statistics,
)
from ..implicit.residual import rates
from ..run.ledger import empty_ledger, steady_heat_rates
from ..run.observe import observe
from ..run.solution import (
    RunSummary,
    SteadySolution,
    float64_as_numpy,
    raise_failure,
    run_result,
)
from ..stepper import RunState
from .isolated_components import (
    IsolatedComponents,
    ProjectedPreconditioner,
    find_isolated_components,
)


STEADY_TOLERANCE = {"float32": 1e-3, "float64": 1e-8}
"""How far a node may still be from its end, by default [K]."""

MOST_NEWTON = 100
"""Steps: what bodies radiate to each other settles one reflection a step."""


SETTLING = 10
"""Steps in which a nonlinear scene may move farther than in the one before."""


class _Iterate(NamedTuple):
    states: State
    moved: Float[Array, ""]
    """By the last step, at most [K]."""
    before: Float[Array, ""]
    """By the one before it."""
    statistics: SolverStatistics


@eqx.filter_jit
def _settle(
    program: Program,
    own: ImplicitContext,
    start: State,
    time: Float[Array, ""],
    islands: IsolatedComponents | None,
) -> tuple[State, SolverStatistics]:
    """Newton's method from `start`, with the derivative of where it ends."""
    still, fixed_context, begin, moment = stop_gradient((program, own, start, time))
    states, statistics = _newton(still, fixed_context, begin, moment, islands)
    if not own.differentiable:
        return states, statistics
    change = rates(program, states, time).change
    none = jax.tree.map(lambda f: f - jax.lax.stop_gradient(f), change)
    at = _linear(still, fixed_context, stop_gradient(states), moment, None)
    solver = replace(derivative_solver(states), norm=CorrectionNorm())
    moved, _ = solve_linear(at, _watts(none, at), solver)
    return jax.tree.map(jnp.add, states, moved), statistics


def _linear(
    program,
    own: ImplicitContext,
    states: State,
    time,
    islands: IsolatedComponents | None,
):
    rate = jnp.zeros((), states[0].dtype)
    if islands is None:
        return linearize(program, own, states, rate, time)
    at = linearize(program, own, states, rate, time, islands.regularization)
    return at._replace(
        preconditioner=ProjectedPreconditioner(at.preconditioner, islands)
    )


def _watts(change: State, at) -> State:
    return jax.tree.map(jnp.multiply, change, at.capacity)


def _newton(
    program,
    own: ImplicitContext,
    start: State,
    time,
    islands: IsolatedComponents | None,
):
    dtype = start[0].dtype
    same = lambda states: states
    settled = same if islands is None else islands.settled
    balanced = same if islands is None else islands.balanced
    endless = jnp.asarray(jnp.inf, dtype)

    def iterate(now: _Iterate) -> _Iterate:
        at = _linear(program, own, now.states, time, islands)
        heat = balanced(_watts(rates(program, now.states, time).change, at))
        solver = ConjugateGradient(CorrectionNorm(), own.tolerance)
        change, (reached, stats) = solve_linear(at, heat, solver)
        after = jax.tree.map(jnp.add, now.states, change)
        if not own.linear:
            after = jax.tree.map(jnp.minimum, after, own.ceilings)
        after = settled(after)
        moved = max_abs(jax.tree.map(jnp.subtract, after, now.states))
        spent = replace(
            now.statistics,
            linear_failed=~reached,
            largest_linear_residual=stats["residual"],
        )
        one = replace(
            zero_statistics(dtype),
            newton_iterations=jnp.ones((), jnp.int32),
            linear_iterations=stats["iterations"],
        )
        return _Iterate(after, moved, now.moved, spent.plus(one))

    def goes_on(now: _Iterate) -> Bool[Array, ""]:
        # In a linear scene later steps only take back what rounding has left.
        steps = now.statistics.newton_iterations
        stalled = (now.moved >= now.before) & (own.linear | (steps >= SETTLING))
        return (
            (now.moved > own.tolerance)
            & ~stalled
            & (steps < MOST_NEWTON)
            & jnp.isfinite(now.moved)
        ) | (steps == 0)

    first = _Iterate(start, endless, endless, zero_statistics(dtype))
    last = jax.lax.while_loop(goes_on, iterate, first)
    # Less than a last digit moves nothing, and is not reached by that.
    digit = jnp.finfo(dtype).eps * max_abs(last.states)
    failed = ~(jnp.maximum(last.moved, digit) <= own.tolerance)
    return last.states, replace(
        last.statistics,
        linear_failed=last.statistics.linear_failed | (failed & own.linear),
        newton_failed=failed & (not own.linear),
    )


def steady(
    scene: Scene,
    *,
    at: float | None = None,
    tolerance: float | None = None,
    throw: bool = True,
) -> SteadySolution:
    """Temperatures at which a scene stays, where all its heat goes out again.

    It may be jitted, mapped or differentiated with respect to anything in the scene
    that is a number, by the implicit function theorem. A part that exchanges heat with
    nothing keeps the mean that it starts with.

    Args:
        scene: bodies and terms; Newton's method starts at the bodies' temperatures.
        at: the moment whose poses and values are taken to last [s]; needed where
            something varies with time.
        tolerance: how far a node may still be from its end [K]; None for 1e-3 K in
            float32 and 1e-8 K in float64.
        throw: whether a solve that failed raises instead of saying so in `result`.

    Raises:
        InputError: where something varies with time and `at` is not given, or where
            heat comes to a part that nothing cools, so that there is no steady state.
        RuntimeError: if the solve did not converge and `throw` is set.
    """
    if tolerance is not None and not tolerance > 0:
        raise InputError(f"steady(tolerance={tolerance!r}): give a positive one [K]")
    with precision(scene.dtype):
        solution = _solution(_standing(scene, at), at or 0.0, tolerance)
    if throw and not is_traced(solution.result):
        raise_failure(solution.result)
    return float64_as_numpy(solution)


def _solution(scene: Scene, at: float, tolerance: float | None) -> SteadySolution:
    """Of a scene in which nothing moves, loaded as at a moment [s]."""
    scene = arranged_for_solves(scene)
    compiled, traced = compile_scene(scene, 1, at), is_traced(scene)
    program, dtype = compiled.program, jnp.dtype(scene.dtype)
    aim = STEADY_TOLERANCE[scene.dtype] if tolerance is None else tolerance
    own = implicit_context(scene, compiled, math.inf, aim, traced)
    time = jnp.asarray(at, dtype)
    islands = None
    if not traced:
        islands = find_isolated_components(scene, program, own, compiled.state, time)
    states, statistics = _settle(program, own, compiled.state, time, islands)
    entries = len(program.entries)
    seen = observe(program, RunState(states, empty_ledger(entries, dtype)), time)
    brought = rates(program, states, time).entries
    return SteadySolution(
        times=time[None],
        surface_temperature=seen.surface_temperature[None],
        mean_temperature=seen.mean_temperature[None],
        heat_rates=steady_heat_rates(program.entries, brought, len(scene.bodies)),
        isolated_components=0 if islands is None else islands.count,
        result=run_result(seen.is_finite, seen.is_physical, statistics),
        run=RunSummary(
            steps=0,
            dt=None,
            stable_step=compiled.receipt.stable_step_s,
            solver="steady",
            statistics=statistics,
        ),
        surfaces=compiled.surfaces,
        terms=scene.terms,
        receipt=compiled.receipt,
    )


def _standing(scene: Scene, at: float | None) -> Scene:
    """A scene in which nothing moves."""
    varies = any(callable(value) for term in scene.terms for value in term.values)
    moves = any(term.moves for term in scene.terms) or any(
        isinstance(body.pose, Motion) for body in scene.bodies
    )
    if at is None and (varies or moves):
        raise InputError(
            "steady: the scene varies with time; say at which moment it is held, as in "
            "steady(scene, at=0.0)"
        )
    if not moves:
        return scene
    moment = 0.0 if at is None else at
    bodies = tuple(replace(b, pose=b.pose.at(moment)) for b in scene.bodies)
    return replace(scene, bodies=bodies, terms=tuple(t.at(moment) for t in scene.terms))
