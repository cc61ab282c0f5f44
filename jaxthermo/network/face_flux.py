"""Conduction of a stencil as differences over faces.

A stencil takes neighbours together and then the node as many times, of which rounding
leaves something: little in a step, much in one of 1e8 s.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float, Shaped


def face_heat_rate(
    state: Float[Array, "x y z"],
    conductances: Sequence[Float[Array, ""]],
    degrees: Sequence[Shaped[Array, "_ _ _"]],
) -> Float[Array, "x y z"]:
    """Conduction into each node [W]: exactly 0 where all neighbours are equally warm.

    Args:
        state: the lattice with one empty cell all round.
        conductances: of links along x, y, z [W/K].
        degrees: along each, of every cell inside: more than 0 where it has neighbours.
    """
    total = jnp.zeros_like(state)
    for axis, (conductance, degree) in enumerate(
        zip(conductances, degrees, strict=True)
    ):
        # Two cells beside each other that both have neighbours are each other's.
        node = jnp.moveaxis(jnp.pad(degree > 0, 1), axis, 0)
        here = jnp.moveaxis(state, axis, 0)
        flow = jnp.where(node[1:] & node[:-1], here[1:] - here[:-1], 0) * conductance
        none = jnp.zeros_like(flow[:1])
        net = jnp.concatenate([flow, none]) - jnp.concatenate([none, flow])
        total = total + jnp.moveaxis(net, 0, axis)
    return total
