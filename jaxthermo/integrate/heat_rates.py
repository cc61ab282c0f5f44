"""Heat of surface terms, sources and contacts, added to the states of bodies."""

from collections.abc import Callable, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import taken
from ..network.network import AbstractNetwork, inverse
from ..physics.contact.links import ContactLinks, PairNodes
from ..physics.half_cells import VaryingHalfCells
from ..scene.compile.program import Program, State
from ..scene.compile.surface_load import AbstractSurfaceLoad


_Nodes = list[Float[Array, " _"]]
"""Temperatures above the reference [K], per body with a surface load."""


def add_loads(
    program: Program,
    states: State,
    new: State,
    time: Float[Array, ""],
    dt: Float[Array, ""],
    start: State | None = None,
) -> tuple[State, Float[Array, " c"]]:
    """Add the heat of one step, of everything but conduction, to `new`.

    Loads depend on `time` and on `states`, which are changes since `start` if that is
    not None. Returns the new states, and the heat rate of each ledger entry [W].
    """
    # All loads of a step act at the temperatures before it.
    program = program.in_air(states, start)
    nodes = _surface_nodes(program, states, start)
    received = _net_irradiation(program, nodes, time)
    after_loads, rates = _add_own_loads(
        program, nodes=nodes, received=received, emits=False, new=new, time=time, dt=dt
    )
    # The heat that one body loses the other gains, from the same temperatures.
    warmed = list(after_loads)
    for contact in program.contacts:
        with jax.named_scope("contact"):
            heat = contact.heat(time, pair_nodes(program, contact, states, start))
            for side, body in enumerate(contact.bodies):
                warmed[body] = contact.apply_heat(side, warmed[body], heat.rate, dt)
            rates = rates.at[np.array(contact.entries)].add(contact.sums(heat.rate))
    return tuple(warmed), rates


def _add_own_loads(
    program: Program,
    nodes: _Nodes,
    received: Float[Array, " p"] | None,
    emits: bool,
    new: State,
    time: Float[Array, ""],
    dt: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """Add the heat that depends on the temperature of each node and of air alone.

    `received` is the irradiation of the surface cells [W/m^2], None without exchange;
    `emits` is False if their own emission is already subtracted from it.
    """
    warmed = []
    rates = jnp.zeros(len(program.entries), new[0].dtype)
    for body, body_state in zip(program.bodies, new, strict=True):
        for source in body.sources:
            with jax.named_scope("heat_source"):
                body_state, rate = source.apply_heat(body_state, time, dt)
            rates = rates.at[np.array(source.entries)].add(rate)
        warmed.append(body_state)
    load = program.surface
    if load is not None:
        networks = _networks(program, load)
        heat, surface_rates = load.heat(time, nodes, networks, received, emits)
        rates = rates + surface_rates
        for index, cells in enumerate(load.by_cell.cells):
            body_state = warmed[cells.body]
            warmed[cells.body] = load.add(
                index, body_state, networks[index], dt, heat[index]
            )
    for air in program.airs:
        number = program.group_of(air.body)
        capacity = program.bodies[number].network.total_capacity()
        rate = air.heat_rate(time, capacity, rates)
        warmed[number] = warmed[number] + dt * rate / capacity
        rates = rates.at[air.entry].add(rate)
    return tuple(warmed), rates


def _networks(program: Program, load: AbstractSurfaceLoad) -> list[AbstractNetwork]:
    return [program.bodies[cells.body].network for cells in load.by_cell.cells]


def _surface_nodes(
    program: Program, states: State, start: State | None = None
) -> _Nodes:
    """Temperatures of the nodes that carry surface loads, by body [K]."""
    load = program.surface
    if load is None:
        return []
    node_temperatures = []
    for index, cells in enumerate(load.by_cell.cells):
        nodes = load.nodes_of(index, states[cells.body])
        if start is not None:
            # Gathered apart: the sum of whole states is not needed in memory.
            nodes = nodes + load.nodes_of(index, start[cells.body])
        network = program.bodies[cells.body].network
        node_temperatures.append(network.temperature(nodes, cells.address))
    return node_temperatures


def _net_irradiation(
    program: Program, nodes: Sequence[Float[Array, " _"]], time: Float[Array, ""]
) -> Float[Array, " p"] | None:
    """Irradiation less emission of the surface cells [W/m^2]; None without exchange."""
    # The nodes' temperatures give a first irradiation, and that the temperatures of the
    # surface, which emits: two evaluations instead of a solve.
    irradiation = _irradiation(program, nodes, time)
    if irradiation is None or program.surface is None or program.enclosure is None:
        return None
    load = program.surface.by_cell
    with jax.named_scope("emission"):
        # Surface temperatures with the irradiation by nodes; then the exchange between
        # surfaces of these temperatures, in which no heat is lost.
        terms, node_theta = load.conducting(nodes, _networks(program, load))
        surface = node_theta + terms.irradiated(irradiation).surface_excess(
            time, node_theta
        )
        return program.enclosure.net(time, surface)


def _irradiation(
    program: Program, nodes: Sequence[Float[Array, " _"]], time: Float[Array, ""]
) -> Float[Array, " p"] | None:
    """Irradiation of the surface cells by surfaces as warm as their nodes [W/m^2].

    Surfaces of prescribed temperature radiate at that.
    """
    if program.enclosure is None or program.surface is None:
        return None
    load = program.surface.by_cell
    with jax.named_scope("emission"):
        terms, node_theta = load.conducting(nodes, _networks(program, load))
        radiating = node_theta + terms.prescribed_excess(time, node_theta)
        return program.enclosure.irradiation(time, radiating)


def pair_conductance(contact: ContactLinks, time: Float[Array, ""]):
    """Return the conductance of every touching pair [W/K]."""
    ones = jnp.ones_like(contact.area)
    zero = jnp.zeros((), contact.area.dtype)
    return contact.heat(time, PairNodes((ones, 0 * ones), (zero, zero))).rate


def pair_nodes(
    program: Program,
    contact: ContactLinks,
    states: State,
    start: State | None = None,
) -> PairNodes:
    """Return the nodes of every touching pair, and what they conduct to the contact.

    The states are changes since `start` if that is not None.
    """
    bodies = [program.bodies[body] for body in contact.bodies]
    values = pair_values(contact, states)
    if start is not None:
        rises = zip(values, pair_values(contact, start), strict=True)
        values = [change + before for change, before in rises]
    first, second = (
        body.network.temperature(body_values, address)
        for body, body_values, address in zip(
            bodies, values, contact.address, strict=True
        )
    )
    varying = None
    if any(body.network.conductivity_varies for body in bodies):
        cells_a, cells_b = (
            VaryingHalfCells(
                networks=(body.network,),
                fractions=(end.conductivity_parts,),
                counts=end.fragment.shape,
            )
            for body, end in zip(bodies, contact.ends, strict=True)
        )
        varying = cells_a, cells_b
    return PairNodes(
        theta=(first, second),
        references=(
            bodies[0].reference_at(contact.address[0]),
            bodies[1].reference_at(contact.address[1]),
        ),
        varying=varying,
    )


def pair_values(contact: ContactLinks, states: State) -> list[Float[Array, " p"]]:
    """Return the values of the two nodes of every touching pair."""
    return [
        taken(states[body], address)
        for body, address in zip(contact.bodies, contact.address, strict=True)
    ]


def evaluate_rates(
    program: Program, states: State, time: Float[Array, ""]
) -> tuple[State, Float[Array, " c"]]:
    """Return d(state)/dt of every node [K/s], and each ledger entry's heat rate [W].

    d eta / dt = (conduction + loads) / C,

    for the state eta of every node, see `network`. An explicit step computes the same
    with fused operators; implicit stages evaluate it at states that they iterate.
    Conduction is summed over faces, see `AbstractNetwork.face_heat_rate`.
    """
    zero = tuple(jnp.zeros_like(state) for state in states)
    one_second = jnp.ones((), states[0].dtype)
    # Loads added to a zero state over one second are their rates.
    loaded, entries = add_loads(
        program, states=states, new=zero, time=time, dt=one_second
    )
    change = tuple(
        added + inverse(body.network.capacity()) * body.network.face_heat_rate(state)
        for added, body, state in zip(loaded, program.bodies, states, strict=True)
    )
    return change, entries


def load_slopes(
    program: Program, states: State, time: Float[Array, ""]
) -> tuple[State, Float[Array, " c"]]:
    """Return -d(loads)/d(state) of all loads but contacts, never negative.

    The first is that of every node [1/s], the second that of each ledger entry, summed
    over its nodes [W/K].
    """
    loads = _loads_of_nodes(program, states, time)
    # In air of the present temperatures these loads act at single nodes, so that one
    # derivative along all ones is the whole diagonal Jacobian.
    ones = tuple(jnp.ones_like(state) for state in states)
    _, changes = jax.jvp(partial(loads, program.in_air(states)), (states,), (ones,))
    slopes, entries = jax.tree.map(lambda change: jnp.maximum(-change, 0), changes)
    slopes = list(slopes)
    for air in air_couplings(program, states, time):
        slopes[air.body] = air.own_slope
    return tuple(slopes), entries


class AirCoupling(Module):
    """Derivatives of heat rates between all nodes and a body of air."""

    body: int = eqx.field(static=True)
    """Number of the body of air in the program."""
    into_nodes: State
    """Heat rate into each node by a rise of the air [W/K]; 0 for the air itself."""
    into_air: State
    """Heat rate into the air by a rise of each node [W/K]; 0 for the air itself."""
    own_slope: Float[Array, " 1"]
    """Heat rate that the air loses by its own rise, over its capacity [1/s]."""
    is_symmetric: bool = eqx.field(static=True)
    """True if `into_nodes` and `into_air` are equal."""


def air_couplings(
    program: Program, states: State, time: Float[Array, ""]
) -> list[AirCoupling]:
    """Return the derivatives of all heat rates to and from bodies of air."""
    if not program.airs:
        return []
    loads = _loads_of_nodes(program, states, time)

    def rates(states: State) -> State:
        rises, _ = loads(program.in_air(states), states)
        return tuple(
            rise * body.network.capacity()
            for rise, body in zip(rises, program.bodies, strict=True)
        )

    # Half cells whose conductivity varies conduct by the potential of the surface, and
    # nodes whose capacity varies have states of their own.
    is_symmetric = all(body.network.is_linear for body in program.bodies)
    couplings = []
    for air in program.airs:
        group = program.group_of(air.body)
        rise = tuple(
            jnp.full_like(state, number == group) for number, state in enumerate(states)
        )
        _, into_nodes = jax.jvp(rates, (states,), (rise,))
        into_air = into_nodes
        if not is_symmetric:
            _, pullback = jax.vjp(rates, states)
            (into_air,) = pullback(rise)
        capacity = program.bodies[group].network.capacity()
        couplings.append(
            AirCoupling(
                body=group,
                into_nodes=_without(into_nodes, group),
                into_air=_without(into_air, group),
                own_slope=-into_nodes[group] / capacity,
                is_symmetric=is_symmetric,
            )
        )
    return couplings


def _without(states: State, body: int) -> State:
    """States with 0 for a body."""
    return tuple(
        jnp.zeros_like(state) if number == body else state
        for number, state in enumerate(states)
    )


def _loads_of_nodes(
    program: Program, states: State, time: Float[Array, ""]
) -> Callable[[Program, State], tuple[State, Float[Array, " c"]]]:
    """All loads but contacts as a function of a program and states.

    It returns the rate of every node [K/s] and the heat rate of each entry [W].
    """
    # Irradiation is constant here: what bodies emit counts, what returns does not.
    irradiation = _irradiation(program, _surface_nodes(program, states), time)
    zero = tuple(jnp.zeros_like(state) for state in states)
    one_second = jnp.ones((), states[0].dtype)

    def loads(program: Program, states: State) -> tuple[State, Float[Array, " c"]]:
        return _add_own_loads(
            program,
            nodes=_surface_nodes(program, states),
            received=irradiation,
            emits=True,
            new=zero,
            time=time,
            dt=one_second,
        )

    return loads
