"""Explicit Euler: one step, many steps, and the step it is stable at.

T_{n+1} = T_n + dt / C (conduction + sum of surface heat rates). Temperatures stay
within their bounds while 1 - dt (sum G + stiffness) / C >= 0 at every node, which is
also the limit of stability: dt = h^2 / (6 alpha) inside a uniform body.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..scene.program import Program, State
from .ledger import Ledger
from .loads import add_loads


class ForwardEuler(eqx.Module):
    """Explicit Euler at a given step, or at the stable one."""

    dt: Any = None
    """[s]; None for the largest stable step."""


class RunState(eqx.Module):
    """What goes from step to step."""

    theta: State
    ledger: Ledger


def euler_step(
    program: Program, state: RunState, time: Float[Array, ""], dt: Float[Array, ""]
) -> RunState:
    """One step of every body, with the heat each mechanism brought entered."""
    conducted = []
    for body, now in zip(program.bodies, state.theta, strict=True):
        with jax.named_scope("conduction"):
            conducted.append(body.network.euler_step(now, dt))
    new, rates = add_loads(program, state.theta, tuple(conducted), time, dt)
    if not len(rates):
        return RunState(new, state.ledger)
    return RunState(new, state.ledger.add(dt * rates))


def advance(
    program: Program,
    state: RunState,
    start: Float[Array, ""],
    dt: Float[Array, ""],
    steps: int | Int[Array, ""],
    done: int | Int[Array, ""] = 0,
) -> RunState:
    """`steps` steps of `dt`, after `done` ones that began at time `start`.

    With `steps` a Python number the loop has a fixed length and can be differentiated
    in reverse; with an array it is one program for any length.
    """

    def one(i, state):
        # Loads are taken at the middle of the step: the heat of a ramp is exact, and
        # what is switched off at a landing is on before it and off after it.
        middle = jnp.asarray(i + done, dt.dtype) + 0.5
        return euler_step(program, state, start + dt * middle, dt)

    if isinstance(steps, int):
        return jax.lax.fori_loop(0, steps, one, state)
    # Two steps an iteration go to a second buffer and back; with one XLA would copy
    # the state to where the loop expects it, a third of the time of a step.
    both = lambda i, state: one(2 * i + 1, one(2 * i, state))
    state = jax.lax.fori_loop(0, steps // 2, both, state)
    return jax.lax.fori_loop(steps - steps % 2, steps, one, state)
