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

from ..network.network import precise_sum
from ..scene.compile import BodyProgram, Program, State
from .ledger import Ledger


class ForwardEuler(eqx.Module):
    """Explicit Euler at a given step, or at the stable one."""

    dt: Any = None
    """[s]; None for the largest stable step."""


class RunState(eqx.Module):
    """What goes from step to step."""

    theta: State
    ledger: Ledger


def surface_heat(
    body: BodyProgram,
    mechanisms: tuple[str, ...],
    theta: Float[Array, "..."],
    time: Float[Array, ""],
) -> tuple[Float[Array, " s"], Float[Array, " m"]]:
    """Heat rate into each fragment, and in all by each mechanism [W]."""
    here = theta.at[body.address].get(mode="promise_in_bounds")
    total = jnp.zeros_like(here)
    by_mechanism = jnp.zeros(len(mechanisms), here.dtype)
    for number, term in body.terms:
        with jax.named_scope(mechanisms[number]):
            if term.fragments is None:
                rate = term.heat_rate(time, here)
                total = total + rate
            else:
                rate = term.heat_rate(time, here[term.fragments])
                total = total.at[term.fragments].add(
                    rate, unique_indices=True, indices_are_sorted=True
                )
            by_mechanism = by_mechanism.at[number].add(precise_sum(rate))
    return total, by_mechanism


def euler_step(
    program: Program, state: RunState, time: Float[Array, ""], dt: Float[Array, ""]
) -> RunState:
    """One step of every body, with the heat each mechanism brought entered."""
    thetas = []
    rates = jnp.zeros_like(state.ledger.heat)
    for body, theta in zip(program.bodies, state.theta, strict=True):
        with jax.named_scope("conduction"):
            new = body.network.euler_step(theta, dt)
        if body.terms:
            heat, by_mechanism = surface_heat(body, program.mechanisms, theta, time)
            rise = dt * heat / body.network.capacity(body.address)
            # The state stays three-dimensional here: flattening it for the scatter
            # would make XLA compute the whole stencil with flat indices, slowly.
            new = new.at[body.address].add(
                rise, mode="promise_in_bounds", indices_are_sorted=True
            )
            rates = rates + by_mechanism
        thetas.append(new)
    if not len(rates):
        return RunState(tuple(thetas), state.ledger)
    return RunState(tuple(thetas), state.ledger.add(dt * rates))


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


@eqx.filter_jit
def stable_step(
    program: Program, hottest: Float[Array, ""], end: float
) -> Float[Array, ""]:
    """The largest stable step up to `end` [s]: min C / (sum G + stiffness); or inf."""
    rates = []
    for body in program.bodies:
        network, address = body.network, body.address
        rates.append(network.largest_rate())
        if not body.terms:
            continue
        stiff = jnp.zeros_like(address[0], body.reference.dtype)
        for _, term in body.terms:
            chosen = slice(None) if term.fragments is None else term.fragments
            stiff = stiff.at[chosen].add(term.stiffness(hottest, end))
        total = _sum_by_node(body, stiff) + network.diagonal(address)
        rates.append((total / network.capacity(address)).max())
    fastest = jnp.stack(rates).max()
    return jnp.where(fastest > 0, 1 / jnp.where(fastest > 0, fastest, 1), jnp.inf)


def _sum_by_node(body: BodyProgram, values: Float[Array, " s"]) -> Float[Array, " s"]:
    """For each fragment, the sum of `values` over all fragments of its node."""
    first = jnp.zeros(values.shape, bool).at[0].set(True)
    for index in body.address:
        first = first.at[1:].set(first[1:] | (index[1:] != index[:-1]))
    node = jnp.cumsum(first) - 1
    sums = jax.ops.segment_sum(values, node, num_segments=values.shape[0])
    return sums[node]
