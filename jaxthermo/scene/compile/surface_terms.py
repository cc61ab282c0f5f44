"""Surface terms bound to a scene: which act, on which fragments, and how strongly.

Terms that prescribe a temperature are bound first: no other term acts there.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from ...errors import InputError
from ...physics.term import AbstractSurfaceTerm, AbstractTerm, Binding, Omitted, Surface


# Bindings with the number of their term in the scene.
_NumberedBindings = tuple[tuple[int, Binding], ...]


class BoundSurface(NamedTuple):
    """The surface of a scene at one moment, and the terms that act on it."""

    surface: Surface
    natural: _NumberedBindings
    """Terms that give a flux, where no temperature is prescribed."""
    prescribed: _NumberedBindings
    omitted: tuple[tuple[int, Omitted], ...]
    """Terms that do not act on a body, by their number."""

    @property
    def bindings(self) -> _NumberedBindings:
        """All bindings, natural ones first."""
        return (*self.natural, *self.prescribed)

    def reason(self, number: int, body: int) -> str | None:
        """The reason why a term was not bound to a body; None if it was."""
        for omitted, (why, where) in self.omitted:
            if omitted == number and where in (None, body):
                return why
        return None


def bind_terms(terms: Sequence[AbstractTerm], surface: Surface) -> BoundSurface:
    """Prescribed temperatures first, then all that acts where there is none.

    Raises:
        InputError: if two terms prescribe the temperature of one piece of surface.
    """
    numbered = [
        (n, term)
        for n, term in enumerate(terms)
        if isinstance(term, AbstractSurfaceTerm)
    ]
    omitted: list[tuple[int, Omitted]] = []
    dirichlet = [(n, term) for n, term in numbered if term.is_dirichlet]
    prescribed = _bind(dirichlet, surface, omitted)
    # Number of the term that prescribes the temperature of each fragment.
    taken = np.full(len(surface.body), -1)
    for number, binding in prescribed:
        _refuse_twice(taken[binding.acts], number, surface.body[binding.acts])
        taken[binding.acts] = number
    # What other terms bring there has no effect: they are not bound.
    rest = replace(
        surface,
        bodies=tuple(
            replace(body, natural=body.natural & free)
            for body, free in zip(surface.bodies, surface.apart(taken < 0), strict=True)
        ),
    )
    others = [(n, term) for n, term in numbered if not term.is_dirichlet]
    natural = _bind(others, rest, omitted)
    return BoundSurface(rest, natural, prescribed, tuple(omitted))


def _bind(
    terms: list[tuple[int, AbstractSurfaceTerm]],
    surface: Surface,
    omitted: list[tuple[int, Omitted]],
) -> _NumberedBindings:
    bindings = []
    for number, term in terms:
        for found in term.bind(surface):
            if isinstance(found, Omitted):
                omitted.append((number, found))
            else:
                bindings.append((number, found))
    return tuple(bindings)


def _refuse_twice(before: np.ndarray, number: int, body: np.ndarray) -> None:
    if (before >= 0).any():
        raise InputError(
            f"terms[{before.max()}] and terms[{number}] both hold a piece of body "
            f"{body[before >= 0][0]}'s surface at a temperature: keep their `on` apart"
        )


def acting(surfaces: list[BoundSurface]) -> list[Bool[np.ndarray, " s"]]:
    """Fragments on which each binding acts at any snapshot."""
    # A light that moves reaches a fragment at some snapshots only.
    rows = zip(*(each.bindings for each in surfaces), strict=True)
    return [np.any([binding.acts for _, binding in row], axis=0) for row in rows]


def with_terms(bound: BoundSurface, keep: Sequence[bool]) -> BoundSurface:
    """The surface without some of its bindings."""
    first = len(bound.natural)
    pick = lambda row, flags: tuple(x for x, k in zip(row, flags, strict=True) if k)
    return bound._replace(
        natural=pick(bound.natural, keep[:first]),
        prescribed=pick(bound.prescribed, keep[first:]),
    )


def ledger_bodies(
    surfaces: list[BoundSurface], prune: bool
) -> dict[int, tuple[int, ...]]:
    """Bodies on which each term acts at any snapshot, by the term's number."""
    first, found = surfaces[0], {}
    for (number, _), where in zip(first.bindings, acting(surfaces), strict=True):
        for body, acts in enumerate(first.surface.apart(where)):
            # Without pruning an idle term has entries too: they stay 0.
            bound = not prune and first.reason(number, body) is None
            if bound or acts.any():
                found.setdefault(number, set()).add(body)
    return {number: tuple(sorted(bodies)) for number, bodies in found.items()}
