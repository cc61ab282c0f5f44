"""What is kept of a state at a saved time."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...scene.compile.program import Program
from ..implicit.newton_stage import Effort
from .heat_rates import pair_temperatures
from .ledger import Ledger
from .state import RunState


class Observation(NamedTuple):
    """What is kept of a state at a saved time."""

    surface: Float[Array, " s"]
    """[K]"""
    mean: Float[Array, " b"]
    """[K]"""
    stored: Float[Array, " b"]
    """Above the references [J]."""
    finite: Bool[Array, ""]
    possible: Bool[Array, ""]
    """Whether no part of the surface is below 0 K, but for rounding."""
    ledger: Ledger
    effort: Effort | None
    """Of an implicit solver."""


def effort_of(work: Any) -> Effort | None:
    """That a solver's own work holds."""
    return work if isinstance(work, Effort | None) else work.effort


@eqx.filter_jit
def observe(
    program: Program, state: RunState, time: Float[Array, ""] | None
) -> Observation:
    """Surface temperatures, means and energies of a state.

    Args:
        program: what made it.
        state: at some moment.
        time: of the loads that led to it [s], the middle of the last step: a load that
            is switched at that moment is still read as it was. None at the start.
    """
    surface, mean, stored = [], [], []
    around = zip(
        program.bodies,
        state.theta,
        _pressed(program, state, time),
        _received(program, state, time),
        strict=True,
    )
    for body, now, press, heat in around:
        here = body.reading.read(body.network, now, time, press, heat)
        surface.append(body.reference + here)
        network = body.network
        heat = network.stored(network.temperature(now)) / network.total_capacity()
        mean.append(body.reference + heat)
        stored.append(network.stored(now))
    outside, heat = jnp.concatenate(surface), jnp.stack(stored)
    return Observation(
        surface=outside,
        mean=jnp.stack(mean),
        stored=heat,
        finite=jnp.isfinite(heat).all(),
        possible=outside.min() > -1e-3,
        ledger=state.ledger,
        effort=effort_of(state.work),
    )


def _pressed(program: Program, state: RunState, time) -> list:
    """What contacts raise each body's surface over its nodes [K]; None if none."""
    found: list = [None] * len(program.bodies)
    if time is None:
        return found
    for contact in program.contacts:
        theta = pair_temperatures(program, contact, state.theta)
        one, other = (program.bodies[b].reference for b in contact.bodies)
        rate = contact.heat_rate(time, theta, (one, other))
        for side, body in enumerate(contact.bodies):
            fragments = program.bodies[body].reading.node.shape[0]
            raised = contact.excess(rate, side, fragments)
            found[body] = raised if found[body] is None else found[body] + raised
    return found


def _received(program: Program, state: RunState, time) -> list:
    """Irradiation of each body's fragments by what they see; None if there is none."""
    fine = program.fine_enclosure
    if fine is None or time is None:
        return [None] * len(program.bodies)
    thetas = []
    for body, now in zip(program.bodies, state.theta, strict=True):
        theta, reading = body.network.temperature(now), body.reading
        nodes = theta.at[reading.address].get(mode="promise_in_bounds")
        thetas.append(nodes.at[reading.node].get(mode="promise_in_bounds"))
    return fine.irradiation(time, tuple(thetas))
