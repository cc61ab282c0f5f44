"""One implicit stage: eta = base + g f(eta), by Newton's method in all nodes at once.

The balances at the surfaces are convex in the temperatures, so that Newton's iterates
decrease to the solution without overshoot once one of them is above it; the upper bound
of the maximum principle keeps the first one from going far beyond. A linear scene takes
one iteration.

Derivatives are those of the solution, by the implicit function theorem, whatever the
iterations: one more solve at the solution, of a right-hand side whose value is 0.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int

from ...arrays import stop_gradient
from ...network.network import inverse
from ...scene.compile.program import Program, State
from ..heat_rates import evaluate_rates
from ..solver_statistics import SolverStatistics, zero_statistics
from .conjugate_gradient import BiCGStab, ConjugateGradient, ResidualNorm, max_abs
from .jacobian import ImplicitContext, Linearization, linearize, masked_to_nodes


_MAX_NEWTON_ITERATIONS = 20

_SHORTEST_STEP = 1 / 64
"""Fraction of a step of Newton's method that is taken whether it improves or not."""

_DERIVATIVE_TOLERANCE = 1e-6
"""Tolerance relative to the right-hand side; in float32 20 roundings, if more."""


class _Iterate(NamedTuple):
    states: State
    residual: State
    """[K]"""
    entries: Float[Array, " c"]
    """Heat rate of each ledger entry [W]."""
    change: Float[Array, ""]
    """Largest change of a node by the last iteration [K]."""
    statistics: SolverStatistics


class _Evaluated(NamedTuple):
    """States at the end of a step of Newton's method, with their balance."""

    states: State
    residual: State
    """[K]"""
    entries: Float[Array, " c"]
    """Heat rate of each ledger entry [W]."""


class Shortened(NamedTuple):
    """Outcome of a step of Newton's method."""

    end: Any
    """States and their balance."""
    size: Float[Array, ""]
    """Largest change of a node by the whole step [K]."""
    is_shortened: Bool[Array, ""]


def shortened(
    advanced: Callable[[Float[Array, ""]], Any],
    end: Any,
    norm: Callable[[Any], Float[Array, ""]],
    before: Any,
    tolerance: Float[Array, ""],
) -> "Shortened":
    """Return the end of the longest step that reduces the norm of the balance.

    `advanced` takes a fraction of a whole step, which leads from `before` to `end`; the
    step is halved a few times. A direction of Newton's method reduces every norm. A
    step that changes no more than `tolerance` [K] is taken, since rounding decides.
    """
    start = norm(before)
    size = max_abs(jax.tree.map(jnp.subtract, end.states, before.states))

    def is_worse(trial: tuple[Float[Array, ""], Any]) -> Bool[Array, ""]:
        fraction, end = trial
        is_long = (fraction > _SHORTEST_STEP) & (size > tolerance)
        return ~(norm(end) < start) & is_long

    def halve(trial: tuple[Float[Array, ""], Any]) -> tuple[Float[Array, ""], Any]:
        fraction = trial[0] / 2
        return fraction, advanced(fraction)

    fraction, end = jax.lax.while_loop(is_worse, halve, (jnp.ones_like(start), end))
    return Shortened(end, size, fraction < 1)


def solve_stage(
    program: Program,
    context: ImplicitContext,
    base: State,
    g: Float[Array, ""],
    time: Float[Array, ""],
    guess: State,
) -> _Iterate:
    """Solve eta = base + g f(eta)."""
    constants = stop_gradient((program, context, base, g, time, guess))
    solution = _newton(*constants)
    if not context.differentiable:
        return solution
    # The residual less its own value is 0, with the derivative of the residual.
    residual, _ = _residual(program, base=base, g=g, time=time, states=solution.states)
    zero = jax.tree.map(lambda r: r - jax.lax.stop_gradient(r), residual)
    fixed_program, context, _, fixed_g, fixed_time, _ = constants
    states = stop_gradient(solution.states)
    rate = 1 / fixed_g
    at = linearize(
        fixed_program, context=context, states=states, rate=rate, time=fixed_time
    )
    heat = missing_heat(zero, at, rate)
    solve = solve_linear(at, heat, derivative_solver(states))
    states = jax.tree.map(jnp.add, solution.states, solve.change)
    _, entries = evaluate_rates(program, states, time)
    return solution._replace(states=states, entries=entries)


def _residual(program, base, g, time, states) -> tuple[State, Float[Array, " c"]]:
    # eta - base - g f(eta) [K], and the heat rates of the ledger [W].
    change, entries = evaluate_rates(program, states, time)
    residual = jax.tree.map(lambda e, b, f: (e - b) - g * f, states, base, change)
    return residual, entries


def kelvin_norm(at: Linearization, g: Float[Array, ""]) -> ResidualNorm:
    """Return a norm of residuals [W] in the kelvin that they change in a step."""
    return ResidualNorm(tuple(g * inverse(c) for c in at.capacity))


class LinearSolve(NamedTuple):
    """Outcome of a linear solve."""

    change: State
    """Change of the states [K]."""
    potential: State
    """Change of the conducted potential [K]."""
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    """Final norm, in the unit of the solver's tolerance."""


def after_solve(statistics: SolverStatistics, solve: LinearSolve) -> SolverStatistics:
    """Count a Newton iteration by the outcome of its linear solve."""
    # Only the last solve of a stage counts: earlier ones need not be exact.
    return replace(
        statistics,
        newton_iterations=statistics.newton_iterations + 1,
        linear_iterations=statistics.linear_iterations + solve.iterations,
        largest_linear_residual=solve.residual,
        linear_failed=~solve.converged,
    )


def solve_linear(
    at: Linearization, heat: State, solver: ConjugateGradient
) -> LinearSolve:
    """Find the change of the states for a heat rate."""
    # The transposed solve of reverse mode may have values where there is no node.
    heat = masked_to_nodes(heat, at.nodes)
    shapes = jax.eval_shape(lambda: heat)
    if at.operator.is_symmetric:
        method = solver
        tags = lx.positive_semidefinite_tag
    else:
        method = BiCGStab(**vars(solver))
        tags = ()
    operator = lx.FunctionLinearOperator(at.operator.mv, shapes, tags)
    options = {
        "preconditioner": at.preconditioner,
        "magnitude": at.operator.magnitude,
    }
    solution = lx.linear_solve(operator, heat, method, options=options, throw=False)
    potential = masked_to_nodes(solution.value, at.nodes)
    change = tuple(
        u if d is None else u * inverse(d)
        for u, d in zip(potential, at.potential_slopes, strict=True)
    )
    return LinearSolve(
        change=change,
        potential=potential,
        converged=solution.result == lx.RESULTS.successful,
        iterations=solution.stats["iterations"],
        residual=solution.stats["residual"],
    )


def moved(
    program: Program, states: State, potential: State, rate: Float[Array, ""]
) -> State:
    """Return the states after a step of Newton's method in a stage of this rate [1/s].

    The step is a change of the conducted potential [K].
    """
    return tuple(
        body.network.moved(state, change, rate)
        for body, state, change in zip(program.bodies, states, potential, strict=True)
    )


def missing_heat(residual: State, at: Linearization, rate: Float[Array, ""]) -> State:
    """Return the heat rate that removes a residual [K] at a rate of 1 / step [W]."""
    return jax.tree.map(lambda v, c: -v * (c * rate), residual, at.capacity)


def _newton(program, context: ImplicitContext, base, g, time, guess) -> _Iterate:
    dtype = guess[0].dtype
    # A stage may start above every bound, where its explicit part overshot.
    ceilings = jax.tree.map(
        lambda ceiling, start: jnp.maximum(ceiling, start.max()), context.ceilings, base
    )
    floors = jax.tree.map(
        lambda floor, start: jnp.minimum(floor, start.min()), context.floors, base
    )

    def iterate(now: _Iterate) -> _Iterate:
        at = linearize(
            program, context=context, states=now.states, rate=1 / g, time=time
        )
        solver = ConjugateGradient(
            kelvin_norm(at, g), context.tolerance, rounding=context.above_rounding
        )
        heat = missing_heat(now.residual, at, 1 / g)
        solve = solve_linear(at, heat, solver)

        def advanced(fraction: Float[Array, ""] | float) -> _Evaluated:
            step = jax.tree.map(lambda u: fraction * u, solve.potential)
            states = moved(program, now.states, step, 1 / g)
            if not context.linear:
                states = jax.tree.map(jnp.clip, states, floors, ceilings)
            residual, entries = _residual(
                program, base=base, g=g, time=time, states=states
            )
            return _Evaluated(states, residual, entries)

        end = advanced(1.0)
        size = max_abs(jax.tree.map(jnp.subtract, end.states, now.states))
        if context.varies:
            end = shortened(
                advanced,
                end,
                norm=lambda end: max_abs(end.residual),
                before=now,
                tolerance=context.tolerance,
            ).end
        return _Iterate(
            states=end.states,
            residual=end.residual,
            entries=end.entries,
            change=size,
            statistics=after_solve(now.statistics, solve),
        )

    residual, entries = _residual(program, base=base, g=g, time=time, states=guess)
    now = _Iterate(
        states=guess,
        residual=residual,
        entries=entries,
        change=jnp.asarray(jnp.inf, dtype),
        statistics=zero_statistics(dtype),
    )
    if context.linear:
        return iterate(now)

    def rounding(now: _Iterate) -> Float[Array, ""]:
        # Relative to the solution: a stage may end thousands of kelvin from its start.
        return 8 * jnp.finfo(dtype).eps * (1 + max_abs((base, now.states)))

    def unfinished(now: _Iterate) -> Bool[Array, ""]:
        count = now.statistics.newton_iterations
        is_wrong = max_abs(now.residual) > context.tolerance
        # At least once: steps that change less than the tolerance would add up to
        # nothing.
        is_needed = (count < 1) | (is_wrong & (now.change > rounding(now)))
        return is_needed & (count < _MAX_NEWTON_ITERATIONS)

    now = jax.lax.while_loop(unfinished, iterate, now)
    # A residual that no step reduces is rounding; NaN is no convergence.
    converged = (max_abs(now.residual) <= context.tolerance) | (
        now.change <= jnp.maximum(rounding(now), 10 * context.tolerance)
    )
    return now._replace(statistics=replace(now.statistics, newton_failed=~converged))


def derivative_solver(states: State) -> ConjugateGradient:
    """Return a solver for right-hand sides of any unit."""
    eps = float(jnp.finfo(states[0].dtype).eps)
    tolerance = max(_DERIVATIVE_TOLERANCE, 20 * eps)
    return ConjugateGradient(ResidualNorm(1.0), tolerance, relative=True)
