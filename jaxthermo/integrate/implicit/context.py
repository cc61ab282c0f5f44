"""What implicit stages need of a scene besides its program."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool

from ...network.multigrid import Hierarchy
from .deflation import Parts


class Tools(eqx.Module):
    """Made once a run."""

    hierarchies: tuple[Hierarchy | None, ...]
    """Of the bodies; None to precondition by the diagonal."""
    parts: tuple[Parts, ...]
    """Of each body."""
    nodes: tuple[Bool[Array, "..."] | None, ...]
    """Where each body's state has nodes; None for everywhere."""
    ceilings: tuple[Any, ...]
    """Of each body's states [K]; infinite where there is no bound."""
    tolerance: Any
    """Of linear solves [K]."""
    linear: bool = eqx.field(static=True)
    """Whether one step of Newton's method is the solution."""
    differentiable: bool = eqx.field(static=True, default=False)
    """Whether derivatives may be asked for: that costs a residual more."""
