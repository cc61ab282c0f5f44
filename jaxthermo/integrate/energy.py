"""Energies of a run at its saved times."""

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Float

from ..physics.flux_law import Values


class Energy(NamedTuple):
    """Energies of all bodies, or of one, at the saved times, since the start [J]."""

    stored_J: Float[Values, " t"]
    """Heat stored [J]."""
    mechanisms: dict[str, Float[Values, " t"]]
    """Heat by each mechanism [J]."""
    contacts: dict[str, Float[Values, " t"]]
    """Heat from the first to the second body of each pair in contact, by a name such as
    "contact 0 (roof)-1 (door)"; of one body, positive into it [J]."""
    bodies: tuple["Energy", ...]
    """Energies of each body; empty within one body."""
    residual_relative: Float[Values, " t"]
    """(stored - sum of mechanisms) / heat moved, by mechanisms or by conduction; of one
    body, contacts count with the mechanisms."""

    def __repr__(self) -> str:
        # Arrays by their shapes, as within a solution.
        return eqx.tree_pformat(self)


class HeatRates(NamedTuple):
    """Heat rates of all bodies, or of one, in a steady state [W]."""

    mechanisms: dict[str, Float[Values, ""]]
    """Heat rate by each mechanism [W]."""
    contacts: dict[str, Float[Values, ""]]
    """Heat rate from the first to the second body of each pair in contact; of one body,
    positive into it [W]."""
    bodies: tuple["HeatRates", ...]
    """Heat rates of each body; empty within one body."""
    residual_relative: Float[Values, ""]
    """Net heat rate over the sum of magnitudes, 0 in a steady state."""

    def __repr__(self) -> str:
        # Arrays by their shapes, as within a solution.
        return eqx.tree_pformat(self)
