"""Global lines through a scene, which count the patches that see each other.

Along every line of a view, surfaces follow each other in the order of their depth
layers. Where the line leaves one surface and enters the next, the two see each other
along it, in both directions, and its first and last surface see the surroundings. So

    A_i F_ij = integral over directions of dw/pi, over the lines of dA, of [i sees j],

with as many views as directions, no lines of its own for any patch, symmetric by
construction, and obstacles are found by the same sort that orders the layers. A thin
wall is entered and left at one point, through both of its faces. All bodies share the
lines; a body with much smaller patches than the largest ones has denser lines of its
own, which count what it exchanges. Source: the global lines of Sbert, Comput. Graph.
Forum 12(3) (1993).
"""

import os
from collections.abc import Iterator
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ...geometry.mesh import Pose
from ...memo.found import found
from ...parallel.threads import in_threads
from ...raster.views import (
    OrthographicView,
    cap_directions,
    half_sphere_directions,
)
from .line_hits import LineScene, Segments, displaced_views, outline, segments_along
from .patches import PatchedBody


# Views that are drawn at once, at most; and triangles and pixels, of all these views
# together.
_MAX_VIEWS = 64
_MAX_TRIANGLES = 2**16
_MAX_PIXELS = 2**18

# Drawings that wait for each processor.
_WAITING_DRAWINGS = 4

# Lines that are counted at once: a sum costs as much as all pairs so far.
_MAX_WAITING = 2**23


class LineSums(NamedTuple):
    """Sums over lines that all lead upward [m^2]."""

    pairs: csr_array
    """Lines from each patch up to each other one."""
    sky: Float[np.ndarray, " p"]
    """Lines from each patch up to the surroundings."""
    ground: Float[np.ndarray, " p"]
    """Lines from the surroundings up to each patch."""

    @property
    def visible(self) -> Float[np.ndarray, "2 p"]:
        """Fraction of the sky and of the ground that each patch sees [-]."""
        free = np.stack([self.sky, self.ground])
        total = free + np.stack([self.pairs.sum(1), self.pairs.sum(0)])
        return np.where(total > 0, free / np.where(total > 0, total, 1.0), 1.0)


def _half(directions: int) -> int:
    # A line counts both ways, so that half of the directions are enough, rounded up.
    return (directions + 1) // 2


class Bundle(NamedTuple):
    """Parallel lines at one distance from each other."""

    number: int
    bodies: tuple[int, ...]
    """Numbers of its bodies in the scene."""
    hull: Float[np.ndarray, "n 3"]
    """Corners of the hull of these, world [m]."""
    points: Float[np.ndarray, "m 3"]
    """Points that all of its lines surround, world [m]: its hull, or part of it."""
    pixel: float
    """Distance between lines [m]."""
    area: float
    """Surface of its bodies [m^2]."""
    widest: float
    """Largest distance between lines of views in many directions [m]."""

    def spacing(self, directions: int) -> float:
        """Distance between the lines of each view, of a number of directions [m]."""
        # A patch needs a number of lines, whatever their directions: where there are
        # more of these, each has fewer lines.
        thinned = self.pixel * np.sqrt(max(directions / _DENSE_DIRECTIONS, 1.0))
        return max(self.pixel, min(thinned, self.widest))

    def weight(self, directions: int) -> float:
        """Area A_i F_ij of each line, of a number of directions [m^2]."""
        return 2 / _half(directions) * self.spacing(directions) ** 2

    def views(self, directions: int) -> Iterator[OrthographicView]:
        """Views along all directions."""
        ahead = half_sphere_directions(_half(directions))
        return displaced_views(self.points, ahead, self.spacing(directions))

    def hits(self, directions: int) -> float:
        """Surfaces that the lines of all directions meet, about."""
        # Seen from all directions, the mean area of a surface is half its own; a line
        # counts in both of its directions.
        return directions / 2 * self.area / 2 / self.spacing(directions) ** 2


class Bundles(NamedTuple):
    """Bundles of lines for the bodies of a scene, the widest first."""

    bundles: list[Bundle]
    of_patch: Int[np.ndarray, " p"]
    """Bundle that counts what each patch exchanges with patches of no later bundle."""


def bundles_of(scene: LineScene, lines: int | None) -> Bundles:
    """Bundles of lines of a scene; `lines` as in `sample_all_directions`."""
    return found(
        (scene.vertices,),
        ("bundles of lines", lines),
        lambda: _bundles(scene.bodies, lines),
    )


def _bundles(bodies: tuple[PatchedBody, ...], lines: int | None) -> Bundles:
    """One bundle for all bodies of similar patches, and one for each finer body."""
    pixel = np.array([body.line_spacing(lines) for body in bodies])
    is_fine = pixel < _FINE * pixel.max()
    finer = np.flatnonzero(is_fine)
    finer = finer[np.argsort(-pixel[finer], kind="stable")]
    shared = np.flatnonzero(~is_fine)
    bundle = np.zeros(len(bodies), int)
    bundle[finer] = 1 + np.arange(len(finer))
    bundles = []
    for group in (shared, *finer[:, None]):
        together = [bodies[number] for number in group]
        points = np.concatenate([body.vertices for body in together])
        narrowest = float(pixel[group].min())
        area = sum(float(body.patches.area.sum()) for body in together)
        hull = outline(points)
        lines_of_group = Bundle(
            number=len(bundles),
            bodies=tuple(map(int, group)),
            hull=hull,
            points=hull,
            pixel=_dense(narrowest, area, lines),
            area=area,
            widest=narrowest if lines else _dense(np.inf, area, None),
        )
        bundles.append(lines_of_group)
    counts = [body.patches.count for body in bodies]
    return Bundles(bundles=bundles, of_patch=np.repeat(bundle, counts))


# Distance of a body's own lines from each other, over that of the widest, below which
# it has a bundle of its own.
_FINE = 0.25

# Directions up to which every view has all lines that its patches need.
_DENSE_DIRECTIONS = 128

# Least number of lines that meet convex bodies in one view.
_MIN_LINES = 4096


def _dense(pixel: float, area: float, lines: int | None) -> float:
    """Distance between lines at which enough of them meet a surface [m]."""
    # Seen from all directions, the mean area of a convex body is a quarter of its own.
    return min(pixel, np.sqrt(area / 4 / _MIN_LINES)) if lines is None else pixel


def _counted(
    count: int, start: Int[np.ndarray, " g"], end: Int[np.ndarray, " g"]
) -> csr_array:
    """Number of lines from each patch to each other one."""
    pair, number = np.unique(start * count + end, return_counts=True)
    row, column = np.divmod(pair, count)
    return csr_array((number.astype(float), (row, column)), shape=(count, count))


def _segments(
    scene: LineScene,
    views: Iterator[OrthographicView],
    at_once: int,
    left_out: Bool[np.ndarray, " f"] | None = None,
) -> Iterator[tuple[Segments, ...]]:
    """Lines of views, a number of them drawn at once, in their order."""
    trace = partial(segments_along, scene, left_out=left_out)
    # Only lines of a few drawings at a time are kept.
    waiting = _WAITING_DRAWINGS * (os.cpu_count() or 1)
    while batches := [
        batch for _ in range(waiting) if (batch := tuple(islice(views, at_once)))
    ]:
        yield from in_threads(trace, batches)


def sample_all_directions(
    scene: LineScene, directions: int, lines: int | None
) -> LineSums:
    """Areas A_i F_ij of patches that see each other, and the surroundings [m^2].

    A view has `lines` lines across each body, or two across each patch if it is None.
    """
    return sample_bundles(scene, bundles_of(scene, lines), directions)


def sample_bundles(scene: LineScene, bundles: Bundles, directions: int) -> LineSums:
    """The same along the lines of some bundles."""
    sums = _WaitingSums(scene.count)
    for bundle in bundles.bundles:
        at_once = views_at_once(scene, bundles, bundle, directions)
        views = bundle.views(directions)
        for segments in _segments(scene, views, at_once):
            sums.add(_of_bundle(segments[0], bundles, bundle), bundle, directions)
    return sums.total()


def sample_changes(
    scene: LineScene,
    bundles: Bundles,
    directions: int,
    moving: tuple[int, ...],
) -> tuple[LineSums, LineSums]:
    """The same with and without some bodies, on the lines around these alone."""
    moving_hull = outline(np.concatenate([scene.bodies[n].vertices for n in moving]))
    left_out = np.isin(scene.body, moving)
    with_moving = _WaitingSums(scene.count)
    without = _WaitingSums(scene.count)
    for bundle in bundles.bundles:
        # Lines beside its own bodies count nothing.
        windows = (
            view.around(moving_hull, bundle.hull) for view in bundle.views(directions)
        )
        views = (view for view in windows if view is not None)
        for pair in _segments(scene, views, at_once=1, left_out=left_out):
            for sums, segments in zip((with_moving, without), pair, strict=True):
                sums.add(_of_bundle(segments, bundles, bundle), bundle, directions)
    return with_moving.total(), without.total()


def views_at_once(
    scene: LineScene, bundles: Bundles, bundle: Bundle, directions: int
) -> int:
    """Number of views of a bundle that are drawn at once.

    They are several in a small scene: each call has a cost of its own.
    """
    # A view of a part of the scene is one of its own, which ends at its borders.
    if len(bundles.bundles) > 1:
        return 1
    extent = float(np.linalg.norm(np.ptp(bundle.points, axis=0)))
    pixels = (extent / bundle.spacing(directions) + 2) ** 2
    most = int(min(_MAX_TRIANGLES // len(scene.faces), _MAX_PIXELS // pixels))
    return max(1, min(_MAX_VIEWS, most))


def _of_bundle(segments: Segments, bundles: Bundles, bundle: Bundle) -> Segments:
    """Lines that a bundle counts: those from and to its own patches."""
    # A single bundle counts all lines.
    if len(bundles.bundles) == 1:
        return segments
    # Two patches exchange along the lines of the finer bundle of both.
    of_patch = bundles.of_patch
    later = np.maximum(of_patch[segments.start], of_patch[segments.end])
    counts = later == bundle.number
    return Segments(
        start=segments.start[counts],
        end=segments.end[counts],
        sky=segments.sky[of_patch[segments.sky] == bundle.number],
        ground=segments.ground[of_patch[segments.ground] == bundle.number],
    )


class _WaitingSums:
    """Sums over lines, many of which are counted at once."""

    def __init__(self, count: int):
        self._total = LineSums(
            pairs=csr_array((count, count)), sky=np.zeros(count), ground=np.zeros(count)
        )
        self._waiting: list[Segments] = []
        self._lines = 0
        self._weight = 0.0

    def add(self, segments: Segments, bundle: Bundle, directions: int) -> None:
        """Add the lines of one view of a bundle."""
        weight = bundle.weight(directions)
        if weight != self._weight or self._lines > _MAX_WAITING:
            self._count()
            self._weight = weight
        self._waiting.append(segments)
        self._lines += len(segments.start)

    def total(self) -> LineSums:
        """The sums of all lines so far."""
        self._count()
        return self._total

    def _count(self) -> None:
        self._total = _added(self._total, self._waiting, self._weight)
        self._waiting = []
        self._lines = 0


def _added(totals: LineSums, batches: list[Segments], weight: float) -> LineSums:
    if not batches:
        return totals
    count = len(totals.sky)
    start, end, sky, ground = (
        np.concatenate(ends) for ends in zip(*batches, strict=True)
    )
    return LineSums(
        pairs=totals.pairs + weight * _counted(count, start, end),
        sky=totals.sky + weight * np.bincount(sky, minlength=count),
        ground=totals.ground + weight * np.bincount(ground, minlength=count),
    )


def _cone(
    first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"], pose: Pose
) -> tuple[np.ndarray, float]:
    """Axis and smallest cosine of the cone of directions between two boxes."""
    # The boxes are aligned with the axes of `pose`.
    source = pose.rotate_back(first)
    target = pose.rotate_back(second)
    low = target.min(0) - source.max(0)
    high = target.max(0) - source.min(0)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T == 1, high, low)
    axis = (low + high) / 2
    length = np.linalg.norm(corners, axis=1) * np.linalg.norm(axis)
    cosines = corners @ axis / np.where(length > 0, length, 1.0)
    return pose.rotate(axis), float(cosines.min())


class PairCone(NamedTuple):
    """Cone of all directions from one body to another."""

    pair: tuple[int, int]
    axis: Float[np.ndarray, "3"]
    min_cosine: float
    small: Float[np.ndarray, "n 3"]
    """Corners of the hull of the smaller body, world [m]."""

    @property
    def extent(self) -> float:
        """Largest extent of the smaller body [m]."""
        return float(np.ptp(self.small, axis=0).max())


def pair_cone(
    bodies: tuple[PatchedBody, ...], pair: tuple[int, int]
) -> PairCone | None:
    """Cone of two bodies that are apart; None for others.

    Those are bodies with separate boxes around them, along the world's axes or those of
    either body.
    """
    first, second = (bodies[number].vertices for number in pair)
    poses = [Pose(), *(bodies[number].pose for number in pair)]
    cones = [_cone(first, second, pose) for pose in poses]
    axis, min_cosine = max(cones, key=lambda cone: cone[1])
    if min_cosine <= 0:
        return None
    small = min(first, second, key=lambda points: np.ptp(points, axis=0).max())
    return PairCone(pair=pair, axis=axis, min_cosine=min_cosine, small=outline(small))


def sample_pair(
    scene: LineScene,
    cone: PairCone,
    directions: int,
    lines: int | None,
) -> csr_array:
    """Areas A_i F_ij of two bodies, from the cone of directions between them [m^2].

    All lines go from one body to the other, however far apart they are; `lines` of them
    across the smaller one, or two across its patches if it is None.
    """
    bodies = scene.bodies
    both = [bodies[number] for number in cone.pair]
    pixel = min(
        _dense(body.line_spacing(lines), float(body.patches.area.sum()), lines)
        for body in both
    )
    weight = 2 * (1 - cone.min_cosine) / directions * pixel * pixel
    ahead = cap_directions(cone.axis, cone.min_cosine, directions)
    number = np.repeat(np.arange(len(bodies)), [b.patches.count for b in bodies])
    starts = []
    ends = []
    views = displaced_views(cone.small, ahead, pixel)
    for ((start, end, _, _),) in _segments(scene, views, at_once=1):
        between = (number[start] == cone.pair[0]) & (number[end] == cone.pair[1])
        starts.append(start[between])
        ends.append(end[between])
    start = np.concatenate(starts)
    end = np.concatenate(ends)
    only = weight * _counted(scene.count, start, end)
    return only + only.T
