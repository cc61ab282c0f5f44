"""The largest stable explicit step of a program."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .program import BodyProgram, Program


def _touched(program: Program, number: int, body: BodyProgram, hottest, end):
    """Address and added conductance of what acts on a body's nodes [W/K]."""
    found = []
    if body.load is not None:
        steepest = body.network.max_relative_conductivity()
        address = body.load.places.address
        found.append((address, body.load.stiffness(hottest, end, steepest)))
    for contact in program.contacts:
        for side in (0, 1):
            if contact.bodies[side] == number:
                found.append((contact.address[side], contact.stiffness(end)))
    return found


@eqx.filter_jit
def stable_step(
    program: Program, hottest: Float[Array, ""], end: float
) -> Float[Array, ""]:
    """The largest stable step up to `end` [s]: min C / (sum G + stiffness); or inf.

    Args:
        program: of a scene at one moment.
        hottest: that surfaces can get [K].
        end: of the run [s].
    """
    rates = []
    for number, body in enumerate(program.bodies):
        network = body.network
        rates.append(network.max_rate())
        touched = _touched(program, number, body, hottest, end)
        if not touched:
            continue
        total = network.diagonal() * network.max_relative_conductivity()
        for address, stiffness in touched:
            total = total.at[address].add(stiffness)
        for address, _ in touched:
            capacity = network.capacity_at(address) * network.min_relative_capacity()
            rates.append((total[address] / capacity).max())
    largest = jnp.stack(rates).max()
    return jnp.where(largest > 0, 1 / jnp.where(largest > 0, largest, 1), jnp.inf)
