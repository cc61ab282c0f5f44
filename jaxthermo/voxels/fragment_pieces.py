"""Pieces of fragments that are curved, and the part of each that faces a direction."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..geometry.vectors import row_dot


class Facing(NamedTuple):
    """Part of each fragment that faces a source."""

    normal: Float[np.ndarray, "s 3"]
    """Mean normal of that part, a unit vector in the frame of the direction."""
    fraction: Float[np.ndarray, " s"] | float
    """Length of the mean vector: its projected area over that of the fragment, in the
    direction of the normal [-]."""


class FragmentPieces(NamedTuple):
    """Plane pieces that the fragments of a surface consist of."""

    fragment: Int[np.ndarray, " p"]
    """Fragment of each piece."""
    normal: Float[np.ndarray, "p 3"]
    """Outward unit normal of each piece."""
    share: Float[np.ndarray, " p"]
    """Area of the piece over that of its fragment [-]."""

    def facing(
        self, towards: Float[np.ndarray, "#s 3"], count: int
    ) -> Float[np.ndarray, "s 3"]:
        """Mean of the normals over each of so many fragments, 0 where they face away.

        Its product with the direction is the mean of max(0, n . d) over the fragment.
        """
        direction = towards
        if len(towards) > 1:
            direction = towards[self.fragment]
        cosine = row_dot(self.normal, np.broadcast_to(direction, self.normal.shape))
        weight = np.where(cosine > 0, self.share, 0.0)
        columns = [
            np.bincount(self.fragment, weight * along, count) for along in self.normal.T
        ]
        return np.stack(columns, axis=1)
