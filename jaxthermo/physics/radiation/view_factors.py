"""View factors between patches of several bodies, from global lines.

The sampled areas A_i F_ij are a sparse matrix, scaled to the true areas of the patches:
memory and time grow with the number of lines.

The number of directions is given, or follows from an error estimate: it is doubled
until the estimate is small enough. Each new Fibonacci spiral covers all directions;
half of its difference from the coarser ones remains as an error in the mean of both.
The error is that of the exchange between bodies and with the surroundings, summed over
their sides, six on each. Single patches are less accurate than their sums. All
bodies share the lines until few pairs of bodies that are apart need more; these have
lines of their own.
"""

import time
from collections.abc import Callable
from itertools import combinations
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array, diags_array

from ...errors import InputError
from ...memo.stored import stored_search
from .global_lines import (
    LineSums,
    PairCone,
    pair_cone,
    sample_pair,
)
from .line_hits import LineScene
from .lines_at_rest import sample_around_motion
from .patches import PatchedBody
from .sampling_cost import SamplingCost


DEFAULT_DIRECTIONS = 128
"""Directions of the whole scene, and also of the cone between each pair of bodies."""

_MAX_SCALINGS = 200

# Pairs of bodies with lines of their own: with more of them, all share more lines.
_MAX_CONES = 8


class ViewFactors(NamedTuple):
    """View factors of the patches of all bodies, concatenated."""

    area: Float[np.ndarray, " p"]
    """Area of each patch [m^2]."""
    between: csr_array
    """A_i F_ij, symmetric [m^2]."""
    outside: Float[np.ndarray, " p"]
    """A_i F_i,surroundings [m^2]."""
    visible: Float[np.ndarray, "2 p"] | None = None
    """Fraction of the sky and of the ground that each patch sees [-]; None for all."""
    sampled: Float[np.ndarray, " p"] | None = None
    """Sum of the row of each patch as sampled, before it was scaled to 1 [-]; nan for
    patches that touch another body, None if nothing was sampled."""

    @property
    def factor(self) -> csr_array:
        """View factor F_ij [-]: fraction of emission of patch i that hits patch j."""
        return csr_array(diags_array(1 / self.area) @ self.between)

    @property
    def to_surroundings(self) -> Float[np.ndarray, " p"]:
        """View factor of each patch to the surroundings [-]."""
        return self.outside / self.area


@stored_search("view_factors", (ViewFactors,))
def view_factors(
    bodies: tuple[PatchedBody, ...],
    directions: int = DEFAULT_DIRECTIONS,
    lines: int | None = None,
    at_rest: tuple[int, ...] = (),
) -> ViewFactors:
    """View factors between the patches of any number of bodies of any shape.

    `directions` views of the scene, and of each pair of bodies that are apart if these
    are few, have `lines` lines across each body, or two across a patch if it is None.
    All bodies are obstacles. Those of the numbers `at_rest` are at the same place in
    other calls, which share their lines.

    Raises:
        InputError: for fewer than 8 directions or lines, or too little memory.
    """
    if directions < 8 or (lines is not None and lines < 8):
        raise InputError(
            f"view factors: directions={directions}, lines={lines}; "
            "give 8 or more of both"
        )
    scene = LineScene.of_bodies(bodies)
    SamplingCost.of_scene(scene, lines).require(directions)
    sums = sample_around_motion(scene, at_rest, directions, lines)
    pairs = list(combinations(range(len(bodies)), 2))
    cones = []
    if len(pairs) <= _MAX_CONES:
        cones = [pair_cone(bodies, pair) for pair in pairs]
    seen = {
        cone.pair: sample_pair(scene, cone=cone, directions=directions, lines=lines)
        for cone in cones
        if cone is not None
    }
    return _with_pairs(_exchange_areas(bodies, sums), seen=seen, bodies=bodies)


def _exchange_areas(bodies: tuple[PatchedBody, ...], lines: LineSums) -> ViewFactors:
    """View factors from the lines in all directions."""
    area = np.concatenate([body.patches.area for body in bodies])
    between = lines.pairs + lines.pairs.T
    outside = lines.sky + lines.ground
    is_touched = np.concatenate([body.patches.is_touched for body in bodies])
    sampled = np.where(is_touched, np.nan, (between.sum(1) + outside) / area)
    # A patch in a closed cavity that no line has hit exchanges nothing.
    enclosed = np.concatenate([body.patches.enclosed for body in bodies])
    is_alone = enclosed & (between.sum(1) == 0)
    balanced = _balance(between + diags_array(area * is_alone), outside, area)
    return balanced._replace(visible=lines.visible, sampled=sampled)


def _with_pairs(
    factors: ViewFactors,
    seen: dict[tuple[int, int], csr_array],
    bodies: tuple[PatchedBody, ...],
) -> ViewFactors:
    """View factors with the areas A_i F_ij of some pairs of bodies replaced."""
    if not seen:
        return factors
    counts = [body.patches.count for body in bodies]
    number = np.repeat(np.arange(len(bodies)), counts)
    shared = factors.between.tocoo()
    row, column = (number[ends] for ends in shared.coords)
    code = np.minimum(row, column) * len(bodies) + np.maximum(row, column)
    replaced = [first * len(bodies) + second for first, second in seen]
    values = np.where(np.isin(code, replaced), 0.0, shared.data)
    between = csr_array((values, shared.coords), shape=shared.shape)
    for pair in seen.values():
        between = between + pair
    # The surroundings take the difference, so that the sums of the rows do not change.
    outside = factors.outside + factors.between.sum(1) - between.sum(1)
    balanced = _balance(between, np.maximum(outside, 0.0), factors.area)
    return balanced._replace(visible=factors.visible, sampled=factors.sampled)


def _balance(
    between: csr_array, outside: Float[np.ndarray, " p"], area: Float[np.ndarray, " p"]
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
        scale = scale * np.sqrt(
            np.divide(area, row, out=np.ones_like(row), where=row > 0)
        )
        if np.abs(row - area).max() <= 1e-13 * area.max():
            break
    pairs = between.tocoo()
    first, second = pairs.coords
    values = pairs.data * (scale[first] * scale[second])
    scaled = csr_array((values, pairs.coords), shape=pairs.shape)
    outside = scale * outside
    own = area - scaled.sum(1) - outside
    return ViewFactors(
        area=area, between=csr_array(scaled + diags_array(own)), outside=outside
    )


MIN_DIRECTIONS = 128
"""Smallest limit of the number of directions."""

DEFAULT_MAX_DIRECTIONS = 4096
"""Limit of the number of directions."""

# First number of directions.
_FIRST = 16

# Doublings before an estimate is trusted: a single difference may be small by chance.
_DOUBLINGS = 3

# Directions of all bodies from which single pairs have lines of their own: below, twice
# as many directions for all bodies cost less.
_FIRST_CONES = 512

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
    patches: int = 0
    """Number of patches of all bodies."""
    row_error: float = 0.0
    """Root of the mean square of the sums of rows as sampled, less 1 [-]; nan where no
    row is known."""
    lines: float = 0.0
    """Number of lines between surfaces that all bodies share, about [-]."""
    fits: bool = True
    """False if more directions than these do not fit into memory."""

    @property
    def note(self) -> str:
        """Remark for the receipt."""
        factors = f"view factors from {self.directions} directions"
        if self.patches:
            rows = "rows are scaled to 1"
            if np.isfinite(self.row_error):
                within = f"within {100 * self.row_error:.2g} %"
                rows = f"sampled rows add up to 1 {within} and are scaled to 1"
            factors = (
                f"view factors of {self.patches} patches, whose {rows}, from "
                f"{self.directions} directions"
            )
        if np.isnan(self.error):
            return f"{factors}, as given; their error is not estimated"
        estimate = f"{factors}, with an estimated error of {100 * self.error:.2g} %"
        if self.lines:
            estimate = f"{estimate} by about {self.lines:.2g} lines"
        if self.error <= self.limit:
            return estimate
        remedy = "give more `max_directions`"
        if not self.fits:
            remedy = "more directions do not fit into memory: give fewer `max_patches`"
        return f"{estimate}, more than the {100 * self.limit:.2g} % asked for: {remedy}"

    def of(self, views: ViewFactors) -> "Sampling":
        """The same with the sums of the rows of view factors."""
        sampled = np.ones(len(views.area)) if views.sampled is None else views.sampled
        is_sampled = np.isfinite(sampled)
        row_error = np.nan
        if is_sampled.any():
            square = np.average(
                (sampled[is_sampled] - 1) ** 2, weights=views.area[is_sampled]
            )
            row_error = float(np.sqrt(square))
        return self._replace(patches=len(views.area), row_error=row_error)


@stored_search("refined_view_factors", (ViewFactors, Sampling))
def refined_view_factors(
    bodies: tuple[PatchedBody, ...],
    error: float,
    max_directions: int = DEFAULT_MAX_DIRECTIONS,
    lines: int | None = None,
    at_rest: tuple[int, ...] = (),
) -> tuple[ViewFactors, Sampling]:
    """View factors with an estimated relative error of at most `error`, if possible.

    `at_rest` as in `view_factors`.

    Raises:
        InputError: for too little memory.
    """
    cones = _Cones(bodies)
    line_scene = LineScene.of_bodies(bodies)
    cost = SamplingCost.of_scene(line_scene, lines)
    least = min(_FIRST * 2**_DOUBLINGS, max_directions)
    cost.require(least)
    affordable = max_directions
    while affordable > least and not cost.fits(affordable):
        affordable = max(affordable // 2, least)

    sampled: list[int] = []

    def shared(count: int) -> LineSums:
        sampled.append(count)
        clock = time.perf_counter()
        sums = sample_around_motion(line_scene, at_rest, count, lines)
        if count == _FIRST:
            seconds = time.perf_counter() - clock
            cost.tell(count, seconds=seconds, least=least, most=affordable)
        return sums

    def unresolved(coarse: LineSums, fine: LineSums) -> float:
        differences = _differences(bodies, coarse=coarse, fine=fine)
        if sampled[-1] < _FIRST_CONES:
            return differences[0].value
        return cones.unresolved(differences, 2 * error)

    scene = _refine(
        shared,
        difference=unresolved,
        error=error,
        max_directions=affordable,
    )
    refined = [scene]
    seen = {}
    for cone in cones.chosen:
        pair = _refine(
            lambda count, cone=cone: sample_pair(
                line_scene, cone=cone, directions=count, lines=lines
            ),
            difference=lambda coarse, fine, cone=cone: _pair_difference(
                bodies, coarse=coarse, fine=fine, cone=cone
            ),
            # The others set the error where their lines did not reach the limit.
            error=max(error, scene.error),
            max_directions=max_directions,
        )
        seen[cone.pair] = pair.mean
        refined.append(pair)
    factors = _exchange_areas(bodies, scene.mean)
    factors = _with_pairs(factors, seen=seen, bodies=bodies)
    sampling = Sampling(
        directions=max(sample.directions for sample in refined),
        error=max(sample.error for sample in refined),
        limit=error,
        lines=cost.lines(_FIRST, scene.directions),
        fits=affordable == max_directions,
    )
    return factors, sampling.of(factors)


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


class _Difference(NamedTuple):
    """Relative difference of two samples of an exchange [-]."""

    value: float
    bodies: tuple[int, int]
    """Twice the same one for what a body exchanges within and with the surroundings."""


class _Cones:
    """Cones of the pairs of bodies that need lines of their own."""

    def __init__(self, bodies: tuple[PatchedBody, ...]):
        self._bodies = bodies
        self.chosen: list[PairCone] = []

    def unresolved(self, differences: list[_Difference], limit: float) -> float:
        """Choose cones for the largest differences; return the largest of the others.

        Differences descend; none below the limit has a cone.
        """
        self.chosen = []
        for value, pair in differences:
            cone = None
            is_large = value > limit and len(self.chosen) < _MAX_CONES
            if is_large and pair[0] != pair[1]:
                cone = pair_cone(self._bodies, pair)
            if cone is None:
                return value
            self.chosen.append(cone)
        return 0.0


def _by_side(bodies: tuple[PatchedBody, ...]) -> csr_array:
    """1 for the patches on each side of each body, else 0."""
    side = [_SIDES * n + b.patches.code % _SIDES for n, b in enumerate(bodies)]
    row = np.concatenate(side)
    shape = (_SIDES * len(bodies), len(row))
    return csr_array((np.ones(len(row)), (row, np.arange(len(row)))), shape=shape)


def _of_sides(bodies: tuple[PatchedBody, ...], lines: LineSums) -> ViewFactors:
    """View factors of the sides of bodies, of six patches each."""
    sides = _by_side(bodies)
    area = sides @ np.concatenate([body.patches.area for body in bodies])
    pairs = csr_array(sides @ (lines.pairs + lines.pairs.T) @ sides.T)
    return _balance(pairs, sides @ (lines.sky + lines.ground), area)


def _differences(
    bodies: tuple[PatchedBody, ...], coarse: LineSums, fine: LineSums
) -> list[_Difference]:
    """Relative differences of the exchange of bodies, the largest first."""
    count = len(bodies)
    area = np.array([body.patches.area.sum() for body in bodies])
    a = _of_sides(bodies, coarse)
    b = _of_sides(bodies, fine)
    side = np.arange(_SIDES * count)
    shape = (count, len(side))
    # Sums over the sides of each body, or of both bodies of a pair.
    of_body = csr_array((np.ones(len(side)), (side // _SIDES, side)), shape=shape)
    change = csr_array(of_body @ abs(a.between - b.between) @ of_body.T).tocoo()
    exchanged = csr_array(of_body @ (a.between + b.between) @ of_body.T / 2)
    first, second = change.coords
    smallest = _SMALL_VIEW_FACTOR * np.minimum(area[first], area[second])
    between = change.data / np.maximum(exchanged[first, second], smallest)
    outside = (of_body @ np.abs(a.outside - b.outside)) / np.maximum(
        of_body @ (a.outside + b.outside) / 2, _SMALL_VIEW_FACTOR * area
    )
    once = first <= second
    value = np.concatenate([between[once], outside])
    first = np.concatenate([first[once], np.arange(count)])
    second = np.concatenate([second[once], np.arange(count)])
    return [
        _Difference(float(value[n]), (int(first[n]), int(second[n])))
        for n in np.argsort(-value, kind="stable")
    ]


def _pair_difference(
    bodies: tuple[PatchedBody, ...],
    coarse: csr_array,
    fine: csr_array,
    cone: PairCone,
) -> float:
    """Relative difference of the exchange of the cone's two bodies [-]."""
    sides = _by_side(bodies)
    a = sides @ coarse @ sides.T
    b = sides @ fine @ sides.T
    # Largest area that the lines of the cone carry, in both directions [m^2].
    cone_area = 4 * (1 - cone.min_cosine) * cone.extent**2
    exchanged = max((a + b).sum() / 2, _SMALL_VIEW_FACTOR * cone_area)
    return float(abs(a - b).sum() / exchanged)
