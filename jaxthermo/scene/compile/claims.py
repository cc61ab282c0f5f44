"""Pieces of surface that belong to one term alone."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...errors import InputError
from ...physics.surface import Binding, Surface, overlap
from ...physics.term import AbstractSurfaceTerm


def acting_fraction(
    term: AbstractSurfaceTerm, surface: Surface, is_acting: Bool[np.ndarray, " s"]
) -> Float[np.ndarray, " s"]:
    """Fraction of each fragment that a term acts on."""
    # A method of a module is a new object in each call: one for all bodies.
    fraction_of = term.acting_fraction
    fractions = [
        np.broadcast_to(np.asarray(fraction_of(body), float), body.area.shape)
        for body in surface.bodies
    ]
    return np.concatenate(fractions) * is_acting


def check_claims(
    bindings: Sequence[tuple[int, Binding]],
    terms: Mapping[int, AbstractSurfaceTerm],
    *,
    surface: Surface,
    verb: str,
    how: str,
) -> None:
    """Check that each piece of a fragment belongs to one term at most.

    Raises:
        InputError: with these words, if two terms claim one piece of a fragment.
    """
    acting: dict[int, Bool[np.ndarray, " s"]] = {}
    for number, binding in bindings:
        acting[number] = acting.get(number, False) | binding.acting
    claimed = np.full(len(surface.body), -1)
    total = np.zeros(len(surface.body))
    for number, is_acting in acting.items():
        fraction = acting_fraction(terms[number], surface, is_acting)
        conflict = overlap(total, fraction)
        if conflict.any():
            raise InputError(
                f"terms[{claimed[conflict].max()}] and terms[{number}] both {verb} a "
                f"piece of body {surface.body[conflict][0]}'s surface {how}".rstrip()
                + ": keep their `on` apart"
            )
        claimed[is_acting] = number
        total += fraction
