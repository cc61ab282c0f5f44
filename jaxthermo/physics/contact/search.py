"""Contact of two bodies: which fragments touch, over what area, at what gap."""

import numpy as np
from jaxtyping import Int

from ...arrays import Scalar
from ...errors import InputError
from .bodies import PlacedGrid
from .broad import may_touch
from .lookup import nearest_fragments
from .overlap import deepest_allowed, require_shallow
from .pairs import ContactPairs, no_pairs, paired
from .rays import SLACK, Reach, touches


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
