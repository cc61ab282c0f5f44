"""Many steps: one loop for any solver."""

import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...scene.compile.program import Program
from .state import AbstractStepper, RunState


def advance(
    stepper: AbstractStepper,
    program: Program,
    state: RunState,
    start: Float[Array, ""],
    dt: Float[Array, ""],
    steps: int | Int[Array, ""],
    done: int | Int[Array, ""] = 0,
    checkpoints: int | None = None,
) -> RunState:
    """`steps` steps of `dt`, after `done` ones that began at time `start`.

    With `steps` a Python number the loop has a fixed length and can be differentiated
    in reverse; with an array it is one program for any length.

    Args:
        stepper: takes the steps.
        program: of the scene.
        state: at the start.
        start: of the first step [s].
        dt: of each [s].
        steps: how many.
        done: steps taken before.
        checkpoints: states kept for reverse mode, which computes the others anew; None
            for all of them.
    """

    def one(i, state):
        begin = start + dt * jnp.asarray(i + done, dt.dtype)
        return stepper.step(program, state, begin, dt)

    if isinstance(steps, int):
        if checkpoints is None or checkpoints >= steps:
            return jax.lax.fori_loop(0, steps, _kept_alone(stepper, one), state)
        return eqxi.scan(
            lambda carry, i: (one(i, carry), None),
            state,
            jnp.arange(steps),
            kind="checkpointed",
            checkpoints=checkpoints,
        )[0]
    if not stepper.two_buffers:
        return jax.lax.fori_loop(0, steps, one, state)
    # Two steps an iteration go to a second buffer and back; with one XLA would copy
    # the state to where the loop expects it, a third of the time of an explicit step.
    both = lambda i, state: one(2 * i + 1, one(2 * i, state))
    state = jax.lax.fori_loop(0, steps // 2, both, state)
    return jax.lax.fori_loop(steps - steps % 2, steps, one, state)


def _kept_alone(stepper, one):
    """A step of which reverse mode keeps nothing but the state before it.

    All that a cheap step is made of takes longer to write and to read than to find
    anew.
    """
    if not stepper.two_buffers:
        return one
    return jax.checkpoint(one, prevent_cse=False)
