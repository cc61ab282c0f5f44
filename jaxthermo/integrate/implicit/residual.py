"""How fast a scene's temperatures change, and what each mechanism brings.

    d eta / dt = (conduction + loads) / C  [K/s],

of the state eta of every node, as in `network`. An explicit step takes the same with
fused operators (`euler`); implicit ones need it at states that they are looking for.

Conduction is that of differences over faces: see `AbstractNetwork.face_heat_rate`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...network.network import inverse
from ...scene.compile.program import Program, State
from ..run.heat_rates import add_loads, add_own_loads, irradiation, surface_nodes


class Rates(NamedTuple):
    """Of every node, and of every entry of the ledger."""

    change: State
    """[K/s]"""
    entries: Float[Array, " c"]
    """[W]"""


def rates(program: Program, states: State, time: Float[Array, ""]) -> Rates:
    """At given states and a time [s]."""
    still = tuple(jnp.zeros_like(state) for state in states)
    second = jnp.ones((), states[0].dtype)
    loaded, entries = add_loads(program, states, still, time, second)
    change = tuple(
        added + inverse(body.network.capacity()) * body.network.face_heat_rate(state)
        for added, body, state in zip(loaded, program.bodies, states, strict=True)
    )
    return Rates(change, entries)


class Slopes(NamedTuple):
    """How what loads bring falls as their nodes get warmer; never negative."""

    change: State
    """Of each node [1/s]."""
    entries: Float[Array, " c"]
    """Of each entry of the ledger, for all its nodes at once [W/K]."""


def load_slopes(program: Program, states: State, time: Float[Array, ""]) -> Slopes:
    """-d(loads)/d(state), of all but contacts.

    Loads but for contact act at single nodes, so one derivative along all ones is the
    whole of it. What bodies radiate counts, what comes back of it does not.
    """
    still = tuple(jnp.zeros_like(state) for state in states)
    second = jnp.ones((), states[0].dtype)
    given = irradiation(program, surface_nodes(program, states), time)

    def alone(here):
        nodes = surface_nodes(program, here)
        return add_own_loads(program, nodes, given, still, time, second)

    ones = tuple(jnp.ones_like(state) for state in states)
    _, found = jax.jvp(alone, (states,), (ones,))
    return Slopes(*jax.tree.map(lambda slope: jnp.maximum(-slope, 0), found))
