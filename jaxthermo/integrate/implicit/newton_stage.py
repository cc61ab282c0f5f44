"""One implicit stage: eta = base + g f(eta), by Newton's method in all nodes at once.

The balances at the surfaces are convex in the temperatures, so that Newton's iterates
decrease to the solution without overshoot once one of them is above it; the upper bound
of the maximum principle keeps the first one from going far beyond. A linear scene takes
one iteration.

Derivatives are those of the solution, by the implicit function theorem, whatever the
iterations: one more solve at the solution, of a right-hand side whose value is 0.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int

from ...module import Module, as_pytree
from ...network.network import inverse
from ...scene.compile.program import Program, State
from ..run.heat_rates import evaluate_rates
from .conjugate_gradient import BiCGStab, ConjugateGradient, ResidualNorm, max_abs
from .jacobian import ImplicitContext, Linearization, linearize, masked_to_nodes


_MAX_NEWTON_ITERATIONS = 20

_DERIVATIVE_TOLERANCE = 1e-6
"""Tolerance relative to the right-hand side; in float32 20 roundings, if more."""


class SolverStatistics(Module):
    """Cost and failures of an implicit solver since the start of the run."""

    newton_iterations: Int[Array, ""]
    linear_iterations: Int[Array, ""]
    accepted_steps: Int[Array, ""]
    """Steps under error control."""
    rejected_steps: Int[Array, ""]
    """Steps under error control that were repeated shorter."""
    largest_linear_residual: Float[Array, ""]
    """Largest final residual of a linear solve over capacity, or its correction where
    the residual is rounding [K]."""
    linear_failed: Bool[Array, ""]
    newton_failed: Bool[Array, ""]
    step_limit_reached: Bool[Array, ""]
    """True if the error control gave up on an interval."""

    def plus(self, other: "SolverStatistics") -> "SolverStatistics":
        """Return the statistics of two parts of a run together."""

        # Counts add up, failures stay, and residuals are compared.
        def combine(a: Array, b: Array) -> Array:
            if jnp.issubdtype(a.dtype, jnp.floating):
                return jnp.maximum(a, b)
            return a | b if a.dtype == bool else a + b

        return jax.tree.map(combine, self, other)

    def after_solve(self, converged, solve: dict[str, Any]) -> "SolverStatistics":
        """Count a Newton iteration by the outcome of its linear solve."""
        # Only the last solve of a stage counts: earlier ones need not be exact.
        return replace(
            self,
            newton_iterations=self.newton_iterations + 1,
            linear_iterations=self.linear_iterations + solve["iterations"],
            largest_linear_residual=solve["residual"],
            linear_failed=~converged,
        )


def zero_statistics(dtype) -> SolverStatistics:
    """Return the statistics of a run that has not started."""
    none, no = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    return SolverStatistics(
        newton_iterations=none,
        linear_iterations=none,
        accepted_steps=none,
        rejected_steps=none,
        largest_linear_residual=jnp.zeros((), dtype),
        linear_failed=no,
        newton_failed=no,
        step_limit_reached=no,
    )


class _Iterate(NamedTuple):
    states: State
    residual: State
    """[K]"""
    entries: Float[Array, " c"]
    """Heat rate of each ledger entry [W]."""
    change: Float[Array, ""]
    """Largest change of a node by the last iteration [K]."""
    statistics: SolverStatistics


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
    found = _newton(*constants)
    if not context.differentiable:
        return found
    # The residual less its own value is 0, with the derivative of the residual.
    residual, _ = _residual(program, base=base, g=g, time=time, states=found.states)
    zero = jax.tree.map(lambda r: r - jax.lax.stop_gradient(r), residual)
    fixed_program, context, _, fixed_g, fixed_time, _ = constants
    states, rate = stop_gradient(found.states), 1 / fixed_g
    at = linearize(
        fixed_program, context=context, states=states, rate=rate, time=fixed_time
    )
    heat = missing_heat(zero, at, rate)
    change, _ = solve_linear(at, heat, derivative_solver(states))
    states = jax.tree.map(jnp.add, found.states, change)
    _, entries = evaluate_rates(program, states, time)
    return found._replace(states=states, entries=entries)


def stop_gradient(tree: Any) -> Any:
    """Return a pytree whose arrays carry no derivatives."""
    stop = lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x
    return jax.tree.map(stop, tree)


def _residual(program, base, g, time, states) -> tuple[State, Float[Array, " c"]]:
    # eta - base - g f(eta) [K], and the heat rates of the ledger [W].
    change, entries = evaluate_rates(program, states, time)
    residual = lambda e, b, f: (e - b) - g * f
    return jax.tree.map(residual, states, base, change), entries


def kelvin_norm(at: Linearization, g: Float[Array, ""]) -> ResidualNorm:
    """Return a norm of residuals [W] in the kelvin that they change in a step."""
    return ResidualNorm(tuple(g * inverse(c) for c in at.capacity))


def solve_linear(
    at: Linearization, heat: State, solver: ConjugateGradient
) -> tuple[State, Any]:
    """Return the change of the states for a heat rate, and the solve's statistics."""
    # The transposed solve of reverse mode may have values where there is no node.
    heat = masked_to_nodes(heat, at.nodes)
    shapes = jax.eval_shape(lambda: heat)
    if at.operator.is_symmetric:
        method, tags = solver, lx.positive_semidefinite_tag
    else:
        method, tags = BiCGStab(**vars(solver)), ()
    operator = lx.FunctionLinearOperator(as_pytree(at.operator.mv), shapes, tags)
    options = {
        "preconditioner": at.preconditioner,
        "magnitude": as_pytree(at.operator.magnitude),
    }
    found = lx.linear_solve(operator, heat, method, options=options, throw=False)
    potential = masked_to_nodes(found.value, at.nodes)
    change = tuple(
        u if d is None else u * inverse(d)
        for u, d in zip(potential, at.potential_slopes, strict=True)
    )
    return change, (found.result == lx.RESULTS.successful, found.stats)


def missing_heat(residual: State, at: Linearization, rate: Float[Array, ""]) -> State:
    """Return the heat rate that removes a residual [K] at a rate of 1 / step [W]."""
    return jax.tree.map(lambda v, c: -v * (c * rate), residual, at.capacity)


def _newton(program, context: ImplicitContext, base, g, time, guess) -> _Iterate:
    dtype = guess[0].dtype
    # A stage may start above every bound, where its explicit part overshot.
    highest = lambda c, b: jnp.maximum(c, b.max())
    ceilings = jax.tree.map(highest, context.ceilings, base)

    def iterate(now: _Iterate) -> _Iterate:
        at = linearize(
            program, context=context, states=now.states, rate=1 / g, time=time
        )
        solver = ConjugateGradient(
            kelvin_norm(at, g), context.tolerance, rounding=context.above_rounding
        )
        heat = missing_heat(now.residual, at, 1 / g)
        change, (converged, solve) = solve_linear(at, heat, solver)
        after = jax.tree.map(jnp.add, now.states, change)
        if not context.linear:
            after = jax.tree.map(jnp.minimum, after, ceilings)
        size = max_abs(jax.tree.map(jnp.subtract, after, now.states))
        residual = _residual(program, base=base, g=g, time=time, states=after)
        statistics = now.statistics.after_solve(converged, solve)
        return _Iterate(after, *residual, size, statistics)

    residual = _residual(program, base=base, g=g, time=time, states=guess)
    endless = jnp.asarray(jnp.inf, dtype)
    now = _Iterate(guess, *residual, endless, zero_statistics(dtype))
    if context.linear:
        return iterate(now)
    # Relative to the solution: a stage may end thousands of kelvin from its start.
    rounding = lambda i: 8 * jnp.finfo(dtype).eps * (1 + max_abs((base, i.states)))
    # At least once: steps that change less than the tolerance would add up to nothing.
    unfinished = lambda i: (
        (i.statistics.newton_iterations < 1)
        | ((max_abs(i.residual) > context.tolerance) & (i.change > rounding(i)))
    )
    allowed = lambda i: i.statistics.newton_iterations < _MAX_NEWTON_ITERATIONS
    now = jax.lax.while_loop(lambda i: unfinished(i) & allowed(i), iterate, now)
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
