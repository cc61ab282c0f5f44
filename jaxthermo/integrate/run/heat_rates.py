"""What acts on bodies, added to their states: loads, contacts and mutual radiation."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...physics.contact.links import ContactLinks
from ...scene.compile.program import Program, State


class Radiated(NamedTuple):
    """What each body's places get from what they see."""

    flux: Sequence[Float[Array, " _"] | None]
    """[W/m^2]; None where none is exchanged."""
    emits: bool
    """Whether their own emission is not yet taken off."""


def add_loads(
    program: Program,
    states: State,
    new: State,
    time: Float[Array, ""],
    dt: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """`new` with the heat of one step of everything but conduction.

    Args:
        program: of the scene.
        states: that the loads depend on.
        new: that the heat goes to.
        time: of the loads [s].
        dt: the step [s].

    Returns:
        The new states, and what each entry of the ledger brought [W].
    """
    nodes = surface_nodes(program, states)
    radiated = radiated_net(program, nodes, time)
    warmed, rates = add_own_loads(program, nodes, radiated, new, time, dt)
    return add_contacts(program, states, warmed, rates, time, dt)


def add_own_loads(
    program: Program,
    nodes: list[Float[Array, " _"]],
    radiated: "Radiated",
    new: State,
    time: Float[Array, ""],
    dt: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """Of what depends on the temperature of each node alone.

    Args:
        program: of the scene.
        nodes: temperatures of those under the surface [K].
        radiated: to each place by what it sees.
        new: that the heat goes to.
        time: of the loads [s].
        dt: the step [s].
    """
    warmed, rates = [], jnp.zeros(len(program.entries), new[0].dtype)
    for body, after in zip(program.bodies, new, strict=True):
        for source in body.sources:
            with jax.named_scope("heat_source"):
                after, rate = source.apply_heat(after, time, dt)
            rates = rates.at[source.entry].add(rate)
        warmed.append(after)
    load = _each_surface if program.joined is None else _all_surfaces
    warmed, brought = load(program, nodes, radiated, tuple(warmed), time, dt)
    return warmed, rates + brought


def _each_surface(program, nodes, radiated, new, time, dt):
    """Every body's surface for itself."""
    warmed, rates = [], jnp.zeros(len(program.entries), new[0].dtype)
    rows = zip(program.bodies, new, nodes, radiated.flux, strict=True)
    for body, after, there, flux in rows:
        if body.load is not None:
            after, each = body.load.apply_heat(
                after, body.network, there, time, dt, flux, radiated.emits
            )
            rates = rates + each
        warmed.append(after)
    return tuple(warmed), rates


def _all_surfaces(program, nodes, radiated, new, time, dt):
    """Those of all bodies as one."""
    loaded = [n for n, body in enumerate(program.bodies) if body.load is not None]
    bodies = [program.bodies[n] for n in loaded]
    pairs = zip(bodies, loaded, strict=True)
    thetas = [body.load.places.here(nodes[n]) for body, n in pairs]
    heat, rates = program.joined.heat(
        time,
        thetas,
        [
            body.network.relative_conductivity(here)
            for body, here in zip(bodies, thetas, strict=True)
        ],
        None if program.enclosure is None else [radiated.flux[n] for n in loaded],
        len(program.entries),
        radiated.emits,
    )
    warmed = list(new)
    for n, body, own in zip(loaded, bodies, heat, strict=True):
        warmed[n] = body.load.places.add(warmed[n], dt, own)
    return tuple(warmed), rates


def add_contacts(
    program: Program,
    states: State,
    new: State,
    rates: Float[Array, " c"],
    time: Float[Array, ""],
    dt: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """Of bodies that touch."""
    warmed = list(new)
    for contact in program.contacts:
        with jax.named_scope("contact"):
            rates = _swap(program, contact, states, warmed, rates, time, dt)
    return tuple(warmed), rates


def surface_nodes(program: Program, states: State) -> list[Float[Array, " _"]]:
    """Of every body, temperatures of the nodes that carry loads [K]."""
    found = []
    for body, state in zip(program.bodies, states, strict=True):
        if body.load is None:
            found.append(jnp.zeros(0, state.dtype))
            continue
        found.append(body.network.temperature(body.load.nodes_of(state)))
    return found


def radiated_net(program: Program, nodes: list, time: Float[Array, ""]) -> Radiated:
    """Irradiation less emission of each body's places, at their surfaces."""
    around = program.enclosure
    given = irradiation(program, nodes, time)
    if around is None:
        return Radiated(given.flux, emits=False)
    with jax.named_scope("emission"):
        surface = tuple(
            here
            if terms is None
            else here + terms.radiating(heat).surface_excess(time, here)
            for (terms, here), heat in zip(
                _at_places(program, nodes), given.flux, strict=True
            )
        )
        return Radiated(around.net(time, surface), emits=False)


def irradiation(program: Program, nodes: list, time: Float[Array, ""]) -> Radiated:
    """Of each body's places, at their nodes' temperatures."""
    around = program.enclosure
    if around is None:
        return Radiated([None] * len(program.bodies), emits=True)
    with jax.named_scope("emission"):
        each = tuple(here for _, here in _at_places(program, nodes))
        return Radiated(around.irradiation(time, each), emits=True)


def _at_places(program: Program, nodes: list) -> list:
    return [
        (None, there)
        if body.load is None
        else body.load.places.at_places(body.network, there)
        for body, there in zip(program.bodies, nodes, strict=True)
    ]


def pair_temperatures(
    program: Program, contact: ContactLinks, states: State
) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """Of the nodes on both sides of every touching pair, above the references [K]."""
    first, second = (
        program.bodies[body].network.temperature(
            states[body].at[address].get(mode="promise_in_bounds")
        )
        for body, address in zip(contact.bodies, contact.address, strict=True)
    )
    return first, second


def _swap(program, contact, states, new, rates, time, dt):
    """Heat that two bodies exchange, put into `new` in place; what passes, in rates."""
    one, other = contact.bodies
    theta = pair_temperatures(program, contact, states)
    references = program.bodies[one].reference, program.bodies[other].reference
    both = new[one], new[other]
    (new[one], new[other]), rate = contact.apply_heat(both, theta, references, time, dt)
    return rates.at[contact.entry].add(rate)
