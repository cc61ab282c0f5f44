"""Touching pairs of fragments: what a search of two bodies gives the solver."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError


SETTLING_STEPS = 50
SETTLED = 1e-3
"""Share of a fragment's area that may be covered twice."""
ROUNDING = 1e-12
"""Share of a fragment's area that is none."""


class ContactPairs(NamedTuple):
    """Fragments of a body A and a body B that touch, each pair once.

    A pair has one area, so that the area of contact is the same for either body. A
    fragment at an edge may stand for slivers that have none of their own: its pairs can
    have more area than it has, and its coverage is 1.
    """

    fragment_a: Int[np.ndarray, " p"]
    fragment_b: Int[np.ndarray, " p"]
    area: Float[np.ndarray, " p"]
    """In contact [m^2]; 0 in the padding."""
    gap: Float[np.ndarray, " p"]
    """Between the surfaces [m], negative where they overlap."""
    coverage_a: Float[np.ndarray, " s"]
    """Share of each fragment of A that touches B, 0 to 1."""
    coverage_b: Float[np.ndarray, " r"]
    """Share of each fragment of B that touches A, 0 to 1."""

    @property
    def count(self) -> int:
        """How many pairs there are, without padding."""
        return int(np.count_nonzero(self.area))

    def swapped(self) -> "ContactPairs":
        """The same contact from the side of B."""
        a, b, area, gap, coverage_a, coverage_b = self
        return ContactPairs(b, a, area, gap, coverage_b, coverage_a)

    def padded(self, capacity: int, names: str = "two bodies") -> "ContactPairs":
        """The same pairs in arrays of a fixed size; the rest has area 0.

        Args:
            capacity: rows of the arrays.
            names: of the bodies, for the message.

        Raises:
            InputError: if there are more pairs.
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
    """Of bodies that do not touch."""
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

    Args:
        fragment: of each pair, on that side.
        heat_rate: into that side through each pair [W].
        fragment_area: of all fragments of that side [m^2].
    """
    total = np.bincount(fragment, heat_rate, minlength=len(fragment_area))
    return total / fragment_area


def paired(
    fragment_a: Int[np.ndarray, " k"],
    fragment_b: Int[np.ndarray, " k"],
    area: Float[np.ndarray, " k"],
    gap: Float[np.ndarray, " k"],
    fragment_area_a: Float[np.ndarray, " s"],
    fragment_area_b: Float[np.ndarray, " r"],
) -> ContactPairs:
    """Touches as pairs of fragments, each pair once, with the same area in all.

    Args:
        fragment_a: of each touch.
        fragment_b: of each touch.
        area: of each touch [m^2].
        gap: at each touch [m].
        fragment_area_a: of the fragments of A [m^2].
        fragment_area_b: of the fragments of B [m^2].
    """
    columns = len(fragment_area_b)
    key, pair = np.unique(fragment_a * columns + fragment_b, return_inverse=True)
    total = np.bincount(pair, area)
    mean_gap = np.bincount(pair, area * gap) / total
    a, b = np.divmod(key, columns)
    settled = _settled(a, b, total, fragment_area_b)
    return ContactPairs(
        a,
        b,
        settled,
        mean_gap,
        _coverage(a, settled, fragment_area_a),
        _coverage(b, settled, fragment_area_b),
    )


def _coverage(fragment, area, fragment_area):
    share = np.bincount(fragment, area, minlength=len(fragment_area)) / fragment_area
    # Or a place would be left that is nothing but rounding, at some pitches.
    return np.where(share > 1 - ROUNDING, 1.0, share)


def _settled(a, b, area, fragment_area_b):
    """Areas that cover no fragment of B more than once, as far as there is room.

    Rays of another lattice fall unevenly on B's fragments. One with too many keeps its
    own area, and those of A that lose by it take more of the others they touch, over
    and over (Sinkhorn's iteration with an inequality). The area of A never changes:
    where its slivers, or an area ratio, leave no room in B, a little is covered twice.
    """
    touched, b = np.unique(b, return_inverse=True)
    a = np.unique(a, return_inverse=True)[1]
    room, wanted = fragment_area_b[touched], np.bincount(a, area)
    for _ in range(SETTLING_STEPS):
        fits = np.minimum(room / np.bincount(b, area), 1.0)
        if fits.min() > 1 - SETTLED:
            break
        area = area * fits[b]
        area = area * (wanted / np.bincount(a, area))[a]
    return area
