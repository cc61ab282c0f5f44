"""How fast a scene's temperatures change, and what each mechanism brings.

    d eta / dt = (conduction + loads) / C  [K/s],

of the state eta of every node, as in `network`. An explicit step takes the same with
fused operators (`euler`); implicit ones need it at states that they are looking for.

A long step multiplies what rounding leaves of conduction, and a body that hardly sheds
heat turns it into kelvins. So conduction is that of differences over faces.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..network.axes import AxisStencil
from ..network.network import AbstractNetwork, inverse
from ..network.stencil import UniformStencil
from ..scene.program import Program, State
from .loads import add_loads, add_own_loads, irradiation, surface_nodes


def conduction(
    network: AbstractNetwork, state: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """Into each node [W]: exactly 0 where all neighbours are equally warm.

    Stencils take neighbours together and then the node as many times, of which rounding
    leaves something: little in a step, much in one of 1e8 s. Here they take differences
    over the faces between two nodes, as other networks do.
    """
    match network:
        case UniformStencil():
            each, linked = (network.conductance,) * 3, (network.degree,) * 3
        case AxisStencil():
            each = tuple(network.conductance)
            linked = tuple((network.degrees >> (2 * n)) & 3 for n in range(3))
        case _:
            return network.heat_rate(state)
    total = jnp.zeros_like(state)
    for axis, (conductance, degree) in enumerate(zip(each, linked, strict=True)):
        # Two cells beside each other that both have neighbours are each other's.
        node = jnp.moveaxis(jnp.pad(degree > 0, 1), axis, 0)
        here = jnp.moveaxis(state, axis, 0)
        flow = jnp.where(node[1:] & node[:-1], here[1:] - here[:-1], 0) * conductance
        none = jnp.zeros_like(flow[:1])
        net = jnp.concatenate([flow, none]) - jnp.concatenate([none, flow])
        total = total + jnp.moveaxis(net, 0, axis)
    return total


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
        added + inverse(body.network.capacity()) * conduction(body.network, state)
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
