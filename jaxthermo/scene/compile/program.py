"""A compiled scene: all that the solver needs, and nothing else."""

import bisect
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float, Int

from ...network.network import AbstractNetwork, Address
from ...physics.contact.links import ContactLinks
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.time_varying import value_at
from ...structures.surface.surface_map import BoundMap
from ..loads.joined import JoinedLoad
from ..loads.surface_load import AbstractLoad
from ..receipt import Receipt
from ..solved_surface import SolvedSurface


State = tuple[Float[Array, "..."], ...]
"""Temperature above the reference at every node, one array a body [K]; where the heat
capacity depends on temperature, heat over the capacity at the reference."""


class LedgerEntry(NamedTuple):
    """One line of the energy ledger: what a mechanism brings to a body."""

    mechanism: str
    body: int
    other: int | None = None
    """Where two bodies exchange heat, the one that it goes to, from `body`."""


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

    def apply_heat(
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
    exposed_fraction: Float[Array, "*s"]
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
                excess = excess * self.exposed_fraction + pressed
        return self.surface_map.read(theta, nodes, below, self.node, excess)


class BodyProgram(eqx.Module):
    """One body: its network, what acts on it, and how its surface is read."""

    network: AbstractNetwork
    reference: Float[Array, ""]
    """What the state counts from [K]."""
    load: AbstractLoad | None
    """None if nothing acts on the surface."""
    sources: tuple[VolumeLoad, ...]
    reading: SurfaceReading


class Program(eqx.Module):
    """All that the solver needs, and nothing else."""

    bodies: tuple[BodyProgram, ...]
    joined: JoinedLoad | None
    """The bodies' surface loads as one; None where fewer than two have one."""
    contacts: tuple[ContactLinks, ...]
    enclosure: Enclosure | None
    """What bodies radiate to each other, on the places of their surfaces."""
    fine_enclosure: Enclosure | None
    """The same on fragments, for reading."""
    entries: tuple[LedgerEntry, ...] = eqx.field(static=True)
    breakpoints: tuple[float, ...] = eqx.field(static=True)
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
    hottest: Float[Array, ""]
    """That anything gets up to the end [K]."""
    receipt: Receipt = eqx.field(static=True)

    @property
    def program(self) -> Program:
        """The first one; the only one where nothing moves."""
        return self.programs[0]

    def number_at(self, time: float) -> int:
        """Which program holds from a time on [s]."""
        return bisect.bisect_right(self.starts, time * (1 + 1e-12)) - 1
