"""Heat of all surface terms in the time loop, by surface cells."""

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import Time, typed_array
from ...findings import found
from ...module import Module
from ...network.network import AbstractNetwork, Address, precise_sum
from ...physics.surface import spread
from ...physics.surface_energy_balance import SurfaceTerms
from .surface_cells import BodyCells, OneBody


# One array or one network for each body with cells; and the heat rates of its cells or
# nodes, with those of the ledger [W].
PerBody = Sequence[Float[Array, " _"]]
Networks = Sequence[AbstractNetwork]
HeatRates = tuple[list[Float[Array, " _"]], Float[Array, " c"]]


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

        At temperatures of the nodes above the references [K]. Without `emits` the
        emission of a cell is in what it has received from other surfaces [W/m^2].
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

    def stiffness(
        self, body: int, highest: Float[Array, ""], end: float, relative: Array
    ) -> list[tuple[Address, Float[Array, " m"]]]:
        """Conductance that the load adds to a body's nodes in the stable step [W/K].

        Below a temperature `highest` [K] up to `end` [s]; `relative` is the largest
        k(T) / k(reference) [-].
        """
        found, load = [], self.by_cell
        for index, cells in enumerate(load.cells):
            if cells.body == body:
                stiffness = load.terms_on(index).stiffness(highest, end, relative)
                found.append((cells.address, cells.sums(stiffness)))
        return found

    def is_dissipative(self, body: int) -> bool:
        """True if a term bounds the temperature of a body."""
        load = self.by_cell
        return any(
            cells.body == body
            and any(
                term.law.is_dissipative and load.entries[n][index] >= 0
                for n, term in load.terms.natural
            )
            for index, cells in enumerate(load.cells)
        )


class SurfaceLoad(AbstractSurfaceLoad):
    """Heat of all surface terms, from the balance of every cell.

    Bodies on which nothing acts have no cells, and no index here.
    """

    # The balance of every cell stands for itself, so the cells of all bodies are one
    # set of arrays: one balance to compile and to run instead of one per body. Apart
    # they would run at once and in many small pieces, three times slower.

    terms: SurfaceTerms
    """On the cells of all bodies, one body after the other."""
    cells: tuple[BodyCells, ...]
    references: tuple[Float[Any, ""], ...]
    """References of the bodies that have cells [K]."""
    entries: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Ledger entry of each term on each of those bodies; -1 where it has none."""
    entry_count: int = eqx.field(static=True)
    """Length of the ledger."""

    @property
    @override
    def by_cell(self) -> "SurfaceLoad":
        return self

    def conducting(
        self, nodes: PerBody, networks: Networks
    ) -> tuple[SurfaceTerms, Float[Array, " p"]]:
        """The terms above nodes of these temperatures, and those at the cells [K]."""
        pairs = zip(self.cells, nodes, strict=True)
        here = [cells.cells_of(each) for cells, each in pairs]
        relative = [
            network.relative_conductivity(each, cells.conductivity_parts)
            for network, each, cells in zip(networks, here, self.cells, strict=True)
        ]
        return self.terms.conducting(together(relative, here)), _join(here)

    @override
    def heat(
        self, time: Time, nodes: PerBody, networks: Networks, received=None, emits=False
    ) -> HeatRates:
        # Where conductivity varies with temperature, so do the half cells.
        terms, here = self.conducting(nodes, networks)
        if received is not None:
            terms = terms.irradiated(received, emits)
        heat, rates = terms.rates(time, here)
        # Terms of one flux need no sum over cells; the closing term is the rest.
        sums = lambda values: jnp.stack([precise_sum(v) for v in self.apart(values)])
        imposed = terms.imposed(time)
        closing = self._closing_term({n for n, _ in imposed})
        each = [(n, flux) for n, flux in imposed if n != closing]
        each += [(n, sums(rate)) for n, rate in rates.items() if n != closing]
        if closing is not None:
            others = sum(own for _, own in each)
            each.append((closing, sums(heat) - others))
        return self.apart(heat), self._by_entry(each, heat.dtype)

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

    def terms_on(self, index: int) -> SurfaceTerms:
        """The terms on the cells of one body."""
        ends = np.cumsum([0, *self.counts])
        acting = {n for n, own in enumerate(self.entries) if own[index] >= 0}
        cells = slice(int(ends[index]), int(ends[index + 1]))
        return self.terms.selected(cells, acting, self.references[index])

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of cells of each of those bodies."""
        return tuple(cells.node.shape[0] for cells in self.cells)

    def _closing_term(self, imposed: set[int]) -> int | None:
        """Number of the most expensive term, a nonlinear one if there is any.

        None where all fluxes are `imposed`, or where no term gives a flux.
        """
        # All terms together bring what goes through the surface. So one need not be
        # summed, nor kept in an array, nor computed twice; it is as exact as the total.
        # The ledger then closes at any Biot number: a flux h (T_air - T_s) by itself
        # has a rounding that exceeds that of the half cell's by h A / G.
        sizes: dict[int, tuple[bool, int]] = {}
        for n, term in self.terms.natural:
            if n not in imposed:
                size = sum(np.size(leaf) for leaf in jax.tree.leaves(term.law))
                nonlinear, before = sizes.get(n, (False, 0))
                sizes[n] = (nonlinear or not term.law.is_linear, before + size)
        return max(sizes, key=lambda n: sizes[n], default=None)

    def _by_entry(self, each, dtype) -> Float[Array, " c"]:
        """Heat rates of terms on each body, by the entries of the ledger."""
        found = jnp.zeros(self.entry_count, dtype)
        if not each:
            return found
        where = np.array([entry for n, _ in each for entry in self.entries[n]])
        acts = np.flatnonzero(where >= 0)
        brought = _join([own for _, own in each])
        return found.at[where[acts]].add(brought[acts])

    def apart(self, values: Float[Array, " p"]) -> list[Float[Array, " _"]]:
        """Values of each body's cells."""
        if len(self.cells) == 1:
            return [values]
        return jnp.split(values, np.cumsum(self.counts)[:-1].tolist())


def together(values: Sequence[Float[Array, "..."]], like: PerBody) -> Array:
    """Values of several bodies' cells; one number where all bodies have the same."""
    if not any(each.ndim for each in values):
        return values[0]
    pairs = zip(values, like, strict=True)
    return _join([jnp.broadcast_to(each, here.shape) for each, here in pairs])


def _join(arrays: PerBody) -> Float[Array, " p"]:
    return arrays[0] if len(arrays) == 1 else jnp.concatenate(arrays)


def surface_load(
    terms: SurfaceTerms,
    cells: tuple[BodyCells | None, ...],
    cell: Sequence[Int[np.ndarray, " _"]],
    references: Sequence[Any],
    entries: tuple[tuple[int, ...], ...],
    entry_count: int,
) -> tuple[SurfaceLoad | None, Int[np.ndarray, " s"]]:
    """The load of all bodies, and the cell of each fragment among all cells or -1.

    The terms are on the fragments of all bodies; `cells` and `cell` are those of each
    body as from `body_cells`, and `entries` the ledger entry of each term on each, or
    -1.
    """
    counts = tuple(0 if c is None else c.node.shape[0] for c in cells)
    starts = np.cumsum([0, *counts])[:-1]
    moved = lambda own, at: np.where(own >= 0, own + at, -1)
    joined = found(
        tuple(cell),
        ("joined", counts),
        lambda: np.concatenate([*map(moved, cell, starts)]),
    )
    loaded = [n for n, count in enumerate(counts) if count]
    if not loaded:
        return None, joined
    own = [references[n] for n in loaded]
    dtype = terms.half_cell.dtype
    reference = spread(own, [counts[n] for n in loaded], dtype)
    load = SurfaceLoad(
        terms=terms.coarsened(joined, tuple(counts[n] for n in loaded), reference),
        cells=tuple(each for each in cells if each is not None),
        references=tuple(typed_array(each, dtype) for each in own),
        entries=tuple(tuple(row[n] for n in loaded) for row in entries),
        entry_count=entry_count,
    )
    return load, joined
