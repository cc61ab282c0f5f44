"""Surface loads that are linear in their nodes' temperatures, summed beforehand.

Where every law is w d(t) - s T_s with s constant, the balance at the surface has one
solution for all times and temperatures. With weights w of forcings d(t), slopes s and
the half cell's conductance G, each a sum over the terms at a cell, the node receives

    q = G / (G + s) (w d(t) - s T_node),

and a term with weight w_e and slope s_e brings, beside others j,

    q_e = [G (w_e d(t) - s_e T_node) + sum_j (w_e s_j - s_e w_j) d(t)] / (G + s),

the first part its own of q, the second what the others take from it: their sum is q
however large the Biot number s / G is.

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
from .surface_cells import BodyCells, OneBody
from .surface_load import (
    AbstractSurfaceLoad,
    HeatRates,
    Networks,
    PerBody,
    SurfaceLoad,
)


# Fraction of a body's nodes below which those under the surface are gathered.
_MIN_SURFACE_FRACTION = 1 / 8


class _LinearNodes(Module):
    """Linear heat rates of the nodes of one body, and their sums for the ledger."""

    forcings: tuple[Any, ...]
    """Numbers or functions of time."""
    forced: tuple[Float[Any, " n"], ...]
    """Heat rate of every node by each forcing [W per unit of it]."""
    slope: Float[Any, " n"] | None
    """Lost by each node [W/K]; None for nothing."""
    everywhere: bool = eqx.field(static=True)
    """True if arrays cover all nodes of the body, in order; else those with cells."""
    entries: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    """Mechanism of each ledger entry."""
    entry_forced: tuple[Float[Any, " d"], ...]
    """Heat rate of each entry by the forcings [W per unit of it]."""
    entry_slope: tuple[Float[Any, " n"] | None, ...]
    """Lost by each node to the entry [W/K]; None for nothing."""


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
            now = [value_at(forcing, time) for forcing in body.forcings]
            rate = jnp.zeros_like(theta) if body.slope is None else -body.slope * theta
            for each, forcing in zip(body.forced, now, strict=True):
                rate = rate + each * forcing
            heat.append(rate)
            rows = (body.entries, body.names, body.entry_forced, body.entry_slope)
            for entry, name, forced, slope in zip(*rows, strict=True):
                with jax.named_scope(name):
                    brought = sum(b * f for b, f in zip(forced, now, strict=True))
                    if slope is not None:
                        brought = brought - precise_sum(slope * theta)
                    by_entry = by_entry.at[entry].add(brought)
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
    made = []
    for program in programs:
        if program.surface is None:
            made.append(program)
            continue
        load = _linear_load(program, program.surface.by_cell)
        if load is None:
            return None
        made.append(replaced(program, surface=load))
    return tuple(made)


def _linear_load(program: Program, load: SurfaceLoad) -> _LinearSurfaceLoad | None:
    if program.enclosure is not None:
        return None
    bodies = []
    for index, cells in enumerate(load.cells):
        network = program.bodies[cells.body].network
        terms = load.terms_on(index)
        numbered = (*terms.natural, *terms.prescribed)
        laws = [law for _, t in numbered if (law := t.law.linear()) is not None]
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


class _Part(NamedTuple):
    """A term on the cells."""

    term: int
    forcing: int
    weight: Any
    """[W per unit of the forcing]"""
    slope: Any
    """[W/K]; None for nothing."""


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
    own: Any = jnp if traced else np
    number = lambda value: own.asarray(value, dtype if traced else np.float64)
    rounded = lambda value: own.asarray(value, dtype)
    everywhere, sums = _sums(cells, network, traced)
    forcings, parts = _parts(terms, laws, number)
    cell = number(terms.half_cell)
    weight = lambda parts, forcing: sum(
        (part.weight for part in parts if part.forcing == forcing), 0 * cell
    )
    slope = lambda parts: sum((p.slope for p in parts if p.slope is not None), 0 * cell)
    natural = parts[: len(terms.natural)]
    both = cell + slope(natural)
    some = own.where(both > 0, both, 1)
    # Of the heat at a surface, the fraction that goes to its node; the rest is lost by
    # the terms.
    through = own.where(both > 0, cell, 0) / some
    lost = own.where(both > 0, 1, 0) / some
    each = range(len(forcings))
    found = sorted({part.term for part in parts})
    entry_forced = []
    entry_slope = []
    for term in found:
        here = [part for part in parts if part.term == term]
        exposed = [part for part in natural if part.term == term]
        fixed = here[len(exposed) :]
        # At the temperature that all terms cause together, without its difference to
        # w_e d, which at large Biot numbers leaves rounding times s / G.
        others = [part for part in natural if part.term != term]
        lose_here = slope(exposed) * lost
        lose_there = slope(others) * lost
        brought = [
            weight(exposed, d) * (through + lose_there)
            - lose_here * weight(others, d)
            + weight(fixed, d)
            for d in each
        ]
        entry_forced.append(own.stack([rounded(total.sum()) for total in brought]))
        acts = any(part.slope is not None for part in here)
        lose = slope(exposed) * through + slope(fixed) if acts else None
        entry_slope.append(rounded(sums(lose)) if acts else None)
    # All slopes of a node act on the same temperature: one array for the time loop.
    slopes = [each for each in entry_slope if each is not None]
    prescribed = parts[len(natural) :]
    forced = [weight(natural, d) * through + weight(prescribed, d) for d in each]
    return _LinearNodes(
        forcings=tuple(forcings),
        forced=tuple(rounded(sums(values)) for values in forced),
        slope=sum(slopes[1:], slopes[0]) if slopes else None,
        everywhere=everywhere,
        entries=tuple(entries[term] for term in found),
        names=tuple(terms.names[term] for term in found),
        entry_forced=tuple(entry_forced),
        entry_slope=tuple(entry_slope),
    )


def _parts(
    terms: SurfaceTerms, laws: list[LinearLaw], number: Callable[[Any], Any]
) -> tuple[list[Any], list[_Part]]:
    """Forcings, and the terms with a linear law on all cells, natural ones first."""
    # The first forcing is 1: all constant terms share it.
    forcings: list[Any] = [np.ones((), terms.half_cell.dtype)]
    parts = []
    numbered = (*terms.natural, *terms.prescribed)
    for (term, bound), law in zip(numbered, laws, strict=True):
        area = number(bound.effective_area)
        forcing = 0
        weight = area * number(law.weight)
        if not callable(law.forcing):
            weight = weight * number(law.forcing)
        else:
            # Terms of one function of time, such as one air, share its forcing.
            same = (d for d, each in enumerate(forcings) if law.forcing is each)
            forcing = next(same, len(forcings))
            if forcing == len(forcings):
                forcings.append(law.forcing)
        slope = None if law.slope is None else area * number(law.slope)
        parts.append(_Part(term=term, forcing=forcing, weight=weight, slope=slope))
    return forcings, parts


def _sums(
    cells: BodyCells, network: AbstractNetwork, traced: bool
) -> tuple[bool, Callable[[Any], Any]]:
    # True if sums are for all nodes; and a function from values of cells to nodes.
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
