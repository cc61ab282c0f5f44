"""Pieces of surface that belong to one term alone."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Int

from ...errors import InputError
from ...physics.surface import Binding, Surface
from ...physics.term import AbstractSurfaceTerm


# Largest sum of the fractions of a fragment that two terms select side by side, which
# have the areas of the mesh and not of the fragment.
_MAX_CLAIM = 1.25


def claimed_fragments(
    bindings: Sequence[tuple[int, Binding]],
    terms: Mapping[int, AbstractSurfaceTerm],
    *,
    surface: Surface,
    verb: str,
    how: str,
) -> Int[np.ndarray, " s"]:
    """Number of the last term that each fragment belongs to, or -1.

    Raises:
        InputError: with these words, if two terms claim one piece of a fragment.
    """
    acting: dict[int, Bool[np.ndarray, " s"]] = {}
    for number, binding in bindings:
        acting[number] = acting.get(number, False) | binding.acting
    claimed = np.full(len(surface.body), -1)
    total = np.zeros(len(surface.body))
    for number, is_acting in acting.items():
        fractions = [
            np.broadcast_to(terms[number].acting_fraction(body), body.area.shape)
            for body in surface.bodies
        ]
        fraction = np.concatenate(fractions) * is_acting
        conflict = (total > 0) & (total + fraction > _MAX_CLAIM)
        if conflict.any():
            raise InputError(
                f"terms[{claimed[conflict].max()}] and terms[{number}] both {verb} a "
                f"piece of body {surface.body[conflict][0]}'s surface {how}".rstrip()
                + ": keep their `on` apart"
            )
        claimed[is_acting] = number
        total += fraction
    return claimed
