"""Heat of all surface terms in the time loop, by surface cells.

The fragments of one node on which the same terms act are one cell. The layout of cells
depends on geometry and on where terms act, and is computed once for all runs.
"""

import abc
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import Time, consecutive, typed_array
from ...network.network import AbstractNetwork, Address
from ...physics.coarsening import Coarsening
from ...physics.half_cells import Extremes, varying_half_cells
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface import spread
from ...physics.surface_energy_balance import SurfaceTerms
from .surface_cells import BodyCells, OneBody


PerBody = Sequence[Float[Array, " _"]]
"""An array for each body with cells."""
Networks = Sequence[AbstractNetwork]
"""The network of each body with cells."""
HeatRates = tuple[list[Float[Array, " _"]], Float[Array, " c"]]
"""Heat rates of each body's cells or nodes, and of the entries of the ledger [W]."""


class AbstractSurfaceLoad(Module):
    """Heat of all surface terms on the bodies of a scene."""

    @property
    @abc.abstractmethod
    def by_cell(self) -> "SurfaceLoad":
        """The load in general form."""

    def nodes_of(self, index: int, state: OneBody) -> Float[Array, " m"]:
        """Values of a state at the nodes of the body with this index."""
        return self.by_cell.cells[index].nodes_of(state)

    @abc.abstractmethod
    def heat(
        self,
        time: Time,
        nodes: PerBody,
        networks: Networks,
        received: Float[Array, " p"] | None = None,
        emits: bool = False,
    ) -> HeatRates:
        """Heat rates of each body's cells or nodes, and of each ledger entry [W].

        Args:
            time: of the loads [s].
            nodes: temperatures of the nodes above the references [K].
            networks: of the bodies.
            received: radiation that cells receive from other surfaces [W/m^2].
            emits: True if `received` does not contain the emission of the cells.
        """

    @abc.abstractmethod
    def add(
        self,
        index: int,
        new: OneBody,
        network: AbstractNetwork,
        dt: Time,
        heat: Array,
    ) -> OneBody:
        """A body's state with the heat rates of `heat` over `dt` [s]."""

    @abc.abstractmethod
    def of_groups(self, new_number: Mapping[int, int]) -> "AbstractSurfaceLoad | None":
        """The load of some groups of a program, by their numbers in one of these alone.

        None where nothing acts on them.
        """

    def stiffness(
        self, body: int, highest: Float[Array, ""], end: float, relative: Extremes
    ) -> list[tuple[Address, Float[Array, " m"]]]:
        """Conductance that the load adds to a body's nodes in the stable step [W/K].

        Below a temperature `highest` [K] up to `end` [s]; `relative` are
        the extremes of k(T) / k(reference) [-].
        """
        stiffnesses = []
        load = self.by_cell
        for index, cells in enumerate(load.cells):
            if cells.body == body:
                stiffness = load.terms_on(index).stiffness(highest, end, relative)
                stiffnesses.append((cells.address, cells.sums(stiffness)))
        return stiffnesses

    def cooled_bodies(self) -> frozenset[int]:
        """Numbers of the bodies whose temperature a term bounds."""
        load = self.by_cell
        numbers = [number for cells in load.cells for number in cells.numbers]
        return frozenset(
            number
            for n, term in load.terms.natural
            if term.law.is_dissipative
            for number, entry in zip(numbers, load.entries[n], strict=True)
            if entry >= 0
        )


class SurfaceLoad(AbstractSurfaceLoad):
    """Heat of all surface terms, from the balance of every cell.

    Groups on which nothing acts have no cells, and no index here.
    """

    # The balance of a cell does not depend on other cells, so those of all bodies are
    # one set of arrays: one balance to compile and to run instead of one per body.

    terms: SurfaceTerms
    """On the cells of all bodies, one body after the other."""
    cells: tuple[BodyCells, ...]
    references: tuple[Float[Any, "*p"], ...]
    """References of the groups that have cells [K], one number or one for each cell."""
    entries: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Ledger entry of each term on each body with cells; -1 where it has none."""
    entry_count: int = eqx.field(static=True)
    """Length of the ledger."""

    @property
    @override
    def by_cell(self) -> "SurfaceLoad":
        return self

    def conducting(
        self, nodes: PerBody, networks: Networks
    ) -> tuple[SurfaceTerms, Float[Array, " p"]]:
        """The terms above these nodes, and the temperatures of the cells' nodes [K]."""
        pairs = zip(self.cells, nodes, strict=True)
        at_cells = [cells.cells_of(body_nodes) for cells, body_nodes in pairs]
        varying = varying_half_cells(
            networks,
            fractions=[cells.conductivity_parts for cells in self.cells],
            counts=self.counts,
        )
        return replace(self.terms, varying=varying), _join(at_cells)

    @override
    def heat(
        self, time: Time, nodes: PerBody, networks: Networks, received=None, emits=False
    ) -> HeatRates:
        # Where conductivity varies with temperature, so do the half cells.
        terms, at_cells = self.conducting(nodes, networks)
        if received is not None:
            terms = terms.irradiated(received, emits)
        heat, rates = terms.rates(time, at_cells)

        def sums(values):
            pairs = zip(self.cells, self.apart(values), strict=True)
            return _join([cells.totals(of_group) for cells, of_group in pairs])

        # Terms of one flux need no sum over cells; the closing term is the remainder.
        imposed = terms.imposed(time)
        closing = self._closing_term({n for n, _ in imposed})
        numbered_rates = [(n, flux) for n, flux in imposed if n != closing]
        numbered_rates += [(n, sums(rate)) for n, rate in rates.items() if n != closing]
        if closing is not None:
            known_rates = sum(rate for _, rate in numbered_rates)
            numbered_rates.append((closing, sums(heat) - known_rates))
        return self.apart(heat), self._by_entry(numbered_rates, heat.dtype)

    @override
    def add(
        self,
        index: int,
        new: OneBody,
        network: AbstractNetwork,
        dt: Time,
        heat: Array,
    ) -> OneBody:
        cells = self.cells[index]
        return cells.add(new, dt, cells.sums(heat))

    @override
    def of_groups(self, new_number: Mapping[int, int]) -> "SurfaceLoad | None":
        indices = self.indices_of(new_number)
        if not indices:
            return None
        cells = [self.cells[index] for index in indices]
        references = tuple(self.references[index] for index in indices)
        counts = [self.counts[index] for index in indices]
        of_cells = list(consecutive(self.counts))
        of_bodies = list(consecutive(len(group.numbers) for group in self.cells))
        bodies = np.r_[tuple(of_bodies[index] for index in indices)]
        acting = {
            number
            for number, _ in enumerate(self.entries)
            if any(self.acts(number, index) for index in indices)
        }
        terms = self.terms.selected(
            np.r_[tuple(of_cells[index] for index in indices)],
            acting,
            reference=spread(references, counts, self.terms.half_cell.dtype),
            bodies=bodies,
        )
        return SurfaceLoad(
            terms=terms,
            cells=tuple(replace(group, body=new_number[group.body]) for group in cells),
            references=references,
            entries=tuple(tuple(row[n] for n in bodies) for row in self.entries),
            entry_count=self.entry_count,
        )

    def indices_of(self, groups: Collection[int]) -> list[int]:
        """Indices of those of some groups that have cells."""
        return [index for index, cells in enumerate(self.cells) if cells.body in groups]

    def terms_on(self, index: int) -> SurfaceTerms:
        """The terms on the cells of one body."""
        acting = {n for n, _ in enumerate(self.entries) if self.acts(n, index)}
        cells = consecutive(self.counts)[index]
        return self.terms.selected(cells, acting, self.references[index])

    def acts(self, number: int, index: int) -> bool:
        """True if a term acts on a body of the group with this index."""
        return any(entry >= 0 for entry in self.entries_on(number, index))

    def entries_on(self, number: int, index: int) -> tuple[int, ...]:
        """Ledger entry of a term on each body with cells of the group."""
        bodies = consecutive(len(cells.numbers) for cells in self.cells)[index]
        return self.entries[number][bodies]

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of cells of each of those groups."""
        return tuple(cells.node.shape[0] for cells in self.cells)

    def _closing_term(self, imposed: set[int]) -> int | None:
        """Number of the most expensive term, a nonlinear one if there is any.

        None where all fluxes are `imposed`, or where no term gives a flux.
        """
        # The heat of all terms together passes through the surface. So one term need
        # not be summed, nor stored, nor computed twice: it is as exact as the total.
        # The ledger then closes at any Biot number; the rounding of h (T_air - T_s)
        # exceeds that of the half cell's flux by a factor of h A / G.
        sizes: dict[int, tuple[bool, int]] = {}
        for n, term in self.terms.natural:
            if n not in imposed:
                size = sum(np.size(leaf) for leaf in jax.tree.leaves(term.law))
                nonlinear, size_so_far = sizes.get(n, (False, 0))
                sizes[n] = (nonlinear or not term.law.is_linear, size_so_far + size)
        return max(sizes, key=lambda n: sizes[n], default=None)

    def _by_entry(self, numbered_rates, dtype) -> Float[Array, " c"]:
        """Heat rates of terms on each body, by the entries of the ledger."""
        by_entry = jnp.zeros(self.entry_count, dtype)
        if not numbered_rates:
            return by_entry
        where = np.array(
            [entry for n, _ in numbered_rates for entry in self.entries[n]]
        )
        counted = np.flatnonzero(where >= 0)
        rates = _join([rate for _, rate in numbered_rates])
        return by_entry.at[where[counted]].add(rates[counted])

    def apart(self, values: Float[Array, " p"]) -> list[Float[Array, " _"]]:
        """Values of each body's cells."""
        if len(self.cells) == 1:
            return [values]
        return jnp.split(values, np.cumsum(self.counts)[:-1].tolist())


def _join(arrays: PerBody) -> Float[Array, " p"]:
    return arrays[0] if len(arrays) == 1 else jnp.concatenate(arrays)


@dataclass(frozen=True, eq=False)
class CellLayout:
    """Surface cells of all groups of bodies, for the loads of several snapshots.

    Groups on which nothing acts have no cells.
    """

    cells: tuple[BodyCells, ...]
    references: tuple[Float[Any, "*p"], ...]
    """References of the cells of each of these groups [K]."""
    entries: tuple[tuple[int, ...], ...]
    """Ledger entry of each term on each body with cells, or -1."""
    entry_count: int
    """Length of the ledger."""
    coarsening: Coarsening

    @classmethod
    def of_groups(
        cls,
        cells: Sequence[BodyCells | None],
        cell: Int[np.ndarray, " s"],
        references: Sequence[Any],
        entries: tuple[tuple[int, ...], ...],
        entry_count: int,
        dtype: Any,
    ) -> "CellLayout | None":
        """The cells of each group as from `body_cells`; None where nothing acts.

        `cell` is that of each fragment among all cells or -1, and `entries` the ledger
        entry of each term on each body of the scene, or -1.
        """
        loaded = [n for n, of_group in enumerate(cells) if of_group is not None]
        used = tuple(of_group for of_group in cells if of_group is not None)
        if not used:
            return None
        cell_references = [
            of_group.reference(references[n])
            for n, of_group in zip(loaded, used, strict=True)
        ]
        counts = [of_group.node.shape[0] for of_group in used]
        numbers = [number for of_group in used for number in of_group.numbers]
        return cls(
            cells=used,
            references=tuple(
                typed_array(reference, dtype) for reference in cell_references
            ),
            entries=tuple(tuple(row[n] for n in numbers) for row in entries),
            entry_count=entry_count,
            coarsening=Coarsening(
                cell,
                counts=tuple(size for of_group in used for size in of_group.sizes),
                reference=spread(cell_references, counts, dtype),
            ),
        )

    def load(self, terms: SurfaceTerms) -> SurfaceLoad:
        """The load of terms on the fragments of all bodies."""
        return SurfaceLoad(
            terms=self.coarsening.terms(terms),
            cells=self.cells,
            references=self.references,
            entries=self.entries,
            entry_count=self.entry_count,
        )

    def enclosure(self, fine: Enclosure) -> Enclosure:
        """Radiation between the cells, from that between fragments."""
        counts = tuple(of_group.node.shape[0] for of_group in self.cells)
        return fine.coarsened(self.coarsening.cell, counts)
