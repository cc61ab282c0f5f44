"""View factors from as many directions as an error estimate asks for.

The number of directions is doubled. Each time a new Fibonacci spiral covers all of
them, and differs from the coarser ones by an error of which half remains in the mean of
both. That error is judged by what bodies exchange: between their sides, six on each,
and with the surroundings. Single patches are less accurate than their sums.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from ...stored_findings import stored_search
from .global_lines import (
    LineSums,
    PairCone,
    pair_cones,
    sample_all_directions,
    sample_pair,
)
from .patches import PatchedBody
from .view_factors import DEFAULT_LINES, ViewFactors, exchange_areas, with_pair


MIN_DIRECTIONS = 128
"""Smallest limit of the number of directions."""

DEFAULT_MAX_DIRECTIONS = 4096
"""Limit of the number of directions."""

# First number of directions, and doublings before an estimate is trusted: a single
# difference may be small by chance.
_FIRST, _DOUBLINGS = 16, 3

# Estimates below this leave nothing to refine, such as those of a convex body alone.
_NEGLIGIBLE = 1e-9

# View factors below this count by their difference from it, not by their own size.
_SMALL_VIEW_FACTOR = 0.05

_SIDES = 6

_Sample = TypeVar("_Sample", bound=Any)


class Sampling(NamedTuple):
    """Directions in which view factors were sampled, and the error that is left."""

    directions: int
    error: float
    """Estimate, relative to the exchange of a body [-]; nan for a given number."""
    limit: float
    """Error that was asked for [-]."""

    @property
    def note(self) -> str:
        """Remark for the receipt."""
        what = f"view factors from {self.directions} directions"
        if np.isnan(self.error):
            return f"{what}, as given; their error is not estimated"
        estimate = f"{what}, with an estimated error of {100 * self.error:.2g} %"
        if self.error <= self.limit:
            return estimate
        return (
            f"{estimate}, more than the {100 * self.limit:.2g} % asked for: "
            "give more `max_directions`"
        )


@stored_search("refined_view_factors", (ViewFactors, Sampling))
def refined_view_factors(
    bodies: tuple[PatchedBody, ...],
    error: float,
    max_directions: int = DEFAULT_MAX_DIRECTIONS,
    lines: int = DEFAULT_LINES,
) -> tuple[ViewFactors, Sampling]:
    """View factors with an estimated relative error of at most `error`, if possible."""
    cones = pair_cones(bodies)
    apart = {cone.pair for cone in cones}
    summed, used, worst = _refine(
        lambda count: sample_all_directions(bodies, count, lines),
        difference=lambda one, other: _difference(
            bodies, one=one, other=other, apart=apart
        ),
        error=error,
        max_directions=max_directions,
    )
    found = exchange_areas(bodies, summed)
    for cone in cones:
        seen, count, left = _refine(
            lambda count, cone=cone: sample_pair(
                bodies, cone=cone, directions=count, lines=lines
            ),
            difference=lambda one, other, cone=cone: _pair_difference(
                bodies, one=one, other=other, cone=cone
            ),
            error=error,
            max_directions=max_directions,
        )
        found = with_pair(found, seen=seen, bodies=bodies, pair=cone.pair)
        used, worst = max(used, count), max(worst, left)
    return found, Sampling(used, worst, error)


def _refine(
    sample: Callable[[int], _Sample],
    difference: Callable[[_Sample, _Sample], float],
    error: float,
    max_directions: int,
) -> tuple[_Sample, int, float]:
    """A mean of samples, the number of directions in the last, and its error."""
    count, doublings = _FIRST, 0
    found, estimate = sample(count), 0.0
    while 2 * count <= max_directions:
        count, doublings = 2 * count, doublings + 1
        finer = sample(count)
        # Twice the directions halve the error: an estimate holds for the next, too.
        estimate = max(difference(found, finer) / 2, estimate / 2)
        # The finer spiral weighs more, as its error is about half as large.
        found = jax.tree.map(lambda a, b: (a + 2 * b) / 3, found, finer)
        settled = doublings >= _DOUBLINGS and estimate <= error
        if settled or estimate <= _NEGLIGIBLE:
            break
    return found, count, estimate


def _by_side(bodies: tuple[PatchedBody, ...]) -> Float[np.ndarray, "g p"]:
    """1 for the patches on each side of each body, else 0."""
    side = [_SIDES * n + b.patches.code % _SIDES for n, b in enumerate(bodies)]
    return np.equal.outer(np.arange(_SIDES * len(bodies)), np.concatenate(side)) * 1.0


def _difference(
    bodies: tuple[PatchedBody, ...],
    one: LineSums,
    other: LineSums,
    apart: set[tuple[int, int]],
) -> float:
    """Largest relative difference of what two bodies, or one, exchange [-].

    Pairs that are `apart` have samples of their own.
    """
    sides, count = _by_side(bodies), len(bodies)
    area = np.array([body.patches.area.sum() for body in bodies])
    views = [exchange_areas(bodies, lines) for lines in (one, other)]
    a, b = (sides @ view.between @ sides.T for view in views)
    block = lambda x: x.reshape(count, _SIDES, count, _SIDES).sum((1, 3))
    least = _SMALL_VIEW_FACTOR * np.minimum.outer(area, area)
    between = block(np.abs(a - b)) / np.maximum(block(a + b) / 2, least)
    for pair in apart:
        between[pair] = between[pair[::-1]] = 0.0
    a, b = (sides @ view.outside for view in views)
    row = lambda x: x.reshape(count, _SIDES).sum(1)
    least = _SMALL_VIEW_FACTOR * area
    outside = row(np.abs(a - b)) / np.maximum(row(a + b) / 2, least)
    return float(max(between.max(), outside.max()))


def _pair_difference(
    bodies: tuple[PatchedBody, ...],
    one: Float[np.ndarray, "p p"],
    other: Float[np.ndarray, "p p"],
    cone: PairCone,
) -> float:
    """Relative difference of what two bodies exchange [-]."""
    sides = _by_side(bodies)
    a, b = (sides @ between @ sides.T for between in (one, other))
    # The lines of the cone carry at most this, in both directions [m^2].
    least = _SMALL_VIEW_FACTOR * 4 * (1 - cone.min_cosine) * cone.extent**2
    return float(np.abs(a - b).sum() / max((a + b).sum() / 2, least))
