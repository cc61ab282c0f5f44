"""View factors between the patches of near bodies, reciprocal and closed.

Sampled areas A_i F_ij are symmetric as they are. They are made to add up by a symmetric
scaling, A_i F_ij -> d_i A_i F_ij d_j, such that with the surroundings every row adds up
to the patch's true area: what sees nothing stays so, and a sealed cavity stays sealed.
The rounding that is left goes to the patch's own F_ii, which exchanges nothing.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from .view_factors import PatchedBody, Sight, all_round, towards


DIRECTIONS = 128
"""All round, and again as many from each body to each other one."""

ACROSS = 64
"""Lines over the largest extent of the scene, and of a body that is looked at."""

ROUNDS = 200


class ViewFactors(NamedTuple):
    """Of all bodies' patches, one after the other."""

    area: Float[np.ndarray, " p"]
    """[m^2]"""
    between: Float[np.ndarray, "p p"]
    """A_i F_ij, symmetric [m^2]."""
    outside: Float[np.ndarray, " p"]
    """A_i F_i,surroundings [m^2]."""

    @property
    def factor(self) -> Float[np.ndarray, "p p"]:
        """F_ij: the share of what patch i emits that reaches patch j."""
        return self.between / self.area[:, None]

    @property
    def to_surroundings(self) -> Float[np.ndarray, " p"]:
        """F of each patch to the surroundings; with the others 1 in sum."""
        return self.outside / self.area


def view_factors(
    bodies: tuple[PatchedBody, ...],
    directions: int = DIRECTIONS,
    across: int = ACROSS,
) -> ViewFactors:
    """View factors by lines of sight, for any number of bodies of any shape.

    Args:
        bodies: whose surfaces exchange; all of them may stand in each other's way.
        directions: how many views of the scene, and of each pair of bodies.
        across: lines over the largest extent, of the scene or of the smaller body.

    Raises:
        InputError: for fewer than 8 directions or lines.
    """
    if directions < 8 or across < 8:
        raise InputError(
            f"view factors: directions={directions}, across={across}; "
            "give 8 or more of both"
        )
    extent = max(float(np.ptp(b.triangles.reshape(-1, 3), 0).max()) for b in bodies)
    area = np.concatenate([body.patches.area for body in bodies])
    found = balanced(all_round(bodies, directions, extent / across), area)
    for first in range(len(bodies)):
        for second in range(first + 1, len(bodies)):
            seen = towards(bodies, (first, second), directions, across)
            if seen is not None:
                found = _replaced(found, seen, bodies, (first, second))
    return found


def _replaced(found: ViewFactors, seen, bodies, pair: tuple[int, int]) -> ViewFactors:
    """With one pair of bodies sampled better; the surroundings take the difference."""
    counts = [body.patches.count for body in bodies]
    number = np.repeat(np.arange(len(bodies)), counts)
    a, b = number == pair[0], number == pair[1]
    between = np.where((a[:, None] & b) | (b[:, None] & a), seen, found.between)
    outside = found.outside + (found.between - between).sum(1)
    return balanced(Sight(between, np.maximum(outside, 0.0)), found.area)


def balanced(sight: Sight, area: Float[np.ndarray, " p"]) -> ViewFactors:
    """Scaled such that every patch sees as much as it has area.

    Args:
        sight: symmetric, as sampled.
        area: of the patches [m^2].
    """
    between = sight.between
    # A patch that no line has met sees the surroundings.
    met = between.sum(1) + sight.outside > 0
    outside = np.where(met, sight.outside, area)
    scale = np.ones(len(area))
    for _ in range(ROUNDS):
        row = scale * (between @ scale + outside)
        # The square root keeps the two ends of a pair from overcorrecting each other.
        scale = scale * np.sqrt(area / row)
        if np.abs(row - area).max() <= 1e-13 * area.max():
            break
    between = between * np.outer(scale, scale)
    outside = scale * outside
    between[np.diag_indices(len(area))] += area - between.sum(1) - outside
    return ViewFactors(area, between, outside)
