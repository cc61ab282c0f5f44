"""Touching pairs of fragments of two bodies, with one contact area for each pair."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError


_MAX_ITERATIONS = 50

# Fraction of a fragment's area that may be covered twice.
_COVERAGE_TOLERANCE = 1e-3

# Exposed fractions of a fragment below this are rounding error.
_ROUNDING = 1e-12


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

    @property
    def count(self) -> int:
        """Number of pairs without padding."""
        return int(np.count_nonzero(self.area))

    def swapped(self) -> "ContactPairs":
        """Same pairs with A and B exchanged."""
        a, b, area, gap, coverage_a, coverage_b = self
        return ContactPairs(b, a, area, gap, coverage_b, coverage_a)

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
        a, b, area, gap = (np.pad(rows, (0, spare)) for rows in self[:4])
        return ContactPairs(a, b, area, gap, self.coverage_a, self.coverage_b)


def no_pairs(fragments_a: int, fragments_b: int) -> ContactPairs:
    """Empty pairs, for bodies that do not touch."""
    none, nothing = np.zeros(0, np.int64), np.zeros(0)
    return ContactPairs(
        none, none, nothing, nothing, np.zeros(fragments_a), np.zeros(fragments_b)
    )


def contact_flux(
    fragment: Int[np.ndarray, " p"],
    heat_rate: Float[np.ndarray, " p"],
    fragment_area: Float[np.ndarray, " s"],
) -> Float[np.ndarray, " s"]:
    """Heat flux through every fragment of one side, q'' = sum_pairs q / A [W/m^2].

    The heat rate of each pair is positive into that side [W].
    """
    total = np.bincount(fragment, heat_rate, minlength=len(fragment_area))
    return total / fragment_area


def merge_touches(
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
    limited = _limited_areas(a, b, total, fragment_area_b)
    return ContactPairs(
        a,
        b,
        limited,
        mean_gap,
        _coverage(a, limited, fragment_area_a),
        _coverage(b, limited, fragment_area_b),
    )


def _coverage(fragment, area, fragment_area):
    covered = np.bincount(fragment, area, minlength=len(fragment_area)) / fragment_area
    # Otherwise an exposed surface of nothing but rounding error remains at some
    # pitches.
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
    available, total = fragment_area_b[touched], np.bincount(a, area)
    for _ in range(_MAX_ITERATIONS):
        fits = np.minimum(available / np.bincount(b, area), 1.0)
        if fits.min() > 1 - _COVERAGE_TOLERANCE:
            break
        area = area * fits[b]
        area = area * (total / np.bincount(a, area))[a]
    return area
