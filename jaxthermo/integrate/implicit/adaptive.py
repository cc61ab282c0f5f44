"""Steps by error control: TR-BDF2 with its embedded formula of third order.

The error of a step is the difference to the embedded formula, smoothed by one more
solve with the stage's own operator, so that it stays small where the solution has
settled, however stiff it is. A proportional-integral controller sets the next step,

    h <- h 0.9 e_n^(-0.7/3) e_{n-1}^(0.4/3),    e = error / tolerance.

Steps still end exactly at save times and events.

Source: Hosea and Shampine, Applied Numerical Mathematics 20 (1996) 21-37; Gustafsson,
ACM Transactions on Mathematical Software 17 (1991) 533-554.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ...arrays import stop_gradient
from ...physics.windows import within
from ...scene.compile.memory import Method
from ...scene.compile.program import Program, State
from ..solver_statistics import SolverStatistics, zero_statistics
from ..stepper import AbstractStepper, RunState
from .conjugate_gradient import ConjugateGradient, max_abs
from .jacobian import ImplicitContext, linearize
from .newton_stage import (
    kelvin_norm,
    missing_heat,
    solve_linear,
)
from .runge_kutta import SQRT2, TR_BDF2, StepResult, runge_kutta_step


_IMPLICIT_COEFFICIENT = 1 - SQRT2 / 2

# Weights of the last stage less those of the embedded formula.
_ERROR_WEIGHTS = (
    SQRT2 / 4 - (1 - SQRT2 / 4) / 3,
    SQRT2 / 4 - (3 * SQRT2 / 4 + 1) / 3,
    _IMPLICIT_COEFFICIENT * 2 / 3,
)

_MIN_FACTOR = 0.2
"""Smallest ratio of successive steps."""

_MAX_FACTOR = 5.0
"""Largest ratio of successive steps."""

_SAFETY = 0.9
"""Factor by which a step is shorter than the error of the last one permits."""

_MIN_ERROR_RATIO = 1e-4
"""Error over tolerance below which it is rounding."""

_ERROR_SOLVE_TOLERANCE = 1e-2
"""Tolerance of the solve for the error, over the tolerance of the error."""

_FIRST_STEP_FRACTION = 1e-3
"""First step over the time to the first event."""

MAX_TRIES = 5000
"""Largest number of steps, accepted or rejected, between two events."""


class _ControllerState(Module):
    """Memory of the step controller."""

    statistics: SolverStatistics
    step: Float[Array, ""]
    """Step to try next [s]; 0 before the first."""
    error: Float[Array, ""]
    """Error of the last accepted step, over the tolerance."""


class _Carry(NamedTuple):
    state: RunState
    elapsed: Float[Array, ""]
    """Time since the last event [s]."""
    tries: Int[Array, ""]


class AdaptiveStepper(AbstractStepper):
    """TR-BDF2 under error control; one `step` of it is the whole way to an event."""

    context: ImplicitContext
    tolerance: Float[Array, ""]
    """Largest error of a step [K]."""
    checkpoints: int | None = eqx.field(static=True, default=None)
    """Number of states that reverse mode stores on the way to an event."""

    @property
    @override
    def method(self) -> Method:
        return self.context.method

    @override
    def begin(self, state: RunState) -> RunState:
        dtype = state.theta[0].dtype
        controller = _ControllerState(
            statistics=zero_statistics(dtype),
            step=jnp.zeros((), dtype),
            error=jnp.ones((), dtype),
        )
        return RunState(state.theta, state.ledger, controller)

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        controller: _ControllerState = state.solver_state
        has_step = controller.step > 0
        first = jnp.where(has_step, controller.step, _FIRST_STEP_FRACTION * dt)
        state = RunState(state.theta, state.ledger, replace(controller, step=first))
        carry = _Carry(state, jnp.zeros_like(dt), jnp.zeros((), jnp.int32))
        # What remains may be a rounding error, which is not a step.
        almost = dt * (1 - 1e-5)

        def unfinished(carry: _Carry) -> Bool[Array, ""]:
            return (carry.elapsed < almost) & (carry.tries < MAX_TRIES)

        def attempt(carry: _Carry) -> _Carry:
            return self._attempt(program, start, dt, carry)

        if self.checkpoints is None:
            carry = jax.lax.while_loop(unfinished, attempt, carry)
        else:
            carry = eqxi.while_loop(
                unfinished,
                attempt,
                carry,
                max_steps=MAX_TRIES,
                kind="checkpointed",
                checkpoints=self.checkpoints,
            )
        state = carry.state
        statistics = state.solver_state.statistics
        failed = statistics.step_limit_reached | (carry.elapsed < almost)
        statistics = replace(statistics, step_limit_reached=failed)
        controller = replace(state.solver_state, statistics=statistics)
        return RunState(state.theta, state.ledger, controller)

    def _attempt(self, program: Program, start, dt, carry: _Carry) -> _Carry:
        state = carry.state
        controller = state.solver_state
        remaining = dt - carry.elapsed
        # Two halves rather than a whole step and a tiny one.
        reaches_event = remaining <= controller.step
        half = jnp.minimum(controller.step, remaining / 2)
        last = jnp.where(reaches_event, remaining, half)
        step = jnp.where(remaining < 2 * controller.step, last, controller.step)
        step = jax.lax.stop_gradient(step)
        program = within(program, jnp.stack([start, carry.elapsed]), step)
        result = runge_kutta_step(
            program,
            context=self.context,
            tableau=TR_BDF2,
            states=state.theta,
            start=start + carry.elapsed,
            dt=step,
        )
        time = start + carry.elapsed + step
        error = self._error(program, result, step, time) / self.tolerance
        accepted = error <= 1
        # An error of 0 asks for the longest step there is; NaN for the shortest.
        error = jnp.maximum(error, _MIN_ERROR_RATIO)
        factor = _SAFETY * error ** (-0.7 / 3) * controller.error ** (0.4 / 3)
        factor = jnp.where(accepted, factor, _SAFETY * error ** (-1 / 3))
        factor = jnp.where(jnp.isfinite(factor), factor, _MIN_FACTOR)
        following = step * jnp.clip(factor, _MIN_FACTOR, _MAX_FACTOR)
        # A step cut short for an event does not show how long a step may be.
        cut_short = step < controller.step
        longer = jnp.maximum(following, controller.step)
        following = jnp.where(accepted & cut_short, longer, following)
        count = accepted.astype(jnp.int32)
        spent = result.statistics
        # Failures of a step that is repeated do not count.
        spent = replace(
            spent,
            accepted_steps=count,
            rejected_steps=1 - count,
            linear_failed=spent.linear_failed & accepted,
            newton_failed=spent.newton_failed & accepted,
        )
        next_controller = _ControllerState(
            statistics=controller.statistics.plus(spent),
            step=following,
            error=jnp.where(accepted, error, controller.error),
        )

        def select(new: Array, old: Array) -> Array:
            return jnp.where(accepted, new, old)

        theta = jax.tree.map(select, result.states, state.theta)
        ledger = jax.tree.map(select, state.ledger.add(result.heat), state.ledger)
        elapsed = carry.elapsed + jnp.where(accepted, step, 0)
        return _Carry(
            RunState(theta, ledger, next_controller), elapsed, carry.tries + 1
        )

    def _error(
        self, program: Program, result: StepResult, step, time
    ) -> Float[Array, ""]:
        """Return the largest error of a step [K]."""
        program, context, result, step, time = stop_gradient(
            (program, self.context, result, step, time)
        )

        def embedded_difference(*slopes: Array) -> Array:
            weighted = [w * f for w, f in zip(_ERROR_WEIGHTS, slopes, strict=True)]
            return step * sum(weighted)

        difference: State = jax.tree.map(embedded_difference, *result.slopes)
        g = _IMPLICIT_COEFFICIENT * step
        at = linearize(
            program, context=context, states=result.states, rate=1 / g, time=time
        )
        # Smoothed by (I - g f')^-1. Two digits of an error are enough.
        tolerance = jnp.maximum(
            context.tolerance, _ERROR_SOLVE_TOLERANCE * self.tolerance
        )
        solver = ConjugateGradient(kelvin_norm(at, g), tolerance)
        smooth = solve_linear(at, missing_heat(difference, at, 1 / g), solver).change
        return max_abs(smooth)
