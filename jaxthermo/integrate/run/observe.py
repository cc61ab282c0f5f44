"""Observation of a state: surface and mean temperatures, stored heat, failures."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...scene.compile.program import Program
from ..implicit.newton_stage import SolverStatistics
from ..stepper import RunState
from .heat_rates import pair_temperatures
from .ledger import Ledger


class Observation(NamedTuple):
    """The part of a state that a solution stores."""

    surface_temperature: Float[Array, " s"]
    """Temperature of each fragment, bodies one after the other [K]."""
    mean_temperature: Float[Array, " b"]
    """Capacity-weighted mean of each body [K]."""
    stored_heat: Float[Array, " b"]
    """Heat of each body above its reference temperature [J]."""
    is_finite: Bool[Array, ""]
    is_physical: Bool[Array, ""]
    """True if no surface temperature is below 0 K by more than rounding."""
    ledger: Ledger
    statistics: SolverStatistics | None
    """Totals of an implicit solver; None for explicit ones."""


@eqx.filter_jit
def observe(
    program: Program, state: RunState, time: Float[Array, ""] | None
) -> Observation:
    """Observe a state.

    Args:
        program: compiled scene.
        state: state of the run.
        time: time of the loads that act on the surface [s], within the last step, so
            that a load that is switched now still counts as it was; None at the start,
            where none has acted yet.
    """
    contact_excess = _contact_excess(program, state, time)
    above = program.surface_temperatures(state.theta, time, contact_excess)
    surface, mean, stored = [], [], []
    for body, theta, here in zip(program.bodies, state.theta, above, strict=True):
        # The reference is added last: differences keep their digits in float32.
        surface.append(body.reference + here)
        network = body.network
        heat = network.stored(network.temperature(theta)) / network.total_capacity()
        mean.append(body.reference + heat)
        stored.append(network.stored(theta))
    temperature, heat = jnp.concatenate(surface), jnp.stack(stored)
    # The adaptive stepper keeps its statistics beside the controller's memory.
    solver_state = state.solver_state
    if not isinstance(solver_state, SolverStatistics | None):
        solver_state = solver_state.statistics
    return Observation(
        surface_temperature=temperature,
        mean_temperature=jnp.stack(mean),
        stored_heat=heat,
        is_finite=jnp.isfinite(heat).all(),
        # Rounding and the solver's tolerance may lead below 0 K by this much.
        is_physical=temperature.min() > -1e-3,
        ledger=state.ledger,
        statistics=solver_state,
    )


def _contact_excess(program: Program, state: RunState, time) -> list:
    """Excess of each body's fragments over their nodes by contacts [K], or None."""
    found: list = [None] * len(program.bodies)
    if time is None:
        return found
    for contact in program.contacts:
        theta = pair_temperatures(program, contact, state.theta)
        first, second = (program.bodies[b].reference for b in contact.bodies)
        rate = contact.heat_rate(time, theta, (first, second))
        for side, body in enumerate(contact.bodies):
            fragments = program.bodies[body].node.shape[0]
            excess = contact.excess(rate, side, fragments)
            found[body] = excess if found[body] is None else found[body] + excess
    return found
