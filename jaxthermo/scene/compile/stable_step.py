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


class _Load(NamedTuple):
    """Conductance of a load on some nodes of a body."""

    address: Address
    stiffness: Float[Array, " m"]
    """Conductance that it adds to each node [W/K]."""
    is_link: bool
    """True if the other end is a node too: the matrix of a link is up to twice as large
    as its diagonal."""


class _Rates(NamedTuple):
    """Largest explicit rates of a body [1/s]."""

    at_nodes: Float[Array, ""]
    """Largest sum of conductances outside columns over the capacity of a node."""
    with_columns: Float[Array, ""]
    """The same with loads on the cells of columns spread by these."""


def _rates(network: AbstractNetwork, loads: list[_Load]) -> _Rates:
    rates = [network.max_rate()]
    conductance = network.explicit_diagonal() * network.max_relative_conductivity()
    total = conductance
    bound = jnp.zeros_like(conductance)
    for load in loads:
        total = added(total, load.address, load.stiffness)
        largest = (2 if load.is_link else 1) * load.stiffness
        bound = added(bound, load.address, largest)
    for load in loads:
        capacity = network.capacity_at(load.address) * network.min_relative_capacity()
        rates.append((taken(total, load.address) / capacity).max())
    at_nodes = jnp.stack(rates).max()
    columns = network.columns
    if columns is None:
        return _Rates(at_nodes=at_nodes, with_columns=at_nodes)
    capacity = network.capacity() * network.min_relative_capacity()
    on_cells = jnp.arange(total.shape[0]) < columns.conductance.size
    explicit = jnp.where(on_cells, conductance, total)
    rate = jnp.maximum(network.max_rate(), (explicit / capacity).max())
    return _Rates(
        at_nodes=at_nodes,
        with_columns=columns.stable_rate(
            rate, stiffness=bound / network.min_relative_capacity()
        ),
    )


def _stiffness(program: Program, number: int, highest, end) -> list[_Load]:
    """Conductance that loads add to the nodes of a body."""
    loads = []
    if program.surface is not None:
        relative = _extremes(program, number)
        # Exchange of radiation, and air with a node, link the cells of surfaces.
        is_link = program.enclosure is not None or bool(program.airs)
        pairs = program.surface.stiffness(number, highest, end, relative)
        for address, stiffness in pairs:
            loads.append(_Load(address, stiffness, is_link=is_link))
    for contact in program.contacts:
        first, second = contact.bodies
        pair = _extremes(program, first), _extremes(program, second)
        for side in (0, 1):
            if contact.bodies[side] == number:
                stiffness = contact.stiffness(side, end, pair)
                loads.append(_Load(contact.address[side], stiffness, is_link=True))
    for air in program.airs:
        if program.group_of(air.body) == number:
            stiffness = _air_stiffness(program, air, end)
            loads.append(_Load((jnp.zeros(1, int),), stiffness, is_link=True))
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
