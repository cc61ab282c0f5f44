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

from ..physics.contact.links import ContactLinks
from ..scene.program import Program, State
from .ledger import Ledger


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
    new, rates = [], jnp.zeros_like(state.ledger.heat)
    nodes = surface_nodes(program, state.theta)
    radiated = _radiated(program, nodes, time)
    for index, (body, now) in enumerate(zip(program.bodies, state.theta, strict=True)):
        with jax.named_scope("conduction"):
            after = body.network.euler_step(now, dt)
        for source in body.sources:
            with jax.named_scope("heat_source"):
                after, rate = source.warm(after, time, dt)
            rates = rates.at[source.entry].add(rate)
        if body.load is not None:
            after, each = body.load.warm(
                after, body.network, nodes[index], time, dt, radiated[index]
            )
            rates = rates + each
        new.append(after)
    for contact in program.contacts:
        with jax.named_scope("contact"):
            rates = _swap(program, contact, state.theta, new, rates, time, dt)
    if not len(rates):
        return RunState(tuple(new), state.ledger)
    return RunState(tuple(new), state.ledger.add(dt * rates))


def surface_nodes(program: Program, states: State) -> list[Float[Array, " m"]]:
    """Of every body, temperatures of the nodes that carry loads [K]."""
    found = []
    for body, state in zip(program.bodies, states, strict=True):
        if body.load is None:
            found.append(jnp.zeros(0, state.dtype))
            continue
        there = state.at[body.load.address].get(mode="promise_in_bounds")
        found.append(body.network.temperature(there))
    return found


def _radiated(program: Program, nodes: list, time: Float[Array, ""]) -> list:
    """Net radiation to each body's places [W/m^2]; None where none is exchanged."""
    around = program.enclosure
    if around is None:
        return [None] * len(program.bodies)
    at_places = [
        (None, there) if body.load is None else body.load.at_places(body.network, there)
        for body, there in zip(program.bodies, nodes, strict=True)
    ]
    with jax.named_scope("emission"):
        received = around.irradiation(time, tuple(here for _, here in at_places))
        surface = tuple(
            here
            if terms is None
            else here + terms.radiating(heat).surface_excess(time, here)
            for (terms, here), heat in zip(at_places, received, strict=True)
        )
        return around.net(time, surface)


def pair_temperatures(
    program: Program, contact: ContactLinks, states: State
) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """Of the nodes on both sides of every touching pair, above the references [K]."""
    first, second = (
        program.bodies[body].network.temperature(
            states[body].at[address].get(mode="promise_in_bounds")
        )
        for body, address in zip(contact.bodies, contact.address, strict=True)
    )
    return first, second


def _swap(program, contact, states, new, rates, time, dt):
    """Heat that two bodies exchange, put into `new` in place; what passes, in rates."""
    one, other = contact.bodies
    theta = pair_temperatures(program, contact, states)
    references = program.bodies[one].reference, program.bodies[other].reference
    both = new[one], new[other]
    (new[one], new[other]), rate = contact.warm(both, theta, references, time, dt)
    return rates.at[contact.entry].add(rate)


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
