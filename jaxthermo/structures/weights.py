"""Weights of conduction: what a cheap structure is tuned with; all 1 to begin with.

A link's conductance is w k A / L with w the product of the weights of its classes: a
link within a level, a link between two levels, and, on top, a link that touches the
surface (one of its nodes has surface fragments). The thesis turned one such number by
hand. A capacity factor per level shifts heat capacity between levels; the total stays.

Where nodes do not fill the body, as in a shell, each can be given the capacity of all
that is nearest to it instead of its own: with V its volume and S that of the voxels
nearest to it, capacities are as V^(1-x) S^x, x = `nearest_capacity`. So is their
total: at 1 it is the body's, also where the nodes alone would hold less.

Nodes on either side of a face may also be apart along it, and then a difference along
the face passes for one across it, which the weight `non_orthogonal` takes off.
"""

from typing import Any

import equinox as eqx
import numpy as np

from ..arrays import is_traced
from ..errors import InputError


class ConductionWeights(eqx.Module):
    """Dimensionless factors; each a number for all levels, or one a level."""

    within: Any = 1.0
    """Of links within level l; one number, or [levels]."""
    between: Any = 1.0
    """Of links between level l and a deeper one; one number, or [levels - 1]."""
    surface: Any = 1.0
    """Of links that touch the surface, on top of the others."""
    capacity: Any = 1.0
    """Of the nodes of level l, before the total is restored; one number, or
    [levels]."""
    surface_distance: Any = 1.0
    """Of the distance between a surface and its node, in the surface map."""
    nearest_capacity: Any = 0.0
    """Of what is nearest to a node in its capacity: 0 none, 1 all; any number."""
    non_orthogonal: Any = 0.0
    """Of what links take for a difference across their face and is one along it, the
    part that is taken off: 0 none, 1 all. Only explicit solvers can step it."""
    links: Any = 1.0
    """Of every link, on top of the others; one number, or [links]."""

    def __check_init__(self):
        for name, value in self.__dict__.items():
            if is_traced(value):
                continue
            try:
                numbers = np.asarray(value, float)
            except (TypeError, ValueError):
                numbers = np.full((), np.nan)
            words, allowed = _RANGES.get(name, _AT_LEAST_0)
            if not np.isfinite(numbers).all() or not allowed(numbers).all():
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
        """Whether links and capacities are known to have no factors."""
        values = (self.within, self.between, self.surface, self.capacity, self.links)
        known = not any(is_traced(value) for value in (*values, self.nearest_capacity))
        plain = known and all(np.all(np.asarray(value) == 1) for value in values)
        return plain and not self.uses_nearest_capacity

    @property
    def uses_nearest_capacity(self) -> bool:
        """Whether what is nearest to a node counts in its capacity, or may."""
        return _counts(self.nearest_capacity)

    @property
    def corrects_non_orthogonality(self) -> bool:
        """Whether differences along faces are taken off, or may be."""
        return _counts(self.non_orthogonal)


def _counts(value: Any) -> bool:
    return is_traced(value) or bool(np.asarray(value) != 0)


_LISTS = {
    "within": "level",
    "between": "level",
    "capacity": "level",
    "links": "link",
}
"""Weights that may be a list, and of what."""

_AT_LEAST_0 = ("of at least 0", lambda numbers: numbers >= 0)
_RANGES = {
    "capacity": ("above 0", lambda numbers: numbers > 0),
    "nearest_capacity": ("from -10 to 10", lambda numbers: abs(numbers) <= 10),
    "non_orthogonal": (
        "from -1 to 2",
        lambda numbers: (numbers >= -1) & (numbers <= 2),
    ),
}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:56]}..."
