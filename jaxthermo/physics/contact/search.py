"""Contact search between bodies: touching fragments, contact areas and gaps.

The broad phase finds pairs of bodies that may touch, by their boxes and by views along
the three axes. The narrow phase follows rays through both bodies (`rays`). Each pair of
fragments that touch has one area.
"""

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

from ...arrays import Scalar
from ...errors import InputError
from ...geometry.nearby import overlapping_boxes
from ...memo.stored import stored_search
from ..together import found_between
from .overlap import require_shallow
from .rays import MAX_SLANT, ContactRange, PlacedGrid, ray_hits
from .shares import fragment_shares


# Largest number of pixels along the longer edge of a view of two boxes' overlap.
_MAX_PIXELS = 64


_MAX_ITERATIONS = 50

# Fraction of a fragment's area that may be covered twice.
_COVERAGE_TOLERANCE = 1e-3

# Exposed fractions of a fragment below this are rounding error.
_ROUNDING = 1e-12

# Rounding of the gap between two bodies, over the largest one that counts.
_GAP_ROUNDING = 1e-9


SHEET_GAP = 0.1
"""Default for the largest gap of seams and of two sheets, over the pitch [-]."""


class ContactPairs(NamedTuple):
    """Fragments of a body A and a body B that touch, each pair once.

    A pair has one area, so that the contact area is the same for both bodies. A
    fragment at an edge may represent slivers without fragments: its pairs can have more
    area than the fragment, and its coverage is 1.
    """

    fragment_a: Int[np.ndarray, " p"]
    fragment_b: Int[np.ndarray, " p"]
    area: Float[np.ndarray, " p"]
    """Contact area [m^2]; 0 in the padding."""
    gap: Float[np.ndarray, " p"]
    """Distance of the surfaces [m], negative where they overlap."""
    coverage_a: Float[np.ndarray, " s"]
    """Fraction of each fragment of A that touches B [-]."""
    coverage_b: Float[np.ndarray, " r"]
    """Fraction of each fragment of B that touches A [-]."""

    @classmethod
    def none(cls, fragments_a: int, fragments_b: int) -> "ContactPairs":
        """Empty pairs, for bodies that do not touch."""
        no_fragments = np.zeros(0, np.int64)
        return cls(
            fragment_a=no_fragments,
            fragment_b=no_fragments,
            area=np.zeros(0),
            gap=np.zeros(0),
            coverage_a=np.zeros(fragments_a),
            coverage_b=np.zeros(fragments_b),
        )

    @classmethod
    def joined(cls, parts: "Sequence[ContactPairs]") -> "ContactPairs":
        """Pairs one after the other, numbered by fragments of the same two surfaces.

        With the coverages of the first of them.
        """
        return parts[0]._replace(
            fragment_a=np.concatenate([part.fragment_a for part in parts]),
            fragment_b=np.concatenate([part.fragment_b for part in parts]),
            area=np.concatenate([part.area for part in parts]),
            gap=np.concatenate([part.gap for part in parts]),
        )

    def shifted(self, first_a: int, first_b: int) -> "ContactPairs":
        """Same pairs with fragments counted from others before those of A and of B."""
        return self._replace(
            fragment_a=self.fragment_a + first_a, fragment_b=self.fragment_b + first_b
        )

    @property
    def rows(self) -> int:
        """Number of pairs, with the padding."""
        return len(self.area)

    @property
    def count(self) -> int:
        """Number of pairs without padding."""
        return int(np.count_nonzero(self.area))

    def swapped(self) -> "ContactPairs":
        """Same pairs with A and B exchanged."""
        return self._replace(
            fragment_a=self.fragment_b,
            fragment_b=self.fragment_a,
            coverage_a=self.coverage_b,
            coverage_b=self.coverage_a,
        )

    def padded(self, capacity: int, names: str = "two bodies") -> "ContactPairs":
        """Same pairs in arrays of `capacity` rows, padded with area 0.

        Raises:
            InputError: naming the bodies, if there are more pairs.
        """
        spare = capacity - len(self.area)
        if spare < 0:
            raise InputError(
                f"contact of {names}: {len(self.area)} pairs and room for {capacity}; "
                "give a larger capacity or a coarser pitch"
            )
        return self._replace(
            fragment_a=np.pad(self.fragment_a, (0, spare)),
            fragment_b=np.pad(self.fragment_b, (0, spare)),
            area=np.pad(self.area, (0, spare)),
            gap=np.pad(self.gap, (0, spare)),
        )


class Joint(NamedTuple):
    """Two bodies that touch, as a term binds them."""

    pairs: Any
    """Touching fragments, by their numbers in what is bound; None for none."""
    entry: int
    """Number in the energy ledger."""
    size: int
    """Length of its arrays, at least the number of pairs."""
    bodies: tuple[int, int]
    """Numbers of both bodies."""

    @property
    def name(self) -> str:
        """Both bodies, for errors."""
        return f"bodies {self.bodies[0]} and {self.bodies[1]}"


class _BroadPhase(NamedTuple):
    """Pairs of bodies that may touch, and the counts that led to them."""

    pairs: Int[np.ndarray, "p 2"]
    """Numbers i < j of both bodies."""
    possible: int
    """Number of all pairs."""
    overlapping_boxes: int
    """Number of pairs with overlapping boxes."""

    @property
    def bodies(self) -> tuple[int, ...]:
        """Bodies in any of the pairs: the potentially colliding set."""
        return tuple(np.unique(self.pairs).tolist())


def broad_phase(
    bodies: tuple[PlacedGrid, ...], threshold: Scalar | None = None
) -> _BroadPhase:
    """Pairs of bodies that neither their boxes nor a view along an axis separate.

    `threshold` is the largest gap that counts as contact [m]; None for `default_gap`,
    which is one voxel of the finer body or less.
    """
    # The distance along an axis can exceed the gap by this factor.
    margin = np.array(
        [MAX_SLANT * float(b.pitch if threshold is None else threshold) for b in bodies]
    )
    bounds = np.stack([body.world_bounds for body in bodies])
    pairs = overlapping_boxes(
        bounds[:, 0] - margin[:, None], bounds[:, 1] + margin[:, None]
    )
    may_touch = []
    for i, j in pairs.tolist():
        a = bodies[i]
        b = bodies[j]
        reach = float(margin[[i, j]].max())
        separated = found_between(
            (a.grid, b.grid),
            poses=(a.pose, b.pose),
            by=("separated", reach),
            find=partial(_are_separated, a, b, reach),
        )
        may_touch.append(not separated)
    return _BroadPhase(
        pairs=pairs[np.array(may_touch, bool)],
        possible=len(bodies) * (len(bodies) - 1) // 2,
        overlapping_boxes=len(pairs),
    )


def _are_separated(a: PlacedGrid, b: PlacedGrid, margin: float) -> bool:
    """True if the bodies keep their distance in one of the views along x, y and z."""
    # Bodies that touch overlap in every view, in some pixel and there in depth, so that
    # one view can separate them (the pruning of CULLIDE, Govindaraju et al. 2003). The
    # views are drawn from fragments, not from triangles: every part that conducts
    # has fragments, whereas a part thinner than a pixel may be missed by all rays. A
    # surface point has a fragment within `spacing`.
    spacing = max(a.fragment_reach, b.fragment_reach)
    margin = margin + 2 * spacing
    low = np.maximum(a.world_bounds[0], b.world_bounds[0]) - margin
    high = np.minimum(a.world_bounds[1], b.world_bounds[1]) + margin
    pixel = max(margin, float((high - low).max()) / _MAX_PIXELS)
    return any(
        not _overlap_in_view(
            a, b=b, axis=axis, low=low, high=high, pixel=pixel, margin=margin
        )
        for axis in range(3)
    )


def _overlap_in_view(a, b, axis: int, low, high, pixel: float, margin: float) -> bool:
    near_a, far_a = _depths(
        a.world_fragments, axis=axis, low=low, high=high, pixel=pixel
    )
    near_b, far_b = _depths(
        b.world_fragments, axis=axis, low=low, high=high, pixel=pixel
    )
    # Points within the margin of each other lie in the same pixel or in neighbours.
    near_a = scipy.ndimage.minimum_filter(near_a, size=3)
    far_a = scipy.ndimage.maximum_filter(far_a, size=3)
    overlap = (near_a - margin <= far_b) & (near_b - margin <= far_a)
    return bool(overlap.any())


def _depths(
    points: Float[np.ndarray, "s 3"], axis: int, low, high, pixel: float
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """First and last depth of a body in every pixel [m]; +-inf without points."""
    across = [a for a in range(3) if a != axis]
    # Points at all depths: a body around the other one may have no surface near it.
    seen = points[((points >= low) & (points <= high))[:, across].all(1)]
    index = np.floor((seen - low)[:, across] / pixel).astype(np.int64)
    shape = np.floor((high - low) / pixel).astype(np.int64)[across] + 1
    near = np.full(shape, np.inf)
    far = np.full(shape, -np.inf)
    np.minimum.at(near, tuple(index.T), seen[:, axis])
    np.maximum.at(far, tuple(index.T), seen[:, axis])
    return near, far


def default_gap(pitches: Sequence[float], are_sheets: bool) -> float:
    """Largest gap that counts as contact if none is given [m], of bodies' pitches [m].

    One voxel of the finer body, by which the surfaces of voxels are uncertain. Two
    sheets have the surfaces of their meshes: a tenth of a cell.
    """
    return (SHEET_GAP if are_sheets else 1.0) * min(pitches)


@stored_search("contacts", (ContactPairs,))
def find_contacts(
    a: PlacedGrid, b: PlacedGrid, threshold: Scalar | None = None
) -> ContactPairs:
    """Touching fragments of two bodies (thesis 5.3, after Faure et al. 2008).

    Rays follow the lattice of the body with the finer voxels, of A if they are equal,
    and go through the sheet for a sheet and a solid. A is the body that comes first in
    the scene. `threshold` is as for `broad_phase`.

    Raises:
        InputError: if the threshold is not positive, or the bodies overlap deeply.
    """
    if threshold is None:
        max_gap = default_gap((a.pitch, b.pitch), are_sheets=a.is_sheet and b.is_sheet)
    else:
        max_gap = float(threshold)
    if not (np.isfinite(max_gap) and max_gap > 0):
        raise InputError(f"contact threshold {max_gap!r}: give a positive length [m]")
    # Bodies that are just so far apart touch, whatever the rounding of their places.
    max_gap *= 1 + _GAP_ROUNDING
    require_shallow(a, b, max_gap)
    samples_b = b.is_sheet if a.is_sheet != b.is_sheet else b.pitch < a.pitch
    if samples_b:
        return _contact_pairs(b, a, max_gap, second_is_a=True).swapped()
    return _contact_pairs(a, b, max_gap, second_is_a=False)


def contacts_between(
    bodies: tuple[PlacedGrid, ...], threshold: Scalar | None = None
) -> dict[tuple[int, int], ContactPairs]:
    """Contacts of all pairs i < j of bodies that touch; the broad phase comes first.

    Those of two bodies that move together are searched for once.

    Raises:
        InputError: as `find_contacts`.
    """
    gap = None if threshold is None else float(threshold)
    contacts = {}
    for i, j in broad_phase(bodies, gap).pairs.tolist():
        a = bodies[i]
        b = bodies[j]
        pairs = found_between(
            (a.grid, b.grid),
            poses=(a.pose, b.pose),
            by=("contact", gap),
            find=partial(find_contacts, a, b, gap),
            search="contacts of bodies",
        )
        if pairs.count:
            contacts[i, j] = pairs
    return contacts


def _contact_pairs(
    a: PlacedGrid, b: PlacedGrid, threshold: float, second_is_a: bool
) -> ContactPairs:
    no_contact = ContactPairs.none(len(a.grid.fragment_area), len(b.grid.fragment_area))
    limits = ContactRange.between(a, b, threshold)
    near = _near_fragments(a, b, limits.max_distance + a.spacing + b.spacing)
    if not len(near):
        return no_contact
    hits = ray_hits(a, b=b, near=near, limits=limits, second_is_a=second_is_a)
    in_b = b.pose.to_body(a.pose.to_world(hits.point_b))
    shares_a = fragment_shares(
        a.grid, point=hits.point_a, triangle=hits.triangle_a, is_back=hits.is_back_a
    )
    shares_b = fragment_shares(
        b.grid, point=in_b, triangle=hits.triangle_b, is_back=hits.is_back_b
    )
    touches = [
        (index_a, index_b, hits.area * share_a * share_b)
        for (index_a, share_a), (index_b, share_b) in product(shares_a, shares_b)
    ]
    fragment_a, fragment_b, area = map(np.concatenate, zip(*touches, strict=True))
    gap = np.tile(hits.gap, len(touches))
    valid = np.flatnonzero((fragment_a >= 0) & (fragment_b >= 0) & (area > 0))
    if not len(valid):
        return no_contact
    return _merge_touches(
        fragment_a=fragment_a[valid],
        fragment_b=fragment_b[valid],
        area=area[valid],
        gap=gap[valid],
        fragment_area_a=a.grid.fragment_area,
        fragment_area_b=b.grid.fragment_area,
    )


def _near_fragments(
    a: PlacedGrid, b: PlacedGrid, distance: float
) -> Int[np.ndarray, " c"]:
    """Fragments of A within a distance of one of B, and a few that are farther away."""
    # Fragments are sorted into blocks of that edge; close ones are in adjacent blocks.
    points_a = a.world_fragments
    points_b = b.world_fragments
    low = np.maximum(points_a.min(0), points_b.min(0)) - distance
    high = np.minimum(points_a.max(0), points_b.max(0)) + distance
    if (low > high).any():
        return np.zeros(0, np.int64)
    candidates = np.flatnonzero(((points_a >= low) & (points_a <= high)).all(1))
    points_b = points_b[((points_b >= low) & (points_b <= high)).all(1)]

    def block(points):
        return np.floor((points - low) / distance).astype(np.int64) + 1

    occupied = np.zeros(block(high) + 2, bool)
    occupied[tuple(block(points_b).T)] = True
    around = scipy.ndimage.maximum_filter(occupied, size=3)
    return candidates[around[tuple(block(points_a[candidates]).T)]]


def _merge_touches(
    fragment_a: Int[np.ndarray, " k"],
    fragment_b: Int[np.ndarray, " k"],
    area: Float[np.ndarray, " k"],
    gap: Float[np.ndarray, " k"],
    fragment_area_a: Float[np.ndarray, " s"],
    fragment_area_b: Float[np.ndarray, " r"],
) -> ContactPairs:
    """Pairs of fragments, each once, from areas [m^2] and gaps [m] of ray hits.

    The area of A is conserved; fragment areas are in m^2.
    """
    columns = len(fragment_area_b)
    key, pair = np.unique(fragment_a * columns + fragment_b, return_inverse=True)
    total = np.bincount(pair, area)
    mean_gap = np.bincount(pair, area * gap) / total
    a, b = np.divmod(key, columns)
    limited = _limited_areas(a, b=b, area=total, fragment_area_b=fragment_area_b)
    return ContactPairs(
        fragment_a=a,
        fragment_b=b,
        area=limited,
        gap=mean_gap,
        coverage_a=_coverage(a, limited, fragment_area_a),
        coverage_b=_coverage(b, limited, fragment_area_b),
    )


def _coverage(fragment, area, fragment_area):
    covered = np.bincount(fragment, area, minlength=len(fragment_area)) / fragment_area
    # Otherwise an exposed surface that is only rounding error remains at some pitches.
    return np.where(covered > 1 - _ROUNDING, 1.0, covered)


def _limited_areas(a, b, area, fragment_area_b):
    """Areas that cover no fragment of B more than once, as far as possible."""
    # Rays of another lattice fall unevenly on B's fragments. One that is hit too often
    # is limited to its area, and the fragments of A that lose by it take more of their
    # other partners, repeatedly (Sinkhorn's iteration with an inequality). The area of
    # A is conserved: where its slivers, or an area ratio, exceed the area available in
    # B, a small part is covered twice.
    touched, b = np.unique(b, return_inverse=True)
    a = np.unique(a, return_inverse=True)[1]
    available = fragment_area_b[touched]
    total = np.bincount(a, area)
    for _ in range(_MAX_ITERATIONS):
        fits = np.minimum(available / np.bincount(b, area), 1.0)
        if fits.min() > 1 - _COVERAGE_TOLERANCE:
            break
        area = area * fits[b]
        area = area * (total / np.bincount(a, area))[a]
    return area
