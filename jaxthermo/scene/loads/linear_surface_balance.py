"""The balance at a surface on which all laws are linear, solved for all temperatures.

With weights w of drives d(t), losses s and the half cell's conductance G, each a sum
over the terms at a place,

    heat rate to the node = G / (G + s) (w d(t) - s T_node),

and an entry of the ledger with weights w_e and losses s_e brings

    w_e d(t) - s_e (w d(t) + G T_node) / (G + s).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import BoundTerm, LinearLaw


class _Part(NamedTuple):
    """A term on the places."""

    entry: int
    drive: int
    weight: Any
    """[W per unit of the drive]"""
    loss: Any
    """[W/K]; None for nothing."""


class LinearBalance:
    """The balance of all places, solved: arrays with a value a place.

    On the host in double precision where nothing is traced.
    """

    def __init__(
        self,
        terms: SurfaceTerms,
        free: list[LinearLaw],
        held: list[LinearLaw],
        traced: bool,
    ):
        """Of linear terms at the surface's temperature, and of those that hold it."""
        self._own, self._width = jnp if traced else np, terms.half_cell.dtype
        self._precise = self._width if traced else np.float64
        self.drives: list[Any] = [jnp.ones((), self._width)]
        self._free = [self._part(*e) for e in zip(terms.natural, free, strict=True)]
        self._held = [self._part(*e) for e in zip(terms.prescribed, held, strict=True)]
        self._cell = self._number(terms.half_cell)
        both = self._cell + self._loss(self._free)
        some = self._own.where(both > 0, both, 1)
        # Of what comes to a surface, what goes on to its node; the rest is shed there.
        self._through = self._own.where(both > 0, self._cell, 0) / some
        self._shed = self._own.where(both > 0, 1, 0) / some

    @property
    def entries(self) -> list[int]:
        """Of the ledger."""
        return sorted({part.entry for part in (*self._free, *self._held)})

    def driven(self, drive: int) -> Any:
        """To the node [W per unit of the drive]."""
        free = self._weight(self._free, drive) * self._through
        return free + self._weight(self._held, drive)

    def brought(self, entry: int, drive: int) -> Any:
        """By an entry, with the surface as warm as all of them make it [W per unit]."""
        free, held = self._of(entry)
        shed = self._loss(free) * self._shed * self._weight(self._free, drive)
        return self._weight([*free, *held], drive) - shed

    def slope(self, entry: int) -> Any:
        """Lost by the node to an entry [W/K]; None for nothing."""
        free, held = self._of(entry)
        if all(part.loss is None for part in (*free, *held)):
            return None
        return self._loss(free) * self._through + self._loss(held)

    def _of(self, entry: int) -> tuple[list[_Part], list[_Part]]:
        of = lambda parts: [part for part in parts if part.entry == entry]
        return of(self._free), of(self._held)

    def _number(self, value: Any) -> Any:
        return self._own.asarray(value, self._precise)

    def _weight(self, parts: list[_Part], drive: int) -> Any:
        return sum((p.weight for p in parts if p.drive == drive), 0 * self._cell)

    def _loss(self, parts: list[_Part]) -> Any:
        return sum((p.loss for p in parts if p.loss is not None), 0 * self._cell)

    def _part(self, numbered: tuple[int, BoundTerm], law: LinearLaw) -> _Part:
        """A term; what drives it joins the others if it is a function of time."""
        entry, term = numbered
        share, drive = self._number(term.effective_area), 0
        weight = share * self._number(law.weight)
        if not callable(law.forcing):
            weight = weight * self._number(law.forcing)
        else:
            same = (d for d, each in enumerate(self.drives) if law.forcing is each)
            drive = next(same, len(self.drives))
            if drive == len(self.drives):
                self.drives.append(law.forcing)
        loss = None if law.slope is None else share * self._number(law.slope)
        return _Part(entry, drive, weight, loss)
