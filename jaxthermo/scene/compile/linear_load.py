"""Surface loads that are linear in their nodes' temperatures, summed beforehand.

Where every law is w d(t) - s T_s with s constant, the balance at the surface has one
solution for all times and temperatures. With weights w of forcings d(t), slopes s and
the half cell's conductance G, each a sum over the terms at a cell, the node receives

    q = G / (G + s) (w d(t) - s T_node),

and a term with weight w_e and slope s_e contributes, with other terms j,

    q_e = [G (w_e d(t) - s_e T_node) + sum_j (w_e s_j - s_e w_j) d(t)] / (G + s).

The first part is the term's share of q, the second what the other terms take from it:
the sum over the terms is q however large the Biot number s / G is.

Sums over the cells of a node leave one coefficient per forcing and one slope per node.
The time loop then evaluates no cells at all: in a network of nodes the load is part of
the loop that conducts. `SurfaceLoad`, cell by cell, is the general form.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import Time, is_traced
from ...module import Module, replaced
from ...network.network import (
    AbstractNetwork,
    AbstractNodeNetwork,
    inverse,
    precise_sum,
)
from ...physics.flux_law import LinearLaw
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.time_varying import value_at
from .program import Program
from .surface_load import (
    AbstractSurfaceLoad,
    BodyCells,
    HeatRates,
    Networks,
    OneBody,
    PerBody,
    SurfaceLoad,
)


_MIN_SURFACE_FRACTION = 1 / 8
"""Fraction of a body's nodes below which those under the surface are gathered."""


class _LinearNodes(Module):
    """Linear heat rates of the nodes of one body, and their sums for the ledger."""

    forcings: tuple[Any, ...]
    """Numbers or functions of time."""
    forced: tuple[Float[Any, " n"], ...]
    """Heat rate of every node by each forcing [W per unit of it]."""
    slope: Float[Any, " n"] | None
    """Heat that each node loses [W/K]; None for nothing."""
    everywhere: bool = eqx.field(static=True)
    """True if arrays cover all nodes of the body, in order; else those with cells."""
    entries: tuple[int, ...] = eqx.field(static=True)
    """Ledger entry of each term."""
    names: tuple[str, ...] = eqx.field(static=True)
    """Mechanism of each ledger entry."""
    entry_forced: tuple[Float[Any, " d"], ...]
    """Heat rate of each entry by the forcings [W per unit of it]."""
    entry_slope: tuple[Float[Any, " n"] | None, ...]
    """Heat that each node loses to the entry [W/K]; None for nothing."""


class _LinearSurfaceLoad(AbstractSurfaceLoad):
    """Heat of all surface terms, summed for the nodes beforehand."""

    general: SurfaceLoad
    bodies: tuple[_LinearNodes, ...]
    """Heat rates of the bodies that have cells."""

    @property
    @override
    def by_cell(self) -> SurfaceLoad:
        return self.general

    @override
    def nodes_of(self, index: int, state: OneBody) -> Float[Array, " m"]:
        everywhere = self.bodies[index].everywhere
        return state if everywhere else super().nodes_of(index, state)

    @override
    def heat(
        self, time: Time, nodes: PerBody, networks: Networks, received=None, emits=False
    ) -> HeatRates:
        heat = []
        by_entry = jnp.zeros(self.general.entry_count, nodes[0].dtype)
        for body, theta in zip(self.bodies, nodes, strict=True):
            amplitudes = [value_at(forcing, time) for forcing in body.forcings]
            rate = jnp.zeros_like(theta) if body.slope is None else -body.slope * theta
            for forced, amplitude in zip(body.forced, amplitudes, strict=True):
                rate = rate + forced * amplitude
            heat.append(rate)
            for n, entry in enumerate(body.entries):
                with jax.named_scope(body.names[n]):
                    pairs = zip(body.entry_forced[n], amplitudes, strict=True)
                    entry_heat = sum(forced * amplitude for forced, amplitude in pairs)
                    slope = body.entry_slope[n]
                    if slope is not None:
                        entry_heat = entry_heat - precise_sum(slope * theta)
                    by_entry = by_entry.at[entry].add(entry_heat)
        return heat, by_entry

    @override
    def add(
        self,
        index: int,
        new: OneBody,
        network: AbstractNetwork,
        dt: Time,
        heat: Array,
    ) -> OneBody:
        if self.bodies[index].everywhere:
            # A sum over all nodes is part of the loop that conducts; a scatter is not.
            return new + dt * inverse(network.capacity()) * heat
        return self.general.cells[index].add(new, dt, heat)


def linear_programs(programs: Sequence[Program]) -> tuple[Program, ...] | None:
    """Programs with linear surface loads; None where one of them is not linear."""
    linear = []
    for program in programs:
        if program.surface is None:
            linear.append(program)
            continue
        load = _linear_load(program, program.surface.by_cell)
        if load is None:
            return None
        linear.append(replaced(program, surface=load))
    return tuple(linear)


def _linear_load(program: Program, load: SurfaceLoad) -> _LinearSurfaceLoad | None:
    if program.enclosure is not None:
        return None
    bodies = []
    for index, cells in enumerate(load.cells):
        network = program.bodies[cells.body].network
        terms = load.terms_on(index)
        numbered = (*terms.natural, *terms.prescribed)
        laws = [law for _, term in numbered if (law := term.law.linear()) is not None]
        # Where conductivity varies, so does the half cell.
        if not network.is_linear or len(laws) < len(numbered):
            return None
        entries = [row[index] for row in load.entries]
        bodies.append(
            _linear_nodes(
                cells, network=network, terms=terms, laws=laws, entries=entries
            )
        )
    return _LinearSurfaceLoad(load, tuple(bodies))


class EliminatedSurface(NamedTuple):
    """The balance at a surface of linear terms, solved for its temperature."""

    through: Any
    """G / (G + s) [-]: fraction of the terms' heat that goes to the node."""
    resistance: Any
    """1 / (G + s) [K/W]: excess of the surface over the node by their heat."""


def eliminate_surface(half_cell: Any, slope: Any, xp: Any = np) -> EliminatedSurface:
    """Solve the balance of half cells G and slopes s [W/K]; 0 where both are 0."""
    total = half_cell + slope
    safe_total = xp.where(total > 0, total, 1)
    return EliminatedSurface(
        through=xp.where(total > 0, half_cell, 0) / safe_total,
        resistance=xp.where(total > 0, 1, 0) / safe_total,
    )


class _LinearTerm(NamedTuple):
    """A term with a linear law on the cells of a body."""

    term: int
    forcing: int
    """Index of its forcing."""
    weight: Any
    """[W per unit of the forcing]"""
    slope: Any
    """[W/K]; None for nothing."""


def _weight(terms: list[_LinearTerm], forcing: int, half_cell: Any) -> Any:
    """Heat rate of every cell by one unit of a forcing [W per unit]."""
    acting = (term.weight for term in terms if term.forcing == forcing)
    return sum(acting, 0 * half_cell)


def _slope(terms: list[_LinearTerm], half_cell: Any) -> Any:
    """Heat that every cell loses by terms [W/K]."""
    return sum((term.slope for term in terms if term.slope is not None), 0 * half_cell)


def _linear_nodes(
    cells: BodyCells,
    network: AbstractNetwork,
    terms: SurfaceTerms,
    laws: list[LinearLaw],
    entries: list[int],
) -> _LinearNodes:
    """The balance of all cells, solved and summed by nodes."""
    # On the host in double precision where nothing is traced: the sums over cells are
    # then as exact as the general form in the time loop.
    traced = is_traced((terms, laws))
    dtype = terms.half_cell.dtype
    xp: Any = jnp if traced else np

    def number(value):
        return xp.asarray(value, dtype if traced else np.float64)

    everywhere, sums = _sums(cells, network, traced)
    forcings, linear_terms = _linear_terms(terms, laws, number)
    half_cell = number(terms.half_cell)
    natural = linear_terms[: len(terms.natural)]
    prescribed = linear_terms[len(natural) :]
    through, resistance = eliminate_surface(half_cell, _slope(natural, half_cell), xp)
    numbers = sorted({linear_term.term for linear_term in linear_terms})
    entry_forced = []
    entry_slope = []
    for number_of_term in numbers:
        exposed = [term for term in natural if term.term == number_of_term]
        fixed = [term for term in prescribed if term.term == number_of_term]
        # At the temperature that all terms cause together, without its difference to
        # w_e d, which at large Biot numbers leaves rounding times s / G.
        competing = [term for term in natural if term.term != number_of_term]
        lost_here = _slope(exposed, half_cell) * resistance
        lost_to_others = _slope(competing, half_cell) * resistance
        forced = []
        for forcing in range(len(forcings)):
            heat = _weight(exposed, forcing, half_cell) * (through + lost_to_others)
            heat = heat - lost_here * _weight(competing, forcing, half_cell)
            heat = heat + _weight(fixed, forcing, half_cell)
            forced.append(xp.asarray(heat.sum(), dtype))
        entry_forced.append(xp.stack(forced))
        slope = None
        if any(term.slope is not None for term in (*exposed, *fixed)):
            lost = _slope(exposed, half_cell) * through + _slope(fixed, half_cell)
            slope = xp.asarray(sums(lost), dtype)
        entry_slope.append(slope)
    # All slopes of a node act on the same temperature: one array for the time loop.
    slopes = [slope for slope in entry_slope if slope is not None]
    forced_nodes = []
    for forcing in range(len(forcings)):
        heat = _weight(natural, forcing, half_cell) * through
        heat = heat + _weight(prescribed, forcing, half_cell)
        forced_nodes.append(xp.asarray(sums(heat), dtype))
    return _LinearNodes(
        forcings=tuple(forcings),
        forced=tuple(forced_nodes),
        slope=sum(slopes[1:], slopes[0]) if slopes else None,
        everywhere=everywhere,
        entries=tuple(entries[term] for term in numbers),
        names=tuple(terms.names[term] for term in numbers),
        entry_forced=tuple(entry_forced),
        entry_slope=tuple(entry_slope),
    )


def _linear_terms(
    terms: SurfaceTerms, laws: list[LinearLaw], number: Callable[[Any], Any]
) -> tuple[list[Any], list[_LinearTerm]]:
    """Forcings, and the terms with a linear law on all cells, natural ones first."""
    # The first forcing is 1: all constant terms share it.
    forcings: list[Any] = [np.ones((), terms.half_cell.dtype)]
    linear_terms = []
    numbered = (*terms.natural, *terms.prescribed)
    for (term, bound), law in zip(numbered, laws, strict=True):
        area = number(bound.effective_area)
        forcing = 0
        weight = area * number(law.weight)
        if not callable(law.forcing):
            weight = weight * number(law.forcing)
        else:
            # Terms of one function of time, such as one air, share its forcing.
            same = (
                index for index, shared in enumerate(forcings) if law.forcing is shared
            )
            forcing = next(same, len(forcings))
            if forcing == len(forcings):
                forcings.append(law.forcing)
        slope = None if law.slope is None else area * number(law.slope)
        linear_terms.append(
            _LinearTerm(term=term, forcing=forcing, weight=weight, slope=slope)
        )
    return forcings, linear_terms


def _sums(
    cells: BodyCells, network: AbstractNetwork, traced: bool
) -> tuple[bool, Callable[[Any], Any]]:
    """True if sums are for all nodes, and a function from values of cells to nodes."""
    # The layout of cells is known, even where a scene is traced.
    index = np.asarray(cells.node)
    count = cells.slots[0].shape[0]
    everywhere = False
    if isinstance(network, AbstractNodeNetwork):
        nodes = network.node_capacity.shape[0]
        everywhere = count >= _MIN_SURFACE_FRACTION * nodes
        if everywhere:
            index = np.asarray(cells.address[0])[index]
            count = nodes
    if traced:
        return everywhere, lambda values: jax.ops.segment_sum(values, index, count)
    return everywhere, lambda values: np.bincount(index, values, count)
