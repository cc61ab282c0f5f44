"""One implicit stage: eta = base + g f(eta), by Newton's method in all nodes at once.

The balances at the surfaces are convex in the temperatures, so Newton's iterates come
down to the solution without overshooting once one of them is above it; `ceiling`, from
the maximum principle, keeps the first from going far beyond. A linear scene takes one.

Derivatives are those of the solution, by the implicit function theorem, whatever the
iterations: at the solution one more solve, of a right-hand side whose value is 0.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int

from ...network.network import inverse
from ...scene.compile.program import Program, State
from .conjugate_gradient import ConjugateGradient, ResidualNorm, max_abs
from .context import ImplicitContext
from .jacobian import Linearization, linearize, masked_to_nodes
from .residual import rates


MOST_NEWTON = 20
DERIVATIVE_TOLERANCE = 1e-6
"""Of the right-hand side, or some roundings in float32."""


class SolverStatistics(eqx.Module):
    """What a run has cost so far, and what went wrong."""

    newton_iterations: Int[Array, ""]
    """Steps of Newton's method."""
    linear_iterations: Int[Array, ""]
    """Iterations of linear solves."""
    accepted_steps: Int[Array, ""]
    """Steps of a length that the solver chose."""
    rejected_steps: Int[Array, ""]
    """Steps that were taken again, shorter."""
    largest_linear_residual: Float[Array, ""]
    """Largest residual that a linear solve left [K]."""
    linear_failed: Bool[Array, ""]
    newton_failed: Bool[Array, ""]
    step_limit_reached: Bool[Array, ""]
    """Whether the solver gave up shortening its steps."""

    def plus(self, other: "SolverStatistics") -> "SolverStatistics":
        """Both."""
        return SolverStatistics(
            self.newton_iterations + other.newton_iterations,
            self.linear_iterations + other.linear_iterations,
            self.accepted_steps + other.accepted_steps,
            self.rejected_steps + other.rejected_steps,
            jnp.maximum(self.largest_linear_residual, other.largest_linear_residual),
            self.linear_failed | other.linear_failed,
            self.newton_failed | other.newton_failed,
            self.step_limit_reached | other.step_limit_reached,
        )


def zero_statistics(dtype) -> SolverStatistics:
    """Nothing done."""
    none, no = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    return SolverStatistics(none, none, none, none, jnp.zeros((), dtype), no, no, no)


class Stage(NamedTuple):
    """A stage's solution."""

    states: State
    entries: Float[Array, " c"]
    """What each entry of the ledger brings there [W]."""
    statistics: SolverStatistics


def solve_stage(
    program: Program,
    context: ImplicitContext,
    base: State,
    g: Float[Array, ""],
    time: Float[Array, ""],
    guess: State,
) -> Stage:
    """The states with eta = base + g f(eta).

    Args:
        program: of the scene.
        context: for it.
        base: where the stage starts from [K].
        g: its step [s].
        time: of its loads [s].
        guess: of the states.
    """
    fixed = stop_gradient((program, context, base, g, time, guess))
    found = _newton(*fixed)
    if not context.differentiable:
        return Stage(found.states, found.entries, found.statistics)
    states = _differentiable(program, context, base, g, time, found.states, fixed)
    return Stage(states, rates(program, states, time).entries, found.statistics)


def stop_gradient(tree: Any) -> Any:
    """Without derivatives."""
    stop = lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x
    return jax.tree.map(stop, tree)


def _residual(program, base, g, time, states) -> tuple[State, Float[Array, " c"]]:
    """Eta - base - g f(eta) [K], and what each entry of the ledger brings there [W]."""
    change, entries = rates(program, states, time)
    short = lambda e, b, f: (e - b) - g * f
    return jax.tree.map(short, states, base, change), entries


def kelvin_norm(at: Linearization, g: Float[Array, ""]) -> ResidualNorm:
    """A residual [W] as the kelvin that it is worth in a step.

    Args:
        at: where the balance is linear.
        g: the step [s].
    """
    return ResidualNorm(tuple(g * inverse(c) for c in at.capacity))


def solve_linear(
    at: Linearization, heat: State, solver: ConjugateGradient
) -> tuple[State, Any]:
    """The change of the states that brings a heat rate, and the solve's stats.

    Args:
        at: where the balance is linear.
        heat: to be balanced [W].
        solver: and how well.
    """
    # The transposed solve of reverse mode would bring something to where no node is.
    heat = masked_to_nodes(heat, at.nodes)
    shapes = jax.eval_shape(lambda: heat)
    operator = lx.FunctionLinearOperator(
        at.operator.mv, shapes, lx.positive_semidefinite_tag
    )
    options = {"preconditioner": at.preconditioner}
    found = lx.linear_solve(operator, heat, solver, options=options, throw=False)
    change = tuple(
        u if d is None else u * inverse(d)
        for u, d in zip(
            masked_to_nodes(found.value, at.nodes), at.steepness, strict=True
        )
    )
    return change, (found.result == lx.RESULTS.successful, found.stats)


def per_step(values: State, at: Linearization, rate: Float[Array, ""]) -> State:
    """Minus the heat rate that changes states by `values` [K] in a step [W]."""
    return jax.tree.map(lambda v, c: -v * (c * rate), values, at.capacity)


class _Iterate(NamedTuple):
    states: State
    residual: State
    """[K]"""
    entries: Float[Array, " c"]
    """[W]"""
    moved: Float[Array, ""]
    """By the last step, at most [K]."""
    statistics: SolverStatistics


def _newton(program, context: ImplicitContext, base, g, time, guess) -> _Iterate:
    dtype = guess[0].dtype
    # A stage may start from where an explicit part overshot all that bounds the scene.
    ceilings = jax.tree.map(
        lambda c, b: jnp.maximum(c, b.max()), context.ceilings, base
    )

    def iterate(now: _Iterate) -> _Iterate:
        at = linearize(program, context, now.states, 1 / g, time)
        solver = ConjugateGradient(kelvin_norm(at, g), context.tolerance)
        heat = per_step(now.residual, at, 1 / g)
        change, (reached, stats) = solve_linear(at, heat, solver)
        after = jax.tree.map(jnp.add, now.states, change)
        if not context.linear:
            after = jax.tree.map(jnp.minimum, after, ceilings)
        moved = max_abs(jax.tree.map(jnp.subtract, after, now.states))
        # Whether an earlier solve was exact does not matter.
        spent = replace(
            now.statistics,
            linear_failed=~reached,
            largest_linear_residual=stats["residual"],
        )
        one = replace(
            zero_statistics(dtype),
            newton_iterations=jnp.asarray(1, jnp.int32),
            linear_iterations=stats["iterations"],
        )
        found = _residual(program, base, g, time, after)
        return _Iterate(after, *found, moved, spent.plus(one))

    first = _residual(program, base, g, time, guess)
    now = _Iterate(guess, *first, jnp.asarray(jnp.inf, dtype), zero_statistics(dtype))
    if context.linear:
        return iterate(now)
    # Of what was found: a stage may end thousands of kelvin from where it starts.
    rounding = lambda i: 8 * jnp.finfo(dtype).eps * (1 + max_abs((base, i.states)))
    # At least once: steps that change less than the tolerance would add up to nothing.
    goes_on = lambda i: (
        (i.statistics.newton_iterations < 1)
        | ((max_abs(i.residual) > context.tolerance) & (i.moved > rounding(i)))
    )
    now = jax.lax.while_loop(
        lambda i: goes_on(i) & (i.statistics.newton_iterations < MOST_NEWTON),
        iterate,
        now,
    )
    # What is left where no step moves anything is rounding; NaN is no convergence.
    settled = (max_abs(now.residual) <= context.tolerance) | (
        now.moved <= jnp.maximum(rounding(now), 10 * context.tolerance)
    )
    return now._replace(statistics=replace(now.statistics, newton_failed=~settled))


def _differentiable(program, context, base, g, time, states, fixed) -> State:
    """The same states with the derivative of the solution."""
    residual, _ = _residual(program, base, g, time, states)
    none = jax.tree.map(lambda r: r - jax.lax.stop_gradient(r), residual)
    still, own, _, still_g, still_time, _ = fixed
    rate = 1 / still_g
    at = linearize(still, own, stop_gradient(states), rate, still_time)
    change, _ = solve_linear(at, per_step(none, at, rate), derivative_solver(states))
    return jax.tree.map(jnp.add, states, change)


def derivative_solver(states: State) -> ConjugateGradient:
    """A solver whose right-hand side may have any unit."""
    eps = float(jnp.finfo(states[0].dtype).eps)
    tolerance = max(DERIVATIVE_TOLERANCE, 20 * eps)
    return ConjugateGradient(ResidualNorm(1.0), tolerance, relative=True)
