"""Surface loads that are linear in their nodes' temperatures, summed beforehand.

Where every law is w d(t) - s T_s with s constant, the balance at the surface has one
solution for all times and temperatures. With weights w of forcings d(t), slopes s and
the half cell's conductance G, each a sum over the terms at a cell, the node receives

    q = G / (G + s) (w d(t) - s T_node),

and a term with weight w_e and slope s_e brings

    q_e = w_e d(t) - s_e (w d(t) + G T_node) / (G + s).

Sums over the cells of a node leave one coefficient per forcing and one slope per node.
The time loop then evaluates no cells at all: in a network of nodes the load is part of
the loop that conducts. `SurfaceLoad`, cell by cell, is the general form.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import is_traced
from ...network.network import (
    AbstractNetwork,
    AbstractNodeNetwork,
    inverse,
    precise_sum,
)
from ...network.nonlinear import NonlinearNetwork
from ...physics.flux_law import BoundTerm, LinearLaw
from ...physics.surface_energy_balance import NumberedTerms, SurfaceTerms
from ...physics.time_varying import value_at
from .program import Program
from .surface_load import AbstractSurfaceLoad, BodyCells, SurfaceLoad


# Fraction of a body's nodes below which those under the surface are gathered.
_MIN_SURFACE_FRACTION = 1 / 8


class _EntrySums(eqx.Module):
    """Heat rate of one ledger entry, summed over the nodes of a body."""

    entry: int = eqx.field(static=True)
    name: str = eqx.field(static=True)
    forced: Float[Array, " d"]
    """By each forcing [W per unit of it]."""
    slope: Float[Array, " n"] | None
    """Lost by each node [W/K]; None for nothing."""


class _LinearNodes(eqx.Module):
    """Linear heat rates of the nodes of one body."""

    forcings: tuple[Any, ...]
    """Numbers or functions of time."""
    forced: tuple[Float[Array, " n"], ...]
    """Heat rate of every node by each forcing [W per unit of it]."""
    slope: Float[Array, " n"] | None
    """Lost by each node [W/K]; None for nothing."""
    sums: tuple[_EntrySums, ...]
    everywhere: bool = eqx.field(static=True)
    """True if arrays cover all nodes of the body, in order; else those with cells."""


class LinearSurfaceLoad(AbstractSurfaceLoad):
    """Heat of all surface terms, summed for the nodes beforehand."""

    general: SurfaceLoad
    bodies: tuple[_LinearNodes, ...]
    """Heat rates of the bodies that have cells."""

    @property
    @override
    def by_cell(self) -> SurfaceLoad:
        return self.general

    @override
    def nodes_of(self, index: int, state: Float[Array, "..."]) -> Float[Array, " m"]:
        if self.bodies[index].everywhere:
            return state
        return self.general.nodes_of(index, state)

    @override
    def heat(
        self,
        time: Float[Array, ""],
        nodes: Sequence[Float[Array, " _"]],
        networks: Sequence[AbstractNetwork],
        received: Float[Array, " p"] | None = None,
        emits: bool = False,
    ) -> tuple[list[Float[Array, " _"]], Float[Array, " c"]]:
        heat, by_entry = [], jnp.zeros(self.general.entry_count, nodes[0].dtype)
        for body, theta in zip(self.bodies, nodes, strict=True):
            now = [value_at(forcing, time) for forcing in body.forcings]
            rate = jnp.zeros_like(theta) if body.slope is None else -body.slope * theta
            for each, forcing in zip(body.forced, now, strict=True):
                rate = rate + each * forcing
            heat.append(rate)
            for sums in body.sums:
                with jax.named_scope(sums.name):
                    pairs = zip(sums.forced, now, strict=True)
                    brought = sum(each * forcing for each, forcing in pairs)
                    if sums.slope is not None:
                        brought = brought - precise_sum(sums.slope * theta)
                    by_entry = by_entry.at[sums.entry].add(brought)
        return heat, by_entry

    @override
    def add(
        self,
        index: int,
        new: Float[Array, "..."],
        network: AbstractNetwork,
        dt: Float[Array, ""],
        heat: Float[Array, " _"],
    ) -> Float[Array, "..."]:
        if self.bodies[index].everywhere:
            # A sum over all nodes is part of the loop that conducts; a scatter is not.
            return new + dt * inverse(network.capacity()) * heat
        return self.general.cells[index].add(new, dt, heat)


def linear_programs(programs: Sequence[Program]) -> tuple[Program, ...] | None:
    """Programs with linear surface loads; None where one of them is not linear."""
    made = []
    for program in programs:
        if program.surface is None:
            made.append(program)
            continue
        load = _linear_load(program, program.surface.by_cell)
        if load is None:
            return None
        made.append(replace(program, surface=load))
    return tuple(made)


def _linear_load(program: Program, load: SurfaceLoad) -> LinearSurfaceLoad | None:
    if program.enclosure is not None:
        return None
    bodies = []
    for index, cells in enumerate(load.cells):
        network = program.bodies[cells.body].network
        # Where conductivity varies, so does the half cell.
        if isinstance(network, NonlinearNetwork):
            return None
        terms = load.terms_on(index)
        natural, prescribed = _linear(terms.natural), _linear(terms.prescribed)
        if natural is None or prescribed is None:
            return None
        entries = [row[index] for row in load.entries]
        balance = _LinearBalance(terms, natural, prescribed)
        bodies.append(_linear_nodes(cells, network, balance, entries))
    return LinearSurfaceLoad(load, tuple(bodies))


def _linear(terms: NumberedTerms) -> list[LinearLaw] | None:
    """The linear laws of all terms; None if one is not linear."""
    found = [law for law in (term.law.linear() for _, term in terms) if law is not None]
    return found if len(found) == len(terms) else None


def _linear_nodes(
    cells: BodyCells,
    network: AbstractNetwork,
    balance: "_LinearBalance",
    entries: list[int],
) -> _LinearNodes:
    everywhere, sums = _sums(cells, network, balance.traced)
    to_nodes = lambda values: jnp.asarray(sums(values), balance.dtype)
    number = lambda value: jnp.asarray(value, balance.dtype)
    forcings = range(len(balance.forcings))
    found = []
    for term in balance.numbers:
        slope = balance.slope(term)
        totals = [balance.brought(term, forcing).sum() for forcing in forcings]
        found.append(
            _EntrySums(
                entry=entries[term],
                name=balance.names[term],
                forced=jnp.stack([number(total) for total in totals]),
                slope=None if slope is None else to_nodes(slope),
            )
        )
    # All slopes of a node act on the same temperature: one array for the time loop.
    slopes = [entry.slope for entry in found if entry.slope is not None]
    return _LinearNodes(
        forcings=tuple(balance.forcings),
        forced=tuple(to_nodes(balance.forced(forcing)) for forcing in forcings),
        slope=sum(slopes[1:], slopes[0]) if slopes else None,
        sums=tuple(found),
        everywhere=everywhere,
    )


def _sums(
    cells: BodyCells, network: AbstractNetwork, traced: bool
) -> tuple[bool, Callable[[Any], Any]]:
    # True if sums are for all nodes; and a function from values of cells to nodes.
    index, count = cells.node, cells.slots[0].shape[0]
    everywhere = False
    if isinstance(network, AbstractNodeNetwork):
        nodes = network.node_capacity.shape[0]
        everywhere = count >= _MIN_SURFACE_FRACTION * nodes
        if everywhere:
            index, count = cells.address[0][index], nodes
    if traced:
        return everywhere, lambda values: jax.ops.segment_sum(values, index, count)
    host = np.asarray(index)
    return everywhere, lambda values: np.bincount(host, values, count)


class _Part(NamedTuple):
    """A term on the cells."""

    number: int
    forcing: int
    weight: Any
    """[W per unit of the forcing]"""
    slope: Any
    """[W/K]; None for nothing."""


class _LinearBalance:
    """The balance of all cells, solved: arrays with one value per cell."""

    # On the host in double precision where nothing is traced: the sums over cells are
    # then as exact as the general form in the time loop.

    def __init__(
        self, terms: SurfaceTerms, natural: list[LinearLaw], prescribed: list[LinearLaw]
    ):
        self.traced = is_traced((terms, natural, prescribed))
        self.names, self.dtype = terms.names, terms.half_cell.dtype
        self._own: Any = jnp if self.traced else np
        self._precise = self.dtype if self.traced else np.float64
        # The first forcing is 1: all constant terms share it.
        self.forcings: list[Any] = [jnp.ones((), self.dtype)]
        part = self._part
        self._natural = [part(*e) for e in zip(terms.natural, natural, strict=True)]
        self._prescribed = [
            part(*e) for e in zip(terms.prescribed, prescribed, strict=True)
        ]
        self._cell = self._number(terms.half_cell)
        both = self._cell + self._slope(self._natural)
        some = self._own.where(both > 0, both, 1)
        # Of the heat at a surface, the fraction that goes to its node; the rest is
        # lost by the terms.
        self._through = self._own.where(both > 0, self._cell, 0) / some
        self._lost = self._own.where(both > 0, 1, 0) / some

    @property
    def numbers(self) -> list[int]:
        """Numbers of the terms."""
        return sorted({part.number for part in (*self._natural, *self._prescribed)})

    def forced(self, forcing: int) -> Any:
        """Heat to the node [W per unit of the forcing]."""
        natural = self._weight(self._natural, forcing) * self._through
        return natural + self._weight(self._prescribed, forcing)

    def brought(self, number: int, forcing: int) -> Any:
        """Heat of one term at the temperature that all of them cause [W per unit]."""
        natural, prescribed = self._of(number)
        lost = self._slope(natural) * self._lost * self._weight(self._natural, forcing)
        return self._weight([*natural, *prescribed], forcing) - lost

    def slope(self, number: int) -> Any:
        """Heat that the node loses to a term [W/K]; None for nothing."""
        natural, prescribed = self._of(number)
        if all(part.slope is None for part in (*natural, *prescribed)):
            return None
        return self._slope(natural) * self._through + self._slope(prescribed)

    def _of(self, number: int) -> tuple[list[_Part], list[_Part]]:
        of = lambda parts: [part for part in parts if part.number == number]
        return of(self._natural), of(self._prescribed)

    def _number(self, value: Any) -> Any:
        return self._own.asarray(value, self._precise)

    def _weight(self, parts: list[_Part], forcing: int) -> Any:
        return sum((p.weight for p in parts if p.forcing == forcing), 0 * self._cell)

    def _slope(self, parts: list[_Part]) -> Any:
        return sum((p.slope for p in parts if p.slope is not None), 0 * self._cell)

    def _part(self, numbered: tuple[int, BoundTerm], law: LinearLaw) -> _Part:
        number, term = numbered
        area, forcing = self._number(term.effective_area), 0
        weight = area * self._number(law.weight)
        if not callable(law.forcing):
            weight = weight * self._number(law.forcing)
        else:
            # Terms of one function of time, such as one air, share its forcing.
            same = (d for d, each in enumerate(self.forcings) if law.forcing is each)
            forcing = next(same, len(self.forcings))
            if forcing == len(self.forcings):
                self.forcings.append(law.forcing)
        slope = None if law.slope is None else area * self._number(law.slope)
        return _Part(number, forcing, weight, slope)
