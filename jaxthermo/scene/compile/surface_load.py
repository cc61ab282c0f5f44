"""Heat of all surface terms in the time loop, by surface cells.

The fragments of one node on which the same terms act are one cell. The layout of cells
depends on geometry and on where terms act, and is computed once for all runs.
"""

import abc
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ...arrays import Time, device_array, members, typed_array
from ...memo.found import digest
from ...network.network import AbstractNetwork, Address, inverse, precise_sum, slot_sums
from ...parallel.lattice import (
    Sectioned,
    gathered,
    on_each_device,
    section_numbers,
    with_added,
    within_section,
)
from ...physics.half_cells import Extremes, varying_half_cells
from ...physics.surface import spread
from ...physics.surface_energy_balance import SurfaceTerms
from ...voxels.sharded_lattice import padded_places
from .bodies import PreparedBody, capacity_at


OneBody = Float[Array, "..."]
"""Temperatures of one body."""


class BodyCells(Module):
    """The surface cells of one body and their nodes.

    Fragments of one node on which the same terms act are one cell; a fragment on which
    nothing acts has none.
    """

    # Some cells at the end have no area: they make the number even (`_even_size`).
    # Cells are summed by gathering, and every node is then written once, which is
    # faster than adding one cell after the other.

    body: int = eqx.field(static=True)
    address: Address
    """Position of the nodes that have cells, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Heat capacity of the nodes with cells [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Index of each cell's node among the nodes with cells."""
    slots: tuple[Int[Array, " m"], ...]
    """Index of each node's k-th cell. Where a node has fewer, the index of a cell
    without area, or one past the last cell."""
    conductivity_parts: Float[Array, "q p"] | None = None
    """Fractions of each cell's conductivity by material and axis, where one of several
    varies with temperature."""
    mesh: Mesh | None = eqx.field(static=True, default=None)
    """Devices of the body, each with the nodes and cells of one section; in all lists
    sections follow one another. None for one device."""

    def nodes_of(self, state: OneBody) -> Float[Array, " m"]:
        """Values of a state at the nodes."""
        return gathered(self.mesh, state, self.address)

    def cells_of(self, nodes: Float[Array, " m"]) -> Float[Array, " p"]:
        """Values of the nodes at the cells."""
        return gathered(self.mesh, nodes, (self.node,))

    def sums(self, values: Float[Array, " p"]) -> Float[Array, " m"]:
        """Sums of the values of cells at the nodes."""
        if self.mesh is None:
            return slot_sums(values, self.slots)

        def section_sums(number, lists):
            values, slots = lists.values
            slots = [within_section(number, (slot,), len(values))[0] for slot in slots]
            return slot_sums(values, tuple(slots))

        return on_each_device(
            self.mesh,
            section_sums,
            section_numbers(self.mesh),
            Sectioned((values, self.slots)),
        )

    def add(self, new: OneBody, dt: Time, heat: Float[Array, " m"]) -> OneBody:
        """A state with the heat rates of the nodes [W] over `dt` [s]."""
        # The state stays three-dimensional here: flattening it for the scatter would
        # make XLA compute the whole stencil with flat indices, slowly.
        return with_added(
            self.mesh,
            values=new,
            address=self.address,
            increments=dt * heat / self.capacity,
        )


def _even_size(count: int) -> int:
    """The next size that threads share evenly, at most 1/16 or 16 larger."""
    # XLA checks the bounds of every element of a loop that its threads do not divide
    # evenly, and does not vectorize such a loop.
    max_excess = max(count // 16, 1)
    step = min(max(1 << (max_excess.bit_length() - 1), 16), 1024)
    return -(-count // step) * step


def body_cells(
    body: PreparedBody,
    acting_fragments: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None = None,
) -> tuple[BodyCells | None, Int[np.ndarray, " s"]]:
    """The surface cells of a body, and the cell of each of its fragments or -1.

    Each term `acts` on fragments at any time; those of two groups share no cell.
    """
    if not any(mask.any() for mask in acting_fragments):
        return None, np.full(len(body.fragment_node), -1, np.int32)
    patterns = tuple(digest(mask) for mask in acting_fragments)
    layout = body.body.structure.found(
        ("surface_cells", patterns, None if group is None else digest(group)),
        lambda: _layout(body, acting_fragments, group),
    )
    cells = BodyCells(
        body=body.number,
        address=layout.address,
        capacity=capacity_at(body.network, layout.address),
        node=layout.node,
        slots=layout.slots,
        conductivity_parts=_parts_of_cells(body, layout.cell, layout.node.shape[0]),
        mesh=body.network.mesh,
    )
    return cells, layout.cell


class _Layout(NamedTuple):
    """Geometry of the surface cells of one body, see `BodyCells`."""

    address: Address
    node: Int[Array, " p"]
    slots: tuple[Int[Array, " m"], ...]
    cell: Int[np.ndarray, " s"]
    """Cell of each fragment, or -1."""


_MAX_ROOM = 0.25
"""Largest fraction of empty cells that a body has because a previous run had more."""


def _shared_size(body: PreparedBody, terms: int, count: int) -> int:
    """The number of cells of a previous run, if it is little more than `count`."""
    # Another number, as after a source moved, would need another compilation.
    sizes: dict[str, int] = body.body.structure.found(("cell_sizes", terms), dict)
    largest = max(sizes.get("largest", 0), count)
    sizes["largest"] = largest
    return largest if largest <= (1 + _MAX_ROOM) * count else count


def _layout(
    body: PreparedBody,
    acting_fragments: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None,
) -> _Layout:
    cell = np.full(len(body.fragment_node), -1, np.int32)
    signature = np.zeros(len(cell), np.int64) if group is None else group.astype(int)
    for mask in acting_fragments:
        # Numbered again for each term, so that any number of terms fits.
        _, signature = np.unique(2 * signature + mask, return_inverse=True)
        signature = signature.reshape(-1)
    # A key per node and combination of terms; equal keys are one cell.
    touched = np.flatnonzero(np.any(acting_fragments, axis=0))
    nodes, node = np.unique(body.fragment_node[touched], return_inverse=True)
    sections = body.section_places(nodes)
    per_section = sections.per_section
    signatures = signature.max() + 1
    key = sections.places[node.reshape(-1)] * signatures + signature[touched]
    cells, inverse = np.unique(key, return_inverse=True)
    node = (cells // signatures).astype(np.int32)
    # A body on one device has one section.
    node_count = len(sections.address[0])
    section_count = node_count // per_section

    def size(count: int) -> int:
        return _shared_size(body, len(acting_fragments), _even_size(count))

    of_cell, count = padded_places(node // per_section, section_count, size)
    cell[touched] = of_cell[inverse.reshape(-1)]
    cell_node = np.repeat(per_section * np.arange(section_count, dtype=np.int32), count)
    cell_node[of_cell] = node
    # Nodes with fewer cells than others refer to one past the last cell.
    slot_cell = np.append(of_cell, len(cell_node)).astype(np.int32)
    return _Layout(
        address=sections.address,
        node=device_array(cell_node),
        slots=tuple(
            device_array(slot_cell[slot]) for slot in members(node, node_count)
        ),
        cell=cell,
    )


def _parts_of_cells(
    body: PreparedBody, cell: Int[np.ndarray, " s"], count: int
) -> Float[Array, "q p"] | None:
    """Means over the fragments of each cell, weighted by their half cells."""
    if body.conductivity_parts is None:
        return None
    fragments = np.flatnonzero(cell >= 0)
    half_cell = jnp.asarray(body.half_cell)[fragments]

    def sums(values):
        return jax.ops.segment_sum(values, cell[fragments], count)

    inverse_sum = inverse(sums(half_cell))
    rows = body.conductivity_parts[:, fragments] * half_cell[None]
    return jnp.stack([sums(row) * inverse_sum for row in rows])


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

    # The balance of a cell does not depend on other cells, so those of all bodies are
    # one set of arrays: one balance to compile and to run instead of one per body.

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
            return jnp.stack([precise_sum(cells) for cells in self.apart(values)])

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

    def terms_on(self, index: int) -> SurfaceTerms:
        """The terms on the cells of one body."""
        ends = np.cumsum([0, *self.counts])
        acting = {n for n, row in enumerate(self.entries) if row[index] >= 0}
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


def _joined_cells(
    cell: Sequence[Int[np.ndarray, " _"]], starts: Int[np.ndarray, " b"]
) -> Int[np.ndarray, " s"]:
    """Cells of the fragments of all bodies, numbered from the start of each body."""
    return np.concatenate(
        [
            np.where(body_cell >= 0, body_cell + start, -1)
            for body_cell, start in zip(cell, starts, strict=True)
        ]
    )


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
    joined = _joined_cells(cell, starts)
    loaded = [n for n, count in enumerate(counts) if count]
    if not loaded:
        return None, joined
    loaded_references = [references[n] for n in loaded]
    dtype = terms.half_cell.dtype
    cell_reference = spread(loaded_references, [counts[n] for n in loaded], dtype)
    load = SurfaceLoad(
        terms=terms.coarsened(joined, tuple(counts[n] for n in loaded), cell_reference),
        cells=tuple(body_cells for body_cells in cells if body_cells is not None),
        references=tuple(
            typed_array(reference, dtype) for reference in loaded_references
        ),
        entries=tuple(tuple(row[n] for n in loaded) for row in entries),
        entry_count=entry_count,
    )
    return load, joined
