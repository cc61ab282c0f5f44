"""Steps of a length that the error decides: TR-BDF2 with its embedded third order.

The error of a step is the difference to the embedded formula, smoothed by one more
solve with the stage's own operator, so that it stays small where the solution has
long settled however stiff it is. The step follows it by a proportional-integral rule,

    h <- h 0.9 e_n^(-0.7/3) e_{n-1}^(0.4/3),    e = error / tolerance.

A run still lands on save times and on whatever is switched.

Source: Hosea and Shampine, Applied Numerical Mathematics 20 (1996) 21-37; Gustafsson,
ACM Transactions on Mathematical Software 17 (1991) 533-554.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...scene.compile.program import Program, State
from ..stepper import AbstractStepper, RunState
from .conjugate_gradient import ConjugateGradient
from .context import ImplicitContext
from .jacobian import linearize
from .newton_stage import (
    SolverStatistics,
    kelvin_norm,
    per_step,
    solve_linear,
    stop_gradient,
    zero_statistics,
)
from .runge_kutta import SQRT2, TR_BDF2, StepResult, runge_kutta_step


SOLVED = 1 - SQRT2 / 2
"""The implicit coefficient."""

# What the last stage's weights are over the embedded formula's.
ERROR_WEIGHTS = (
    SQRT2 / 4 - (1 - SQRT2 / 4) / 3,
    SQRT2 / 4 - (3 * SQRT2 / 4 + 1) / 3,
    SOLVED * 2 / 3,
)

SLOWEST, FASTEST, SAFETY = 0.2, 5.0, 0.9
LEAST = 1e-4
"""An error, over the tolerance, below which it says no more."""
ENOUGH = 1e-2
"""Of the tolerance, to which an error is found."""
FIRST = 1e-3
"""Of the time to the first landing."""
MOST_TRIES = 5000
"""Between two landings."""


class AdaptiveWork(eqx.Module):
    """What the controller remembers."""

    statistics: SolverStatistics
    step: Float[Array, ""]
    """To try next [s]; 0 before the first."""
    error: Float[Array, ""]
    """Of the last accepted step, over the tolerance."""


class _Carry(NamedTuple):
    state: RunState
    passed: Float[Array, ""]
    """Since the last landing [s]."""
    tries: Int[Array, ""]


class AdaptiveStepper(AbstractStepper):
    """A step of it is the way to the next landing, in as many as the error wants."""

    context: ImplicitContext
    tolerance: Float[Array, ""]
    """Error of a step [K]."""
    checkpoints: int | None = eqx.field(static=True, default=None)
    """For reverse mode: how many states to keep on that way."""

    def begin(self, state: RunState) -> RunState:
        """With nothing known of the error."""
        dtype = state.theta[0].dtype
        zero, one = jnp.zeros((), dtype), jnp.ones((), dtype)
        work = AdaptiveWork(zero_statistics(dtype), zero, one)
        return RunState(state.theta, state.ledger, work)

    def step(
        self,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """All steps from `start` to `start + dt`."""
        work: AdaptiveWork = state.solver_state
        first = jnp.where(work.step > 0, work.step, FIRST * dt)
        state = RunState(state.theta, state.ledger, replace(work, step=first))
        carry = _Carry(state, jnp.zeros_like(dt), jnp.zeros((), jnp.int32))
        # What rounding leaves of the way is no step.
        near = dt * (1 - 1e-5)
        more = lambda c: (c.passed < near) & (c.tries < MOST_TRIES)
        attempt = lambda c: self._attempt(program, start, dt, c)
        if self.checkpoints is not None:
            carry = eqxi.while_loop(
                more,
                attempt,
                carry,
                max_steps=MOST_TRIES,
                kind="checkpointed",
                checkpoints=self.checkpoints,
            )
        else:
            carry = jax.lax.while_loop(more, attempt, carry)
        work, failed = carry.state.solver_state, carry.passed < near
        statistics = replace(
            work.statistics,
            step_limit_reached=work.statistics.step_limit_reached | failed,
        )
        return RunState(
            carry.state.theta, carry.state.ledger, replace(work, statistics=statistics)
        )

    def _attempt(self, program: Program, start, dt, carry: _Carry) -> _Carry:
        state, work = carry.state, carry.state.solver_state
        left = dt - carry.passed
        # Two halves rather than a whole step and a sliver.
        cut = jnp.where(left <= work.step, left, jnp.minimum(work.step, left / 2))
        span = jax.lax.stop_gradient(jnp.where(left < 2 * work.step, cut, work.step))
        taken = runge_kutta_step(
            program, self.context, TR_BDF2, state.theta, start + carry.passed, span
        )
        time = start + carry.passed + span
        error = self._error(program, taken, span, time) / self.tolerance
        good = error <= 1
        # An error of 0 asks for the longest step there is; NaN for the shortest.
        error = jnp.maximum(error, LEAST)
        factor = SAFETY * error ** (-0.7 / 3) * work.error ** (0.4 / 3)
        factor = jnp.where(good, factor, SAFETY * error ** (-1 / 3))
        factor = jnp.where(jnp.isfinite(factor), factor, SLOWEST)
        following = span * jnp.clip(factor, SLOWEST, FASTEST)
        # A step cut short for a landing says little of the longest that would do.
        following = jnp.where(
            good & (span < work.step), jnp.maximum(following, work.step), following
        )
        count = good.astype(jnp.int32)
        spent = replace(
            taken.statistics, accepted_steps=count, rejected_steps=1 - count
        )
        after = AdaptiveWork(
            statistics=work.statistics.plus(_kept(spent, good)),
            step=following,
            error=jnp.where(good, error, work.error),
        )
        ledger = state.ledger.add(taken.heat)
        choose = lambda new, old: jnp.where(good, new, old)
        theta = jax.tree.map(choose, taken.states, state.theta)
        ledger = jax.tree.map(choose, ledger, state.ledger)
        passed = carry.passed + jnp.where(good, span, 0)
        return _Carry(RunState(theta, ledger, after), passed, carry.tries + 1)

    def _error(
        self, program: Program, taken: StepResult, span, time
    ) -> Float[Array, ""]:
        """Of a step [K]."""
        program, context, taken, span, time = stop_gradient(
            (program, self.context, taken, span, time)
        )
        mixed: State = jax.tree.map(
            lambda *f: span * sum(w * x for w, x in zip(ERROR_WEIGHTS, f, strict=True)),
            *taken.slopes,
        )
        g = SOLVED * span
        at = linearize(program, context, taken.states, 1 / g, time)
        # (I - g f')^-1 of the difference: what it changes if g times it is brought.
        # Two digits of an error are enough: none is worth thousands of iterations.
        enough = jnp.maximum(context.tolerance, ENOUGH * self.tolerance)
        solver = ConjugateGradient(kelvin_norm(at, g), enough)
        smooth, _ = solve_linear(at, per_step(mixed, at, 1 / g), solver)
        return jnp.stack([jnp.abs(x).max() for x in smooth]).max()


def _kept(spent: SolverStatistics, good) -> SolverStatistics:
    """Failures of a step that is taken again do not count."""
    return replace(
        spent,
        linear_failed=spent.linear_failed & good,
        newton_failed=spent.newton_failed & good,
    )
