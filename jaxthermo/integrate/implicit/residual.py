"""Rates of change of a scene's states, and their slopes.

    d eta / dt = (conduction + loads) / C  [K/s],

for the state eta of every node, see `network`. An explicit step computes the same with
fused operators; implicit stages evaluate it at states that they iterate. Conduction is
summed over faces, see `AbstractNetwork.face_heat_rate`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...network.network import inverse
from ...scene.compile.program import Program, State
from ..run.heat_rates import add_loads, add_own_loads, irradiation, surface_nodes


class _Rates(NamedTuple):
    """Rates of nodes and ledger entries."""

    change: State
    """Rate of change of each node [K/s]."""
    entries: Float[Array, " c"]
    """Heat rate of each ledger entry [W]."""


def evaluate_rates(program: Program, states: State, time: Float[Array, ""]) -> _Rates:
    """Evaluate the rates at given states and a time [s]."""
    zero = tuple(jnp.zeros_like(state) for state in states)
    one_second = jnp.ones((), states[0].dtype)
    # Loads added to a zero state over one second are their rates.
    loaded, entries = add_loads(program, states, zero, time, one_second)
    change = tuple(
        added + inverse(body.network.capacity()) * body.network.face_heat_rate(state)
        for added, body, state in zip(loaded, program.bodies, states, strict=True)
    )
    return _Rates(change, entries)


class _Slopes(NamedTuple):
    """Decrease of heat rates with temperature, never negative."""

    change: State
    """Slope at each node [1/s]."""
    entries: Float[Array, " c"]
    """Slope of each ledger entry, summed over its nodes [W/K]."""


def load_slopes(program: Program, states: State, time: Float[Array, ""]) -> _Slopes:
    """Return -d(loads)/d(state) of all loads but contacts."""
    zero = tuple(jnp.zeros_like(state) for state in states)
    one_second = jnp.ones((), states[0].dtype)
    # Irradiation is constant here: what bodies emit counts, what returns does not.
    given = irradiation(program, surface_nodes(program, states), time)

    def own_loads(states):
        nodes = surface_nodes(program, states)
        return add_own_loads(program, nodes, given, True, zero, time, one_second)

    # These loads act at single nodes, so that one derivative along all ones is the
    # whole diagonal Jacobian.
    ones = tuple(jnp.ones_like(state) for state in states)
    _, slopes = jax.jvp(own_loads, (states,), (ones,))
    return _Slopes(*jax.tree.map(lambda slope: jnp.maximum(-slope, 0), slopes))
