"""Weights of links and capacities, and fit cards with fitted weights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from equinox import Module

from ..arrays import Numbers, is_traced
from ..errors import InputError
from .card import AbstractCard


class ConductionWeights(Module):
    """Factors of conductances and capacities [-]; all default to the two-point flux.

    A link's conductance is w k A / L with w the product of the weights of its classes:
    a link within a level, a link between two levels, and, in addition, a link that
    touches the surface (one of its nodes has surface fragments). A capacity factor per
    level shifts heat capacity between levels; the total stays the same.

    Where nodes do not fill the body, as in a shell, each node can also represent the
    volume nearest to it: with V its volume and S that of the voxels nearest to it,
    capacities are proportional to V^(1-x) S^x, x = `nearest_capacity`. So is their
    total: at x = 1 it is the body's, even where the nodes alone would hold less.

    `non_orthogonal` corrects the two-point flux where the line between two nodes is not
    normal to their face (see `partition.links`).

    Raises:
        InputError: for values out of range or lists where one number is expected.
    """

    within: Numbers = 1.0
    """Factor of links within level l; one number, or [levels]."""
    between: Numbers = 1.0
    """Factor of links between level l and a deeper one; one number, or [levels - 1]."""
    surface: Numbers = 1.0
    """Additional factor of links that touch the surface."""
    capacity: Numbers = 1.0
    """Factor of capacities in level l, before the total is restored; one number, or
    [levels]."""
    surface_distance: Numbers = 1.0
    """Factor of the distance between a surface and its node, in the surface map."""
    nearest_capacity: Numbers = 0.0
    """Exponent of the nearest voxels' volume in the capacity; usually 0 to 1."""
    non_orthogonal: Numbers = 0.0
    """Fraction of the non-orthogonal correction, 1 for all; explicit solvers only."""
    links: Numbers = 1.0
    """Additional factor of every link; one number, or [links]."""

    def __check_init__(self):
        for name, value in self.__dict__.items():
            if is_traced(value):
                continue
            try:
                numbers = np.asarray(value, float)
            except (TypeError, ValueError):
                numbers = np.full((), np.nan)
            words, low, high = _RANGES.get(name, ("of at least 0", 0.0, np.inf))
            if not (np.isfinite(numbers) & (numbers >= low) & (numbers <= high)).all():
                raise InputError(
                    f"ConductionWeights({name}={_shown(value)}): give finite numbers "
                    + words
                )
            if numbers.ndim > (1 if name in _LISTS else 0):
                raise InputError(
                    f"ConductionWeights({name}=): give one number"
                    + (f" or a list, one a {_LISTS[name]}" if name in _LISTS else "")
                )

    @property
    def are_one(self) -> bool:
        """True if links and capacities are known to have no factors."""
        values = (self.within, self.between, self.surface, self.capacity, self.links)
        if is_traced(values) or self.uses_nearest_capacity:
            return False
        return bool(np.all(np.concatenate(list(map(np.ravel, values))) == 1))

    @property
    def uses_nearest_capacity(self) -> bool:
        """True if `nearest_capacity` is traced or not zero."""
        return _may_act(self.nearest_capacity)

    @property
    def corrects_non_orthogonality(self) -> bool:
        """True if `non_orthogonal` is traced or not zero."""
        return _may_act(self.non_orthogonal)


def _may_act(value: Any) -> bool:
    # A traced value may be anything, so the program must include its term.
    return is_traced(value) or bool(np.asarray(value) != 0)


# Weights that may be a list, and what each entry belongs to.
_LISTS = {"within": "level", "between": "level", "capacity": "level", "links": "link"}

_RANGES = {
    "capacity": ("above 0", np.nextafter(0.0, 1.0), np.inf),
    "nearest_capacity": ("from -10 to 10", -10.0, 10.0),
    "non_orthogonal": ("from -1 to 2", -1.0, 2.0),
}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:56]}..."


@dataclass(frozen=True, eq=False)
class FitCard(AbstractCard):
    """Weights of one kind of structure, with the data of their fit."""

    weights: ConductionWeights


def as_weights(weights: ConductionWeights | FitCard) -> ConductionWeights:
    """Weights themselves, or those of a card."""
    return weights.weights if isinstance(weights, FitCard) else weights
