"""View factors between patches of several bodies, from global lines.

The sampled areas A_i F_ij are scaled to the true areas of the patches. Pairs of bodies
that are apart have samples of their own.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...stored_findings import stored_search
from .global_lines import (
    LineSums,
    pair_cones,
    sample_all_directions,
    sample_pair,
)
from .patches import PatchedBody


DEFAULT_DIRECTIONS = 128
"""Directions of the whole scene, and also of the cone between each pair of bodies."""

DEFAULT_LINES = 64
"""Lines across the largest extent of the scene, or of the smaller body of a pair."""

_MAX_SCALINGS = 200


class ViewFactors(NamedTuple):
    """View factors of the patches of all bodies, concatenated."""

    area: Float[np.ndarray, " p"]
    """Area of each patch [m^2]."""
    between: Float[np.ndarray, "p p"]
    """A_i F_ij, symmetric [m^2]."""
    outside: Float[np.ndarray, " p"]
    """A_i F_i,surroundings [m^2]."""
    visible: Float[np.ndarray, "2 p"] | None = None
    """Fraction of the sky and of the ground that each patch sees [-]; None for all."""

    @property
    def factor(self) -> Float[np.ndarray, "p p"]:
        """View factor F_ij [-]: fraction of emission of patch i that hits patch j."""
        return self.between / self.area[:, None]

    @property
    def to_surroundings(self) -> Float[np.ndarray, " p"]:
        """View factor of each patch to the surroundings [-]."""
        return self.outside / self.area


@stored_search("view_factors", (ViewFactors,))
def view_factors(
    bodies: tuple[PatchedBody, ...],
    directions: int = DEFAULT_DIRECTIONS,
    lines: int = DEFAULT_LINES,
) -> ViewFactors:
    """View factors between the patches of any number of bodies of any shape.

    `directions` views of the scene, and of each pair of bodies, have `lines` lines
    across the largest extent of the scene or the smaller body. All bodies are
    obstacles.

    Raises:
        InputError: for fewer than 8 directions or lines.
    """
    if directions < 8 or lines < 8:
        raise InputError(
            f"view factors: directions={directions}, lines={lines}; "
            "give 8 or more of both"
        )
    factors = exchange_areas(bodies, sample_all_directions(bodies, directions, lines))
    for cone in pair_cones(bodies):
        seen = sample_pair(bodies, cone=cone, directions=directions, lines=lines)
        factors = with_pair(factors, seen=seen, bodies=bodies, pair=cone.pair)
    return factors


def exchange_areas(bodies: tuple[PatchedBody, ...], lines: LineSums) -> ViewFactors:
    """View factors from the lines in all directions."""
    area = np.concatenate([body.patches.area for body in bodies])
    pairs, sky, ground = lines
    between = pairs + pairs.T
    # A patch in a closed cavity that no line has hit exchanges nothing.
    enclosed = np.concatenate([body.patches.enclosed for body in bodies])
    alone = np.flatnonzero(enclosed & (between.sum(1) == 0))
    between[alone, alone] = area[alone]
    balanced = _balance(between, sky + ground, area)
    return balanced._replace(visible=lines.visible)


def with_pair(
    factors: ViewFactors,
    seen: Float[np.ndarray, "p p"],
    bodies: tuple[PatchedBody, ...],
    pair: tuple[int, int],
) -> ViewFactors:
    """View factors with the areas A_i F_ij of one pair of bodies replaced by `seen`."""
    counts = [body.patches.count for body in bodies]
    number = np.repeat(np.arange(len(bodies)), counts)
    a = number == pair[0]
    b = number == pair[1]
    is_pair = (a[:, None] & b) | (b[:, None] & a)
    between = np.where(is_pair, seen, factors.between)
    # The surroundings take the difference, so that the sums of the rows do not change.
    outside = factors.outside + (factors.between - between).sum(1)
    balanced = _balance(between, np.maximum(outside, 0.0), factors.area)
    return balanced._replace(visible=factors.visible)


def _balance(
    between: Float[np.ndarray, "p p"],
    outside: Float[np.ndarray, " p"],
    area: Float[np.ndarray, " p"],
) -> ViewFactors:
    """View factors from sampled areas A_i F_ij, scaled to the patches [m^2]."""
    # The scaling A_i F_ij -> d_i A_i F_ij d_j is symmetric: an F_ij of zero stays zero,
    # and a closed cavity stays closed. The remaining rounding error goes to the patch's
    # own F_ii, which exchanges nothing.
    # A patch that no line has hit sees the surroundings.
    outside = np.where(between.sum(1) + outside > 0, outside, area)
    scale = np.ones(len(area))
    for _ in range(_MAX_SCALINGS):
        row = scale * (between @ scale + outside)
        # The square root keeps the two ends of a pair from overcorrecting each other.
        scale = scale * np.sqrt(area / row)
        if np.abs(row - area).max() <= 1e-13 * area.max():
            break
    between = between * np.outer(scale, scale)
    outside = scale * outside
    between[np.diag_indices(len(area))] += area - between.sum(1) - outside
    return ViewFactors(area=area, between=between, outside=outside)
