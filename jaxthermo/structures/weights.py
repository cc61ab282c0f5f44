"""Weights of conduction: what a cheap structure is tuned with; all 1 to begin with.

A link's conductance is w k A / L with w the product of the weights of its classes: a
link within a level, a link between two levels, and, on top, a link that touches the
surface (one of its nodes has surface fragments). The thesis turned one such number by
hand. A capacity factor per level shifts heat capacity between levels; the total stays.
"""

from typing import Any

import equinox as eqx
import numpy as np

from ..errors import InputError
from ..tracing import is_traced


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

    def __check_init__(self):
        for name, value in self.__dict__.items():
            if is_traced(value):
                continue
            try:
                numbers = np.asarray(value, float)
            except (TypeError, ValueError):
                numbers = np.full((), np.nan)
            least_ok = numbers >= 0 if name != "capacity" else numbers > 0
            if not np.isfinite(numbers).all() or not least_ok.all():
                raise InputError(
                    f"ConductionWeights({name}={value!r}): give finite numbers "
                    + ("above 0" if name == "capacity" else "of at least 0")
                )
            if numbers.ndim > (1 if name in _PER_LEVEL else 0):
                raise InputError(
                    f"ConductionWeights({name}=): give one number"
                    + (" or a list, one a level" if name in _PER_LEVEL else "")
                )

    @property
    def are_one(self) -> bool:
        """Whether conduction is known to be the plain two-point flux."""
        values = (self.within, self.between, self.surface, self.capacity)
        known = not any(is_traced(value) for value in values)
        return known and all(np.all(np.asarray(value) == 1) for value in values)


_PER_LEVEL = ("within", "between", "capacity")
