"""Terms on surface cells that each combine several fragments.

Areas and conductances add up; laws are averaged by effective area, so that the heat at
one temperature stays the same.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int
from scipy.sparse import csr_array

from ..arrays import is_traced
from ..memo.found import found
from ..memo.once import once
from ..network.network import inverse
from .flux_law import BoundTerm, totals
from .surface_energy_balance import SurfaceTerms


@dataclass(frozen=True, eq=False)
class Coarsening:
    """Cells of fragments; what several `SurfaceTerms` share is combined once."""

    cell: Int[np.ndarray, " s"]
    """Number of the cell of each fragment, or -1 to drop it."""
    counts: tuple[int, ...]
    """Number of cells of each body."""
    reference: Any
    """Reference temperature of the cells [K]."""

    def terms(self, terms: SurfaceTerms) -> SurfaceTerms:
        """The terms of fragments, on the cells."""
        return replace(
            terms.mapped(self._term),
            half_cell=self._half_cell(terms.half_cell),
        )

    @cached_property
    def _half_cell(self) -> Callable[[Any], Any]:
        return once(self._sums)

    @cached_property
    def _term(self) -> Callable[[BoundTerm], BoundTerm]:
        return once(self._merged)

    def _sums(self, values: Any) -> Any:
        """Sums over the fragments of each cell."""
        cells = sum(self.counts)
        if is_traced(values):
            fragments = np.flatnonzero(self.cell >= 0)
            if len(fragments) < len(self.cell):
                values = values[..., fragments]
            return jax.ops.segment_sum(values.T, self.cell[fragments], cells).T
        by_cell = found(
            (self.cell,), ("by cell", cells), lambda: _by_cell(self.cell, cells)
        )
        host = np.asarray(values)
        return (by_cell @ host.T).T.astype(host.dtype)

    def _merged(self, term: BoundTerm) -> BoundTerm:
        area = self._sums(term.effective_area)

        def mean(values):
            heat = self._sums(values * _along_last(term.effective_area, values))
            return heat * _along_last(inverse(jnp.asarray(area)), heat)

        return replace(
            term,
            effective_area=area,
            total_effective_area=totals(area, self.counts),
            law=term.law.coarsened(mean).above(self.reference),
        )


def _along_last(weight, values):
    """Weights of cells, shaped for values that have the cells on the last axis."""
    return weight[(None,) * (values.ndim - 1)]


def _by_cell(cell: Int[np.ndarray, " s"], cells: int) -> csr_array:
    """Matrix that sums values of fragments by cell, without those of cell -1."""
    # In double precision, whatever the type of the values.
    fragments = np.flatnonzero(cell >= 0)
    entries = (np.ones(len(fragments)), (cell[fragments], fragments))
    return csr_array(entries, shape=(cells, len(cell)))
