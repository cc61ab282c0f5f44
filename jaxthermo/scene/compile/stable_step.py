"""The largest explicit step at which every node keeps a positive weight of its own."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...arrays import added, taken
from ...network.columns import STABLE_FRACTION
from ...network.network import AbstractNetwork, Address
from ...physics.convection.enclosed_air import AirExchange, AirLaw
from ...physics.half_cells import Extremes
from ...physics.time_varying import largest
from .program import Program


@eqx.filter_jit
def stable_step_of(
    program: Program, highest: Float[Array, ""], end: float
) -> Float[Array, ""]:
    """Largest stable explicit step, min C / (sum G + stiffness) [s]; or infinity.

    `highest` is the temperature of any surface [K], `end` the end of the run [s].
    """
    # Up to this step every node's weight in its own next temperature is positive, so
    # that temperatures stay within their bounds; or, if that is longer, columns spread
    # what loads on their thin cells add.
    rates = [
        _rates(body.network, _stiffness(program, number, highest, end))
        for number, body in enumerate(program.bodies)
    ]
    largest = jnp.stack([body.at_nodes for body in rates]).max()
    if any(body.network.columns is not None for body in program.bodies):
        with_columns = jnp.stack([body.with_columns for body in rates]).max()
        largest = jnp.minimum(largest / STABLE_FRACTION, with_columns)
    return jnp.where(largest > 0, 1 / jnp.where(largest > 0, largest, 1), jnp.inf)


_Loads = list[tuple[Address, Float[Array, " m"]]]
"""Addresses of a body's nodes, and the conductance that loads add there [W/K]."""


class _Rates(NamedTuple):
    """Largest explicit rates of a body [1/s]."""

    at_nodes: Float[Array, ""]
    """Largest sum of conductances outside columns over the capacity of a node."""
    with_columns: Float[Array, ""]
    """The same with loads on the cells of columns spread by these."""


def _rates(network: AbstractNetwork, loads: _Loads) -> _Rates:
    rates = [network.max_rate()]
    conductance = network.explicit_diagonal() * network.max_relative_conductivity()
    total = conductance
    for address, stiffness in loads:
        total = added(total, address, stiffness)
    for address, _ in loads:
        capacity = network.capacity_at(address) * network.min_relative_capacity()
        rates.append((taken(total, address) / capacity).max())
    at_nodes = jnp.stack(rates).max()
    columns = network.columns
    if columns is None:
        return _Rates(at_nodes=at_nodes, with_columns=at_nodes)
    capacity = network.capacity() * network.min_relative_capacity()
    on_cells = jnp.arange(total.shape[0]) < columns.conductance.size
    explicit = jnp.where(on_cells, conductance, total)
    load = (total - conductance) / network.min_relative_capacity()
    rate = jnp.maximum(network.max_rate(), (explicit / capacity).max())
    return _Rates(
        at_nodes=at_nodes,
        with_columns=columns.stable_rate(rate, stiffness=load),
    )


def _stiffness(program: Program, number: int, highest, end) -> _Loads:
    """Conductance that loads add to the nodes of a body."""
    loads: _Loads = []
    if program.surface is not None:
        relative = _extremes(program, number)
        loads = program.surface.stiffness(number, highest, end, relative)
    for contact in program.contacts:
        first, second = contact.bodies
        pair = _extremes(program, first), _extremes(program, second)
        for side in (0, 1):
            if contact.bodies[side] == number:
                stiffness = contact.stiffness(side, end, pair)
                loads.append((contact.address[side], stiffness))
    for air in program.airs:
        if program.group_of(air.body) == number:
            loads.append(((jnp.zeros(1, int),), _air_stiffness(program, air, end)))
    return loads


def _air_stiffness(
    program: Program, air: AirExchange, end: float
) -> Float[Array, " 1"]:
    """Conductances from the air to all surfaces and to outside [W/K]."""
    capacity = program.bodies[program.group_of(air.body)].network.capacity()
    dtype = capacity.dtype
    total = largest(air.rate, end).astype(dtype) * jnp.reshape(capacity, (-1,))[0]
    for _, term in program.fragment_terms.natural:
        if isinstance(term.law, AirLaw) and term.law.air == air.body:
            h = largest(term.law.coefficient, end).astype(dtype)
            total = total + h * jnp.asarray(term.effective_area).sum()
    return jnp.reshape(total, (1,))


def _extremes(program: Program, number: int) -> Extremes:
    network = program.bodies[number].network
    return Extremes(
        lowest=network.min_relative_conductivity(),
        highest=network.max_relative_conductivity(),
    )
