"""Linear terms at the cells of a surface, whose temperature is eliminated.

Where every law is w d(t) - s T_s with s constant, the balance at the surface has one
solution for all times and temperatures. With weights w of forcings d(t), slopes s and
the half cell's conductance G, each a sum over the terms at a cell, the node receives

    q = G / (G + s) (w d(t) - s T_node),

and the surface is above it by (w d(t) - s T_node) / (G + s). A prescribed temperature
acts on the node directly.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...arrays import is_traced
from ...physics.flux_law import LinearLaw
from ...physics.surface_energy_balance import SurfaceTerms


class LinearTerm(NamedTuple):
    """A term with a linear law on the cells of a body."""

    number: int
    """Number of its mechanism among the surface terms."""
    is_prescribed: bool
    """True if it prescribes the temperature of its cells."""
    law: LinearLaw
    area: Any
    """Effective area [m^2], or the conductance of a prescribed temperature [W/K]."""

    @property
    def weight(self) -> Any:
        """Heat rate of every cell by one unit of the forcing [W per unit]."""
        return self.area * self.law.weight

    @property
    def slope(self) -> Any:
        """Heat that every cell loses [W/K]."""
        return 0 if self.law.slope is None else self.area * self.law.slope


class LinearSurface(NamedTuple):
    """Linear terms on cells, with the balance solved for the surface temperature."""

    half_cell: Any
    """G [W/K]."""
    terms: tuple[LinearTerm, ...]
    """Terms, those that prescribe temperatures last."""
    through: Any
    """G / (G + s) [-]: fraction of the terms' heat that goes to the node."""
    resistance: Any
    """1 / (G + s) [K/W]: excess of the surface over the node by their heat."""

    def heat(self, term: LinearTerm) -> Any:
        """Heat rate of the node of every cell by one unit of a term [W per unit]."""
        return term.weight if term.is_prescribed else term.weight * self.through

    def excess(self, term: LinearTerm) -> Any:
        """Excess of every cell over its node by one unit of a term [K per unit]."""
        if term.is_prescribed:
            return np.where(term.area > 0, term.law.weight, 0.0)
        excess = term.weight * self.resistance
        for prescribing in self.terms:
            if prescribing.is_prescribed:
                excess = np.where(prescribing.area > 0, 0.0, excess)
        return excess


def nonlinear_term(terms: SurfaceTerms) -> int | None:
    """Number of the first term whose law is not linear; None without one."""
    numbered = (*terms.natural, *terms.prescribed)
    return next((n for n, term in numbered if term.law.linear() is None), None)


def linear_surface(terms: SurfaceTerms) -> LinearSurface:
    """Solve the balance of terms that are all linear; 0 where nothing acts."""
    laws = []
    for is_prescribed, numbered in ((False, terms.natural), (True, terms.prescribed)):
        for number, term in numbered:
            law = term.law.linear()
            assert law is not None
            laws.append((number, is_prescribed, law, term.effective_area))
    # On the host in double precision where nothing is traced: the sums over cells are
    # then as exact as the general form in the time loop.
    traced = is_traced((terms, laws))
    xp: Any = jnp if traced else np
    dtype = terms.half_cell.dtype if traced else np.float64

    def array(value: Any) -> Any:
        return value if value is None or callable(value) else xp.asarray(value, dtype)

    linear_terms = tuple(
        LinearTerm(
            number=number,
            is_prescribed=is_prescribed,
            law=LinearLaw(*map(array, law)),
            area=array(area),
        )
        for number, is_prescribed, law, area in laws
    )
    half_cell = array(terms.half_cell)
    slope = total_slope(term for term in linear_terms if not term.is_prescribed)
    total = half_cell + slope
    safe_total = xp.where(total > 0, total, 1)
    return LinearSurface(
        half_cell=half_cell,
        terms=linear_terms,
        through=xp.where(total > 0, half_cell, 0) / safe_total,
        resistance=xp.where(total > 0, 1, 0) / safe_total,
    )


def total_slope(terms: Iterable[LinearTerm]) -> Any:
    """Heat that every cell loses by several terms [W/K]."""
    return sum(term.slope for term in terms)
