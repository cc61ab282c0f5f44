"""A compiled scene: all that the solver needs, and nothing else."""

import bisect
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..network.network import AbstractNetwork, Address
from ..physics.balance import SurfaceTerms
from ..physics.contact.links import ContactLinks
from ..physics.radiation.mutual import Enclosure
from ..physics.values import value_at
from ..structures.surface_map import BoundMap
from .receipt import Receipt
from .surface import SolvedSurface


State = tuple[Float[Array, "..."], ...]
"""Temperature above the reference at every node, one array a body [K]; where the heat
capacity depends on temperature, heat over the capacity at the reference."""


class Entry(NamedTuple):
    """One line of the energy ledger: what a mechanism brings to a body."""

    mechanism: str
    body: int
    other: int | None = None
    """Where two bodies exchange heat, the one that it goes to, from `body`."""


class SurfaceLoad(eqx.Module):
    """What acts on a body's surface in the time loop.

    Fragments of one node on which the same terms act are one place; a fragment on which
    nothing acts has none. Places are summed by gathering, and every node is then
    written once, which is several times faster than adding to it in turn.
    """

    address: Address
    """Of the nodes that have such places, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Of those nodes [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Of each place, its node among them."""
    slots: tuple[Int[Array, " m"], ...]
    """Of each node, its k-th place; one past the last where it has fewer."""
    terms: SurfaceTerms
    """On the places."""

    def _by_node(self, values: Float[Array, " p"]) -> Float[Array, " m"]:
        padded = jnp.append(values, jnp.zeros(1, values.dtype))
        gather = lambda slot: padded.at[slot].get(mode="promise_in_bounds")
        return sum((gather(slot) for slot in self.slots[1:]), gather(self.slots[0]))

    def at_places(
        self, network: AbstractNetwork, nodes: Float[Array, " m"]
    ) -> tuple[SurfaceTerms, Float[Array, " p"]]:
        """What acts on the places, and the temperatures of their nodes [K]."""
        here = nodes.at[self.node].get(mode="promise_in_bounds")
        return self.terms.conducting(network.relative_conductivity(here)), here

    def warm(
        self,
        new: Float[Array, "..."],
        network: AbstractNetwork,
        nodes: Float[Array, " m"],
        time: Float[Array, ""],
        dt: Float[Array, ""],
        radiated: Float[Array, " p"] | None = None,
    ) -> tuple[Float[Array, "..."], Float[Array, " c"]]:
        """`new` with the heat of one step, and what each entry brings [W].

        The state stays three-dimensional here: flattening it for the scatter would make
        XLA compute the whole stencil with flat indices, slowly.

        Args:
            new: the state so far.
            network: of the body.
            nodes: temperatures at `address` before the step, above the reference [K].
            time: of the loads [s].
            dt: the step [s].
            radiated: net, to each place by what it sees [W/m^2].
        """
        terms, here = self.at_places(network, nodes)
        if radiated is not None:
            terms = terms.radiating(radiated, emits=False)
        heat, by_entry = terms.heat(time, here)
        rise = dt * self._by_node(heat) / self.capacity
        warmed = new.at[self.address].add(
            rise,
            mode="promise_in_bounds",
            indices_are_sorted=True,
            unique_indices=True,
        )
        return warmed, by_entry

    def stiffness(
        self, hottest: Float[Array, ""], end: float, relative: Float[Array, ""]
    ) -> Float[Array, " m"]:
        """What it adds to each node's conductances in the stable step [W/K].

        Args:
            hottest: that surfaces can get [K].
            end: of the run [s].
            relative: the largest conductivity over that at the reference.
        """
        return self._by_node(self.terms.stiffness(hottest, end, relative))


class VolumeLoad(eqx.Module):
    """Heat released inside a body."""

    entry: int = eqx.field(static=True)
    address: Address
    """Of the nodes that it reaches, in the order of the state."""
    rise: Float[Array, " m"]
    """Volume reached over capacity of each of them [m^3 K/J]."""
    volume: Float[Array, ""]
    """Of all of them [m^3]."""
    heat_rate_density: Any
    """[W/m^3]"""

    def warm(
        self, new: Float[Array, "..."], time: Float[Array, ""], dt: Float[Array, ""]
    ) -> tuple[Float[Array, "..."], Float[Array, ""]]:
        """`new` with the heat of one step, and its rate [W]."""
        density = value_at(self.heat_rate_density, time)
        warmed = new.at[self.address].add(
            dt * density * self.rise,
            mode="promise_in_bounds",
            indices_are_sorted=True,
            unique_indices=True,
        )
        return warmed, density * self.volume


class SurfaceReading(eqx.Module):
    """How the temperature of every fragment is read."""

    address: Address
    """Of the nodes that have surface, each once, in the order of the state."""
    node: Int[Array, " s"]
    """Of each fragment, its node among them."""
    terms: SurfaceTerms
    """On the fragments."""
    bare: Float[Array, "*s"]
    """Share of each fragment that nothing touches."""
    surface_map: BoundMap

    def read(
        self,
        network: AbstractNetwork,
        state: Float[Array, "..."],
        time: Float[Array, ""] | None,
        pressed: Float[Array, " s"] | None = None,
        received: Float[Array, " s"] | None = None,
    ) -> Float[Array, " s"]:
        """Of every fragment above the reference [K].

        Args:
            network: of the body.
            state: of the body.
            time: of the loads [s]; None where none has acted yet.
            pressed: excess over the node by what touches each fragment [K].
            received: by radiation from what each fragment sees [W/m^2].
        """
        theta = network.temperature(state)
        nodes = theta.at[self.address].get(mode="promise_in_bounds")
        below = nodes.at[self.node].get(mode="promise_in_bounds")
        excess = None
        if self.surface_map.needs_excess and time is not None:
            terms = self.terms.conducting(network.relative_conductivity(below))
            if received is not None:
                terms = terms.radiating(received)
            excess = terms.surface_excess(time, below)
            if pressed is not None:
                excess = excess * self.bare + pressed
        return self.surface_map.read(theta, nodes, below, self.node, excess)


class BodyProgram(eqx.Module):
    """One body: its network, what acts on it, and how its surface is read."""

    network: AbstractNetwork
    reference: Float[Array, ""]
    """What the state counts from [K]."""
    load: SurfaceLoad | None
    """None if nothing acts on the surface."""
    sources: tuple[VolumeLoad, ...]
    reading: SurfaceReading


class Program(eqx.Module):
    """All that the solver needs, and nothing else."""

    bodies: tuple[BodyProgram, ...]
    contacts: tuple[ContactLinks, ...]
    enclosure: Enclosure | None
    """What bodies radiate to each other, on the places of their surfaces."""
    fine_enclosure: Enclosure | None
    """The same on fragments, for reading."""
    entries: tuple[Entry, ...] = eqx.field(static=True)
    knots: tuple[float, ...] = eqx.field(static=True)
    """Times the solver lands on besides the save times [s]."""
    sampled: bool = eqx.field(static=True)
    """Whether some value is a function of time, known only where it is evaluated."""

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names, each once, without what bodies exchange."""
        outer = (entry.mechanism for entry in self.entries if entry.other is None)
        return tuple(dict.fromkeys(outer))

    @property
    def references(self) -> tuple[Float[Array, ""], ...]:
        """What each body's state counts from [K]."""
        return tuple(body.reference for body in self.bodies)


class Compiled(eqx.Module):
    """Programs with the initial state, surfaces and the receipt."""

    programs: tuple[Program, ...]
    """One a moment at which bodies or sources that move are taken anew; they differ in
    numbers only."""
    starts: tuple[float, ...] = eqx.field(static=True)
    """When each takes over [s]; the first at 0."""
    state: State
    surfaces: tuple[SolvedSurface, ...]
    stable_step: Float[Array, ""]
    """The largest explicit step [s]."""
    receipt: Receipt = eqx.field(static=True)

    @property
    def program(self) -> Program:
        """The first one; the only one where nothing moves."""
        return self.programs[0]

    def number_at(self, time: float) -> int:
        """Which program holds from a time on [s]."""
        return bisect.bisect_right(self.starts, time * (1 + 1e-12)) - 1
