"""Loops over equal steps: of any number, or of a fixed length for reverse mode."""

from collections.abc import Callable
from typing import NamedTuple

import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...physics.windows import Window, over, start_of_step, within
from ...scene.compile.program import Program
from ..stepper import AbstractStepper, RunState, is_copied_fast
from .plan import StepTable
from .solution import Observation, observe


class Span(NamedTuple):
    """Steps of equal length, as arrays."""

    window: Window
    """Time of all steps of the interval, with those before."""
    dt: Float[Array, ""]
    """Length of a step [s]."""
    steps: int | Int[Array, ""]
    """Number of steps; a Python number for a loop of fixed length."""
    steps_before: Int[Array, ""] | None = None
    """Number of steps of the window that have been taken before; None for 0."""


def steps_of(
    stepper: AbstractStepper,
    program: Program,
    checkpoints: int | None = None,
    length: int | None = None,
) -> Callable[[RunState, Span], tuple[RunState, None]]:
    """Return the function that takes the steps of a span, as a body of `lax.scan`.

    With an array as `steps` one compiled program serves every number of steps. With a
    Python number, or with a `length` that no number of steps exceeds, the loop has a
    fixed length and can be differentiated in reverse mode, which stores `checkpoints`
    states and recomputes the others; None stores all.
    """

    def take_span(state: RunState, span: Span) -> tuple[RunState, None]:
        in_window = over(program, span.window)

        def one_step(i, state: RunState) -> RunState:
            # From the start, not summed step by step, which would accumulate rounding.
            number = i if span.steps_before is None else i + span.steps_before
            begin = start_of_step(jnp.asarray(number), span.dt)
            in_step = within(in_window, begin, span.dt)
            return stepper.step(in_step, state, begin.sum(), span.dt)

        def two_steps(i, state: RunState) -> RunState:
            # Two steps per iteration write to a second buffer and back; with one, XLA
            # copies the state to where the loop expects it.
            return one_step(2 * i + 1, one_step(2 * i, state))

        def step_or_rest(i, state: RunState) -> RunState:
            return jax.lax.cond(i < steps, one_step, lambda _, state: state, i, state)

        steps = span.steps
        if isinstance(steps, int):
            return _take_fixed(one_step, state, steps), None
        if length is not None:
            return _take_fixed(step_or_rest, state, length), None
        if not stepper.two_buffers or is_copied_fast(state.theta):
            return jax.lax.fori_loop(0, steps, one_step, state), None
        state = jax.lax.fori_loop(0, steps // 2, two_steps, state)
        return jax.lax.fori_loop(steps - steps % 2, steps, one_step, state), None

    def _take_fixed(one_step, state: RunState, steps: int) -> RunState:
        if checkpoints is not None and checkpoints < steps:
            return eqxi.scan(
                lambda carry, i: (one_step(i, carry), None),
                state,
                jnp.arange(steps),
                kind="checkpointed",
                checkpoints=checkpoints,
            )[0]
        # For a cheap step, reverse mode stores only the state before it: its
        # intermediate values take longer to write and read than to recompute.
        if stepper.two_buffers:
            one_step = jax.checkpoint(one_step, prevent_cse=False)
        return jax.lax.fori_loop(0, steps, one_step, state)

    return take_span


def advance(
    stepper: AbstractStepper,
    program: Program,
    state: RunState,
    span: Span,
    checkpoints: int | None = None,
) -> RunState:
    """Take the steps of one span, see `steps_of`."""
    return steps_of(stepper, program, checkpoints)(state, span)[0]


def take_row(
    take_interval: Callable[[RunState, Span], tuple[RunState, None]],
    program: Program,
    state: RunState,
    row: StepTable,
) -> tuple[RunState, Observation]:
    """Take the steps of one row of a table, and observe its end."""
    windows = Window(row.start, row.dt * jnp.asarray(row.steps, row.dt.dtype))
    spans = Span(window=windows, dt=row.dt, steps=row.steps)
    state, _ = jax.lax.scan(take_interval, state, spans)
    # Columns without steps follow those with steps.
    last = jnp.maximum((row.steps > 0).sum() - 1, 0)
    window = jax.tree.map(lambda column: column[last], windows)
    return state, observe(program, state, row.observation_time, window)
