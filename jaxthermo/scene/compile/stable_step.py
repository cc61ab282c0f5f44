"""The largest explicit step at which every node keeps a positive weight of its own."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...arrays import added, taken
from ...network.network import Address, inverse
from ...physics.boundary import ImposedFlux
from ...physics.convection.enclosed_air import AirExchange, AirLaw
from ...physics.half_cells import Extremes
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.time_varying import largest
from .body_program import BodyProgram
from .program import Program
from .stable_rates import StableRates, largest_rates


def stable_rates_of(
    programs: Sequence[Program], highest: Float[Array, ""], end: float
) -> StableRates:
    """Largest rates of all snapshots of a scene, max (sum G + stiffness) / C [1/s].

    `highest` is the temperature of any surface [K], `end` the end of the run [s].
    """
    # Snapshots whose imposed fluxes alone differ have the same rates.
    distinct: dict[tuple[int, ...], Program] = {}
    for program in programs:
        limiting = _without_imposed(program)
        distinct.setdefault(tuple(map(id, jax.tree.leaves(limiting))), limiting)
    return largest_rates(
        [_rates_of(program, highest, end) for program in distinct.values()]
    )


def _without_imposed(program: Program) -> Program:
    """The program without fluxes that do not depend on temperatures."""

    def limiting(terms: SurfaceTerms) -> SurfaceTerms:
        natural = tuple(
            (number, term)
            for number, term in terms.natural
            if not isinstance(term.law, ImposedFlux)
        )
        return replace(terms, natural=natural)

    load = program.surface
    if load is not None:
        load = replace(load.by_cell, terms=limiting(load.by_cell.terms))
    return replace(
        program, surface=load, fragment_terms=limiting(program.fragment_terms)
    )


@eqx.filter_jit
def _rates_of(program: Program, highest: Float[Array, ""], end: float) -> StableRates:
    rates = [
        _rates(body, _stiffness(program, number, highest, end))
        for number, body in enumerate(program.bodies)
    ]
    at_nodes, with_columns, stiffest = map(jnp.stack, zip(*rates, strict=True))
    return StableRates(
        at_nodes=at_nodes,
        with_columns=with_columns,
        has_columns=tuple(body.network.columns is not None for body in program.bodies),
        stiffest=stiffest,
    )


class _Load(NamedTuple):
    """Conductance of a load on some nodes of a body."""

    address: Address
    stiffness: Float[Array, " m"]
    """Conductance that it adds to each node [W/K]."""
    is_link: bool
    """True if the other end is a node too: the matrix of a link is up to twice as large
    as its diagonal."""


class _Rates(NamedTuple):
    """Largest explicit rates of a group, see `StableRates`."""

    at_nodes: Float[Array, ""]
    with_columns: Float[Array, ""]
    stiffest: Int[Array, ""]


def _rates(body: BodyProgram, loads: list[_Load]) -> _Rates:
    network = body.network
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
    stiffest = _stiffest(body, total)
    columns = network.columns
    if columns is None:
        return _Rates(at_nodes, with_columns=at_nodes, stiffest=stiffest)
    capacity = network.capacity() * network.min_relative_capacity()
    on_cells = jnp.arange(total.shape[0]) < columns.conductance.size
    explicit = jnp.where(on_cells, conductance, total)
    rate = jnp.maximum(network.max_rate(), (explicit / capacity).max())
    with_columns = columns.stable_rate(
        rate, stiffness=bound / network.min_relative_capacity()
    )
    return _Rates(at_nodes, with_columns=with_columns, stiffest=stiffest)


def _stiffest(body: BodyProgram, conductance: Float[Array, "..."]) -> Int[Array, ""]:
    """Number of the body with the largest ratio of conductance to capacity."""
    if body.members is None:
        return jnp.asarray(body.numbers[0])
    node = (conductance * inverse(body.network.capacity())).argmax()
    return jnp.asarray(body.numbers)[body.members.of_node[node]]


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
