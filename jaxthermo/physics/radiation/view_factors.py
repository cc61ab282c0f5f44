"""View factors between patches of several bodies, from global lines.

The sampled areas A_i F_ij are scaled to the true areas of the patches. Pairs of bodies
that are apart have samples of their own.

The number of directions is given, or follows from an error estimate: it is doubled
until the estimate is small enough. Each new Fibonacci spiral covers all directions;
half of its difference from the coarser ones remains as an error in the mean of both.
The error is that of the exchange between the sides of bodies, six on each, and with the
surroundings. Single patches are less accurate than their sums.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...memo.stored import stored_search
from .global_lines import (
    LineSums,
    PairCone,
    pair_cones,
    sample_all_directions,
    sample_pair,
)
from .patches import PatchedBody


DEFAULT_DIRECTIONS = 128
"""Directions of the whole scene, and also of the cone between each pair of bodies."""

_DEFAULT_LINES = 64
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
    lines: int = _DEFAULT_LINES,
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
    factors = _exchange_areas(bodies, sample_all_directions(bodies, directions, lines))
    for cone in pair_cones(bodies):
        seen = sample_pair(bodies, cone=cone, directions=directions, lines=lines)
        factors = _with_pair(factors, seen=seen, bodies=bodies, pair=cone.pair)
    return factors


def _exchange_areas(bodies: tuple[PatchedBody, ...], lines: LineSums) -> ViewFactors:
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


def _with_pair(
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


MIN_DIRECTIONS = 128
"""Smallest limit of the number of directions."""

DEFAULT_MAX_DIRECTIONS = 4096
"""Limit of the number of directions."""

# First number of directions.
_FIRST = 16

# Doublings before an estimate is trusted: a single difference may be small by chance.
_DOUBLINGS = 3

# Estimates below this leave nothing to refine, such as those of a convex body alone.
_NEGLIGIBLE = 1e-9

# View factors below this count by their difference from it, not by their own size.
_SMALL_VIEW_FACTOR = 0.05

_SIDES = 6

_Sample = TypeVar("_Sample", bound=Any)


class Sampling(NamedTuple):
    """Number of directions in which view factors were sampled, with their error."""

    directions: int
    error: float
    """Estimated error relative to the exchange of a body [-]; nan if the number of
    directions was prescribed."""
    limit: float
    """Largest error that the user allows [-]."""

    @property
    def note(self) -> str:
        """Remark for the receipt."""
        factors = f"view factors from {self.directions} directions"
        if np.isnan(self.error):
            return f"{factors}, as given; their error is not estimated"
        estimate = f"{factors}, with an estimated error of {100 * self.error:.2g} %"
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
    lines: int = _DEFAULT_LINES,
) -> tuple[ViewFactors, Sampling]:
    """View factors with an estimated relative error of at most `error`, if possible."""
    cones = pair_cones(bodies)
    apart = {cone.pair for cone in cones}
    scene = _refine(
        lambda count: sample_all_directions(bodies, count, lines),
        difference=lambda coarse, fine: _difference(
            bodies, coarse=coarse, fine=fine, apart=apart
        ),
        error=error,
        max_directions=max_directions,
    )
    factors = _exchange_areas(bodies, scene.mean)
    refined = [scene]
    for cone in cones:
        pair = _refine(
            lambda count, cone=cone: sample_pair(
                bodies, cone=cone, directions=count, lines=lines
            ),
            difference=lambda coarse, fine, cone=cone: _pair_difference(
                bodies, coarse=coarse, fine=fine, cone=cone
            ),
            error=error,
            max_directions=max_directions,
        )
        factors = _with_pair(factors, seen=pair.mean, bodies=bodies, pair=cone.pair)
        refined.append(pair)
    sampling = Sampling(
        directions=max(sample.directions for sample in refined),
        error=max(sample.error for sample in refined),
        limit=error,
    )
    return factors, sampling


class _Refined(NamedTuple):
    mean: Any
    """Weighted mean of the samples."""
    directions: int
    """Number of directions of the finest sample."""
    error: float
    """Estimated relative error of the mean [-]."""


def _refine(
    sample: Callable[[int], _Sample],
    difference: Callable[[_Sample, _Sample], float],
    error: float,
    max_directions: int,
) -> _Refined:
    """Samples with doubled numbers of directions until their error is small enough."""
    count = _FIRST
    mean = sample(count)
    estimate = 0.0
    doublings = 0
    while 2 * count <= max_directions:
        count *= 2
        doublings += 1
        finer = sample(count)
        # Twice the directions halve the error: an estimate holds for the next, too.
        estimate = max(difference(mean, finer) / 2, estimate / 2)
        # The finer spiral weighs more, as its error is about half as large.
        mean = jax.tree.map(lambda a, b: (a + 2 * b) / 3, mean, finer)
        settled = doublings >= _DOUBLINGS and estimate <= error
        if settled or estimate <= _NEGLIGIBLE:
            break
    return _Refined(mean, directions=count, error=estimate)


def _by_side(bodies: tuple[PatchedBody, ...]) -> Float[np.ndarray, "g p"]:
    """1 for the patches on each side of each body, else 0."""
    side = [_SIDES * n + b.patches.code % _SIDES for n, b in enumerate(bodies)]
    return np.equal.outer(np.arange(_SIDES * len(bodies)), np.concatenate(side)) * 1.0


def _difference(
    bodies: tuple[PatchedBody, ...],
    coarse: LineSums,
    fine: LineSums,
    apart: set[tuple[int, int]],
) -> float:
    """Largest relative difference of the exchange of two bodies, or within one [-].

    Pairs that are `apart` are left out: they have samples of their own.
    """
    sides = _by_side(bodies)
    count = len(bodies)
    area = np.array([body.patches.area.sum() for body in bodies])
    a = _exchange_areas(bodies, coarse)
    b = _exchange_areas(bodies, fine)

    # Sums over the sides of each body, or of both bodies of a pair.
    def over_sides(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        if values.ndim == 1:
            return values.reshape(count, _SIDES).sum(1)
        return values.reshape(count, _SIDES, count, _SIDES).sum((1, 3))

    def relative(
        first: Float[np.ndarray, "..."],
        second: Float[np.ndarray, "..."],
        reference_area: Float[np.ndarray, "..."],
    ) -> Float[np.ndarray, "..."]:
        exchanged = over_sides(first + second) / 2
        smallest = _SMALL_VIEW_FACTOR * reference_area
        return over_sides(np.abs(first - second)) / np.maximum(exchanged, smallest)

    between = relative(
        sides @ a.between @ sides.T,
        sides @ b.between @ sides.T,
        np.minimum.outer(area, area),
    )
    for i, j in apart:
        between[i, j] = 0.0
        between[j, i] = 0.0
    outside = relative(sides @ a.outside, sides @ b.outside, area)
    return float(max(between.max(), outside.max()))


def _pair_difference(
    bodies: tuple[PatchedBody, ...],
    coarse: Float[np.ndarray, "p p"],
    fine: Float[np.ndarray, "p p"],
    cone: PairCone,
) -> float:
    """Relative difference of the exchange of the cone's two bodies [-]."""
    sides = _by_side(bodies)
    a = sides @ coarse @ sides.T
    b = sides @ fine @ sides.T
    # Largest area that the lines of the cone carry, in both directions [m^2].
    cone_area = 4 * (1 - cone.min_cosine) * cone.extent**2
    exchanged = max((a + b).sum() / 2, _SMALL_VIEW_FACTOR * cone_area)
    return float(np.abs(a - b).sum() / exchanged)
