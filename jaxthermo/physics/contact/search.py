"""Contact of two bodies: which fragments touch, over what area, at what gap."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...arrays import Scalar
from ...errors import InputError
from .bodies import PlacedGrid, deepest_allowed, require_shallow
from .pairs import ContactPairs, no_pairs, paired
from .rays import FARTHEST, SLACK, STEEPEST, Reach, nearest_fragments, touches


# Which bodies may touch at all: boxes first, then views along the three axes.
#
# Bodies that touch overlap in every view: in some pixel, and there in depth. So a pair
# is dropped as soon as one view tells the two apart (the pruning of CULLIDE,
# Govindaraju et al. 2003, which the thesis takes for its broad phase), and a body
# without a pair is out of the potentially colliding set.
#
# The views are coarse and are drawn from the fragments, the depth layers that the body
# was voxelized from, not from triangles anew: no part that can conduct has none,
# whereas a part thinner than a pixel may miss all of its rays.


PIXELS = 64
"""Along the longer edge of a view of two boxes' overlap, at most."""


class BroadPhase(NamedTuple):
    """The pairs of bodies that are left to look at closely, and how many were not."""

    pairs: Int[np.ndarray, "p 2"]
    """i < j"""
    possible: int
    """Pairs there are."""
    overlapping_boxes: int
    """Pairs that the boxes left."""

    @property
    def bodies(self) -> tuple[int, ...]:
        """The potentially colliding set: bodies with a pair left."""
        return tuple(np.unique(self.pairs).tolist())


def may_touch(
    bodies: tuple[PlacedGrid, ...], threshold: Scalar | None = None
) -> BroadPhase:
    """Pairs of bodies that neither their boxes nor a view along an axis tell apart.

    Args:
        bodies: all bodies of a scene.
        threshold: widest gap that is contact [m]; None for one voxel of the finer body.
    """
    # What counts as a gap can be a longer way from corner to corner.
    reach = np.array(
        [STEEPEST * float(b.pitch if threshold is None else threshold) for b in bodies]
    )
    bounds = np.stack([body.world_bounds for body in bodies])
    lower, upper = bounds[:, 0] - reach[:, None], bounds[:, 1] + reach[:, None]
    pairs = overlapping_pairs(lower, upper)
    kept = [
        not _told_apart(bodies[i], bodies[j], float(reach[[i, j]].max()))
        for i, j in pairs.tolist()
    ]
    return BroadPhase(
        pairs=pairs[np.array(kept, bool)],
        possible=len(bodies) * (len(bodies) - 1) // 2,
        overlapping_boxes=len(pairs),
    )


def _told_apart(a: PlacedGrid, b: PlacedGrid, reach: float) -> bool:
    """Whether the bodies keep their distance in one of the views along x, y and z."""
    # A surface point has a fragment this near.
    spacing = FARTHEST * max(a.pitch, b.pitch)
    margin = reach + 2 * spacing
    low = np.maximum(a.world_bounds[0], b.world_bounds[0]) - margin
    high = np.minimum(a.world_bounds[1], b.world_bounds[1]) + margin
    pixel = max(margin, float((high - low).max()) / PIXELS)
    return any(
        not _overlap_in_view(a, b, axis, low, high, pixel, margin) for axis in range(3)
    )


def _overlap_in_view(a, b, axis: int, low, high, pixel: float, margin: float) -> bool:
    near_a, far_a = _depths(a.world_fragments, axis, low, high, pixel)
    near_b, far_b = _depths(b.world_fragments, axis, low, high, pixel)
    # Points within the margin of each other lie in the same pixel or in neighbours.
    near_a, far_a = _widened(near_a, np.minimum), _widened(far_a, np.maximum)
    overlap = (near_a - margin <= far_b) & (near_b - margin <= far_a)
    return bool(overlap.any())


def _depths(
    points: Float[np.ndarray, "s 3"], axis: int, low, high, pixel: float
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """First and last depth of a body in every pixel [m]; +-inf where it is not."""
    across = [a for a in range(3) if a != axis]
    # Of all depths: a body around the other one may have no surface near it.
    seen = points[((points >= low) & (points <= high))[:, across].all(1)]
    place = np.floor((seen - low)[:, across] / pixel).astype(np.int64)
    shape = np.floor((high - low) / pixel).astype(np.int64)[across] + 1
    near, far = np.full(shape, np.inf), np.full(shape, -np.inf)
    np.minimum.at(near, tuple(place.T), seen[:, axis])
    np.maximum.at(far, tuple(place.T), seen[:, axis])
    return near, far


def _widened(depth, pick):
    """Of every pixel and its eight neighbours, the first or the last depth."""
    for axis in (0, 1):
        inner = np.moveaxis(depth, axis, 0)
        wide = inner.copy()
        wide[1:] = pick(wide[1:], inner[:-1])
        wide[:-1] = pick(wide[:-1], inner[1:])
        depth = np.moveaxis(wide, 0, axis)
    return depth


def overlapping_pairs(
    lower: Float[np.ndarray, "b 3"], upper: Float[np.ndarray, "b 3"]
) -> Int[np.ndarray, "p 2"]:
    """Pairs i < j of boxes that share a point, by sort and sweep.

    Sorted along the axis on which they are spread most, a box can only meet those that
    start before it ends.

    Args:
        lower: lowest corners [m].
        upper: highest corners [m].
    """
    axis = int(np.argmax(np.ptp(lower, axis=0))) if len(lower) else 0
    order = np.argsort(lower[:, axis], kind="stable")
    starts, ends = lower[order, axis], upper[order, axis]
    ahead = np.searchsorted(starts, ends, side="right") - np.arange(len(order)) - 1
    ahead = np.maximum(ahead, 0)
    first = np.repeat(np.arange(len(order)), ahead)
    step = np.arange(len(first)) - np.repeat(np.cumsum(ahead) - ahead, ahead)
    pairs = np.stack([order[first], order[first + 1 + step]], axis=1)
    i, j = pairs.T
    meet = ((lower[i] <= upper[j]) & (lower[j] <= upper[i])).all(1)
    found = np.sort(pairs[meet], axis=1)
    return found[np.lexsort(found.T[::-1])]


def find_contacts(
    a: PlacedGrid, b: PlacedGrid, threshold: Scalar | None = None
) -> ContactPairs:
    """Touching fragments of two bodies (thesis 5.3, after Faure et al. 2008).

    Rays go along the lattice of the body with the finer voxels, of A if they are alike.

    Args:
        a: body A.
        b: body B.
        threshold: widest gap that is contact [m]; None for one voxel of the finer body.

    Raises:
        InputError: if the threshold is not positive, or the bodies overlap deeply.
    """
    widest = contact_threshold(a, b, threshold)
    require_shallow(a, b, widest)
    if b.pitch < a.pitch:
        return _touching(b, a, widest).swapped()
    return _touching(a, b, widest)


def contacts_between(
    bodies: tuple[PlacedGrid, ...], threshold: Scalar | None = None
) -> dict[tuple[int, int], ContactPairs]:
    """Contacts of all pairs i < j of bodies that touch; the broad phase comes first.

    Args:
        bodies: all bodies of a scene.
        threshold: as for `find_contacts`.

    Raises:
        InputError: as `find_contacts`.
    """
    found = {}
    for i, j in may_touch(bodies, threshold).pairs.tolist():
        pairs = find_contacts(bodies[i], bodies[j], threshold)
        if pairs.count:
            found[i, j] = pairs
    return found


def contact_threshold(
    a: PlacedGrid, b: PlacedGrid, threshold: Scalar | None = None
) -> float:
    """The widest gap that is contact [m], one voxel of the finer body if not given.

    Raises:
        InputError: if it is not a positive length.
    """
    if threshold is None:
        return min(a.pitch, b.pitch)
    widest = float(threshold)
    if not (np.isfinite(widest) and widest > 0):
        raise InputError(f"contact threshold {widest!r}: give a positive length [m]")
    return widest


def _touching(a: PlacedGrid, b: PlacedGrid, threshold: float) -> ContactPairs:
    nothing = no_pairs(len(a.grid.fragment_area), len(b.grid.fragment_area))
    reach = Reach(threshold, deepest_allowed(a, b, threshold))
    near = _near(a, b, reach.way + SLACK * (a.pitch + b.pitch))
    if not len(near):
        return nothing
    found = touches(a, b, near, reach)
    in_b = b.pose.unplace(a.pose.place(found.point_b))
    fragment_a = nearest_fragments(a.grid, found.point_a, found.triangle_a)
    fragment_b = nearest_fragments(b.grid, in_b, found.triangle_b)
    both = (fragment_a >= 0) & (fragment_b >= 0)
    if not both.any():
        return nothing
    touch = fragment_a[both], fragment_b[both], found.area[both], found.gap[both]
    return paired(*touch, a.grid.fragment_area, b.grid.fragment_area)


def _near(a: PlacedGrid, b: PlacedGrid, distance: float) -> Int[np.ndarray, " c"]:
    """Fragments of A with one of B within a distance, or more.

    In blocks of that edge, which are next to each other where fragments are that close.
    """
    mine, theirs = a.world_fragments, b.world_fragments
    low = np.maximum(mine.min(0), theirs.min(0)) - distance
    high = np.minimum(mine.max(0), theirs.max(0)) + distance
    if (low > high).any():
        return np.zeros(0, np.int64)
    ours = np.flatnonzero(((mine >= low) & (mine <= high)).all(1))
    theirs = theirs[((theirs >= low) & (theirs <= high)).all(1)]
    block = lambda points: np.floor((points - low) / distance).astype(np.int64) + 1
    occupied = np.zeros(block(high) + 2, bool)
    occupied[tuple(block(theirs).T)] = True
    for axis in range(3):
        before = np.moveaxis(occupied.copy(), axis, 0)
        around = np.moveaxis(occupied, axis, 0)
        around[1:] |= before[:-1]
        around[:-1] |= before[1:]
    return ours[occupied[tuple(block(mine[ours]).T)]]
