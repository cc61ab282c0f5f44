"""Loads that are linear in their nodes' temperatures, summed node by node beforehand.

Where every law is w d(t) - s T_s with s constant, the balance at the surface has one
solution for all times and temperatures, and a node gets from its places

    heat rate = sum_d a_d d(t) - b T_node,    a_d = sum w G / (G + s),
                                              b = sum s G / (G + s),

with G the half cell's conductance. The time loop then touches no places at all: in a
network of nodes it is part of the loop that conducts. `SurfaceLoad`, place by place, is
the simple form of the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced
from ...network.network import (
    AbstractNetwork,
    AbstractNodeNetwork,
    inverse,
    precise_sum,
)
from ...network.nonlinear import NonlinearNetwork
from ...physics.surface_energy_balance import NumberedTerms
from ...physics.term import LinearLaw
from ...physics.time_varying import value_at
from ..compile.program import BodyProgram, Program
from .linear_surface_balance import LinearBalance
from .surface_load import AbstractLoad, SurfaceLoad


FEW = 1 / 8
"""Share of the nodes below which those under the surface are picked out of them."""


class EntrySums(eqx.Module):
    """What one entry of the ledger gets from all nodes."""

    number: int = eqx.field(static=True)
    driven: Float[Array, " d"]
    """By each drive [W per unit of it]."""
    slope: Float[Array, " n"] | None
    """Lost by each node [W/K]; None for nothing."""


class NodeLoad(AbstractLoad):
    """What acts on a body's surface, by its nodes."""

    by_place: SurfaceLoad
    drives: tuple[Any, ...]
    """Numbers or functions of time."""
    driven: tuple[Float[Array, " n"], ...]
    """a of every drive, at every node [W per unit of it]."""
    slope: Float[Array, " n"] | None
    """b [W/K]; None for nothing."""
    sums: tuple[EntrySums, ...]
    everywhere: bool = eqx.field(static=True)
    """Whether arrays go over all nodes of the body, in order; or those under places."""

    @property
    def places(self) -> SurfaceLoad:
        """The same, place by place."""
        return self.by_place

    def nodes_of(self, state: Float[Array, "..."]) -> Float[Array, " m"]:
        """Of all nodes, or of those under the surface."""
        return state if self.everywhere else self.places.nodes_of(state)

    def apply_heat(
        self,
        new: Float[Array, "..."],
        network: AbstractNetwork,
        nodes: Float[Array, " m"],
        time: Float[Array, ""],
        dt: Float[Array, ""],
        radiated: Float[Array, " p"] | None = None,
        emits: bool = False,
    ) -> tuple[Float[Array, "..."], Float[Array, " c"]]:
        """`new` with the heat of one step, and what each entry brings [W]."""
        del radiated, emits
        now = [value_at(drive, time) for drive in self.drives]
        rate = jnp.zeros_like(nodes) if self.slope is None else -self.slope * nodes
        for each, drive in zip(self.driven, now, strict=True):
            rate = rate + each * drive
        names = self.places.terms.names
        by_entry = jnp.zeros(len(names), nodes.dtype)
        for entry in self.sums:
            with jax.named_scope(names[entry.number]):
                pairs = zip(entry.driven, now, strict=True)
                brought = sum(each * drive for each, drive in pairs)
                if entry.slope is not None:
                    brought = brought - precise_sum(entry.slope * nodes)
                by_entry = by_entry.at[entry.number].add(brought)
        if self.everywhere:
            return new + dt * inverse(network.capacity()) * rate, by_entry
        return self.places.add_nodes(new, dt, rate), by_entry


def by_nodes(programs: Sequence[Program]) -> tuple[Program, ...] | None:
    """Programs whose loads are summed by nodes; None where one of them is not linear.

    Args:
        programs: of all moments, not joined.
    """
    made = []
    for program in programs:
        bodies = tuple(_by_nodes(body) for body in program.bodies)
        if program.enclosure is not None or any(body is None for body in bodies):
            return None
        made.append(replace(program, bodies=bodies))
    return tuple(made)


def _by_nodes(body: BodyProgram) -> BodyProgram | None:
    """One body; None if what acts on it is not linear."""
    load = body.load
    if load is None:
        return body
    if isinstance(body.network, NonlinearNetwork) or not isinstance(load, SurfaceLoad):
        return None
    free, held = _linear(load.terms.natural), _linear(load.terms.prescribed)
    if free is None or held is None:
        return None
    return replace(body, load=_node_load(load, body.network, free, held))


def _linear(terms: NumberedTerms) -> list[LinearLaw] | None:
    """Of all terms; None if one is not linear."""
    found = [law for law in (term.law.linear() for _, term in terms) if law is not None]
    return found if len(found) == len(terms) else None


def _node_load(
    load: SurfaceLoad,
    network: AbstractNetwork,
    free: list[LinearLaw],
    held: list[LinearLaw],
) -> NodeLoad:
    """Sums over places."""
    traced, width = is_traced((load, free, held)), load.terms.half_cell.dtype
    places = LinearBalance(load.terms, free, held, traced)
    everywhere, sums = _sums(load, network, traced)
    to_nodes = lambda values: jnp.asarray(sums(values), width)
    drives = range(len(places.drives))
    entries = []
    for number in places.entries:
        slope = places.slope(number)
        totals = [places.brought(number, drive).sum() for drive in drives]
        entries.append(
            EntrySums(
                number=number,
                driven=jnp.stack([jnp.asarray(total, width) for total in totals]),
                slope=None if slope is None else to_nodes(slope),
            )
        )
    slopes = [entry.slope for entry in entries if entry.slope is not None]
    return NodeLoad(
        by_place=load,
        drives=tuple(places.drives),
        driven=tuple(to_nodes(places.driven(drive)) for drive in drives),
        slope=sum(slopes[1:], slopes[0]) if slopes else None,
        sums=tuple(entries),
        everywhere=everywhere,
    )


def _sums(
    load: SurfaceLoad, network: AbstractNetwork, traced: bool
) -> tuple[bool, Callable[[Any], Any]]:
    """Whether sums go to all nodes, and from values of places to those of nodes."""
    index, count = load.node, load.slots[0].shape[0]
    everywhere = False
    if isinstance(network, AbstractNodeNetwork):
        nodes = network.node_capacity.shape[0]
        everywhere = count >= FEW * nodes
        if everywhere:
            index, count = load.address[0][index], nodes
    if traced:
        return everywhere, lambda values: jax.ops.segment_sum(values, index, count)
    host = np.asarray(index)
    return everywhere, lambda values: np.bincount(host, values, count)
