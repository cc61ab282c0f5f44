"""Surface loads that are linear in their nodes' temperatures, summed beforehand.

With the surface eliminated as in `LinearSurface`, the node of a cell receives

    q = G / (G + s) (w d(t) - s T_node),

to which a term with weight w_e and slope s_e contributes, with other terms j,

    q_e = [G (w_e d(t) - s_e T_node) + sum_j (w_e s_j - s_e w_j) d(t)] / (G + s).

The first part is the term's share of q, the second what the other terms take from it:
the sum over the terms is q however large the Biot number s / G is.

Sums over the cells of a node leave one coefficient per forcing and one slope per node.
The time loop then evaluates no cells at all: in a network of nodes the load is part of
the loop that conducts. `SurfaceLoad`, cell by cell, is the general form.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import Time, consecutive, is_traced, namespace
from ...network.network import (
    AbstractNetwork,
    AbstractNodeNetwork,
    inverse,
    precise_sum,
)
from ...network.segment_sums import SegmentSums, sums_of_lists
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.time_varying import value_at
from .body_program import BodyProgram
from .linear_surface import LinearTerm, linear_surface, nonlinear_term, total_slope
from .program import Program
from .surface_cells import BodyCells, OneBody
from .surface_load import (
    AbstractSurfaceLoad,
    HeatRates,
    Networks,
    PerBody,
    SurfaceLoad,
)


_MIN_SURFACE_FRACTION = 1 / 8
"""Fraction of a body's nodes below which those under the surface are gathered."""


class _LinearNodes(Module):
    """Linear heat rates of the nodes of a group, and their sums for the ledger."""

    forcings: tuple[Any, ...]
    """Numbers or functions of time."""
    forced: tuple[Float[Any, " n"], ...]
    """Heat rate of every node by each forcing [W per unit of it]."""
    slope: Float[Any, " n"] | None
    """Heat that each node loses [W/K]; None for nothing."""
    everywhere: bool = eqx.field(static=True)
    """True if arrays cover all nodes of the body, in order; else those with cells."""
    sums: SegmentSums | None
    """Sums over the nodes of each body; None for one body."""
    entries: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Ledger entry of each term on each body; -1 where it has none."""
    names: tuple[str, ...] = eqx.field(static=True)
    """Mechanism of each term."""
    entry_forced: tuple[Float[Any, "d b"], ...]
    """Heat rate of each term into each body by the forcings [W per unit of it]."""
    entry_slope: tuple[Float[Any, " n"] | None, ...]
    """Heat that each node loses to the term [W/K]; None for nothing."""

    def totals(self, values: Float[Array, " n"]) -> Float[Array, " b"]:
        """Sums of the values of the nodes of each body."""
        return precise_sum(values)[None] if self.sums is None else self.sums(values)

    @property
    def closing(self) -> int | None:
        """Number of the last term that depends on temperatures; None without one."""
        # A prescribed temperature, whose large slope rounds most, is last.
        varying = [n for n, slope in enumerate(self.entry_slope) if slope is not None]
        return varying[-1] if varying else None


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
            closing = body.closing
            remainder: Any = 0.0
            for n, entries in enumerate(body.entries):
                if n == closing:
                    continue
                with jax.named_scope(body.names[n]):
                    pairs = zip(body.entry_forced[n], amplitudes, strict=True)
                    entry_heat: Any = sum(
                        forced * amplitude for forced, amplitude in pairs
                    )
                    slope = body.entry_slope[n]
                    if slope is not None:
                        entry_heat = entry_heat - body.totals(slope * theta)
                    remainder = remainder - entry_heat
                    by_entry = _added_to(by_entry, entries, entry_heat)
            if closing is not None:
                # What the nodes receive, less the other entries: a sum of its own would
                # round differently, and heat would be missing in the ledger.
                with jax.named_scope(body.names[closing]):
                    closing_heat = body.totals(rate) + remainder
                    entries = body.entries[closing]
                    by_entry = _added_to(by_entry, entries, closing_heat)
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

    @override
    def of_groups(self, new_number: Mapping[int, int]) -> "_LinearSurfaceLoad | None":
        general = self.general.of_groups(new_number)
        if general is None:
            return None
        indices = self.general.indices_of(new_number)
        return _LinearSurfaceLoad(
            general, bodies=tuple(self.bodies[index] for index in indices)
        )


def _added_to(
    by_entry: Float[Array, " c"], entries: tuple[int, ...], heat: Float[Array, " b"]
) -> Float[Array, " c"]:
    """Ledger entries with the heat rates of a term into each body [W]."""
    where = np.array(entries)
    counted = np.flatnonzero(where >= 0)
    return by_entry.at[where[counted]].add(heat[counted])


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
        linear.append(replace(program, surface=load))
    return tuple(linear)


def _linear_load(program: Program, load: SurfaceLoad) -> _LinearSurfaceLoad | None:
    if program.enclosure is not None:
        return None
    bodies = []
    for index, cells in enumerate(load.cells):
        network = program.bodies[cells.body].network
        terms = load.terms_on(index)
        # Where conductivity varies, so does the half cell.
        if not network.is_linear or nonlinear_term(terms) is not None:
            return None
        entries = [load.entries_on(n, index) for n, _ in enumerate(load.entries)]
        bodies.append(
            _linear_nodes(
                cells,
                body=program.bodies[cells.body],
                terms=terms,
                entries=entries,
            )
        )
    return _LinearSurfaceLoad(load, tuple(bodies))


def _linear_nodes(
    cells: BodyCells,
    body: BodyProgram,
    terms: SurfaceTerms,
    entries: list[tuple[int, ...]],
) -> _LinearNodes:
    """The balance of all cells, solved and summed by nodes."""
    dtype = terms.half_cell.dtype
    surface = linear_surface(terms)
    xp = namespace(surface)
    everywhere, sums = _sums(cells, body.network, traced=is_traced(surface))
    forcings, linear_terms = _shared_forcings(surface.terms, dtype)
    natural = [term for term in linear_terms if not term.is_prescribed]
    prescribed = [term for term in linear_terms if term.is_prescribed]
    zero = 0 * surface.half_cell
    numbers = sorted({linear_term.number for linear_term in linear_terms})
    entry_forced = []
    entry_slope = []
    for number in numbers:
        exposed = [term for term in natural if term.number == number]
        fixed = [term for term in prescribed if term.number == number]
        # At the temperature that all terms cause together, without its difference to
        # w_e d, which at large Biot numbers leaves rounding times s / G.
        competing = [term for term in natural if term.number != number]
        lost_here = zero + total_slope(exposed) * surface.resistance
        lost_to_others = zero + total_slope(competing) * surface.resistance
        forced = []
        for forcing in forcings:
            heat = _weight(exposed, forcing) * (surface.through + lost_to_others)
            heat = heat - lost_here * _weight(competing, forcing)
            heat = zero + heat + _weight(fixed, forcing)
            forced.append(xp.asarray(_totals(cells, heat), dtype))
        entry_forced.append(xp.stack(forced))
        slope = None
        if any(term.law.slope is not None for term in (*exposed, *fixed)):
            lost = total_slope(exposed) * surface.through + total_slope(fixed)
            slope = xp.asarray(sums(zero + lost), dtype)
        entry_slope.append(slope)
    # All slopes of a node act on the same temperature: one array for the time loop.
    slopes = [slope for slope in entry_slope if slope is not None]
    forced_nodes = []
    for forcing in forcings:
        heat = _weight(natural, forcing) * surface.through
        heat = zero + heat + _weight(prescribed, forcing)
        forced_nodes.append(xp.asarray(sums(heat), dtype))
    return _LinearNodes(
        forcings=tuple(forcings),
        forced=tuple(forced_nodes),
        slope=sum(slopes[1:], slopes[0]) if slopes else None,
        everywhere=everywhere,
        sums=_node_sums(cells, body, everywhere),
        entries=tuple(entries[number] for number in numbers),
        names=tuple(terms.names[number] for number in numbers),
        entry_forced=tuple(entry_forced),
        entry_slope=tuple(entry_slope),
    )


def _totals(cells: BodyCells, heat: Any) -> Any:
    """Sums over the cells of each body."""
    if cells.members is None:
        return heat.sum()[None]
    if is_traced(heat):
        return cells.members.sums(heat)
    return np.array([heat[of_body].sum() for of_body in consecutive(cells.sizes)])


def _node_sums(
    cells: BodyCells, body: BodyProgram, everywhere: bool
) -> SegmentSums | None:
    """Sums over the nodes of each body with cells: all of them, or those with cells."""
    if body.members is None:
        return None
    member = np.asarray(body.members.of_node)
    if not everywhere:
        member = member[np.asarray(cells.address[0])]
    order = np.argsort(member, kind="stable")
    used = [body.numbers.index(number) for number in cells.numbers]
    starts = np.searchsorted(member[order], used, side="left")
    stops = np.searchsorted(member[order], used, side="right")
    pairs = zip(starts.tolist(), stops.tolist(), strict=True)
    return sums_of_lists([order[start:stop] for start, stop in pairs], len(member))


def _weight(terms: list[LinearTerm], forcing: Any) -> Any:
    """Heat rate of every cell by one unit of a forcing [W per unit]."""
    return sum(term.weight for term in terms if term.law.forcing is forcing)


def _shared_forcings(
    terms: tuple[LinearTerm, ...], dtype: Any
) -> tuple[list[Any], list[LinearTerm]]:
    """Forcings, each once, and the terms that refer to them."""
    # The first forcing is 1: all constant terms share it. Terms of one function of
    # time, such as one air, share its forcing, too.
    one = np.ones((), dtype)
    forcings: list[Any] = [one]
    sharing = []
    for term in terms:
        law = term.law
        if not callable(law.forcing):
            law = law._replace(weight=law.weight * law.forcing, forcing=one)
        elif not any(law.forcing is forcing for forcing in forcings):
            forcings.append(law.forcing)
        sharing.append(term._replace(law=law))
    return forcings, sharing


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
