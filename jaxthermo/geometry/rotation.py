"""Rotations about an axis, as matrices and quaternions, and those between two of them.

A matrix does not say how often a body has turned. With an axis and an angle a rotation
does, so that a full turn differs from none.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..arrays import linear_map
from .vectors import unit_vector


Rows = tuple[tuple[float, float, float], ...]
"""Rows of a rotation matrix [-]."""

HALF_TURN_TOLERANCE = 1e-6
"""Difference from half a turn below which both ways round are as short [rad]."""


class Turn(NamedTuple):
    """A right-handed rotation about an axis through the origin."""

    axis: tuple[float, float, float]
    """Unit vector."""
    angle: float
    """Angle, any number of full turns included [rad]."""

    @property
    def rotation(self) -> Rows:
        """Rotation matrix, R = 1 + sin(a) K + (1 - cos(a)) K^2, K v = axis x v.

        Source: Rodrigues, Journal de mathematiques pures et appliquees 5 (1840) 380.
        """
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        # Full turns are the identity to the last digit.
        angle = math.remainder(self.angle, 2 * math.pi)
        matrix = np.eye(3) + math.sin(angle) * cross
        return _rows(matrix + (1 - math.cos(angle)) * (cross @ cross))

    def about(self, axis: tuple[float, float, float]) -> float | None:
        """Angle about another unit axis [rad]; None where it is not the same line."""
        if self.angle == 0:
            return 0.0
        cosine = float(np.dot(self.axis, axis))
        across = float(np.linalg.norm(np.cross(self.axis, axis)))
        return math.copysign(1.0, cosine) * self.angle if across < 1e-9 else None


class Way(NamedTuple):
    """The rotation from one orientation to another, about an axis of the world."""

    turn: Turn
    is_ambiguous: bool
    """True if the opposite way round is as short, and nothing says which is meant."""

    def after(self, first: Rows, fraction: float) -> Rows:
        """Orientation at a fraction of the way from the first one."""
        part = Turn(self.turn.axis, fraction * self.turn.angle)
        return _rows(np.asarray(part.rotation) @ np.asarray(first))


def way_by_angle(first: Turn, second: Turn) -> Way | None:
    """The way between two rotations about one axis; None if they have no common one."""
    axis = first.axis if first.angle else second.axis
    start = first.about(axis)
    end = second.about(axis)
    if start is None or end is None:
        return None
    return Way(Turn(axis, end - start), is_ambiguous=False)


def shortest_way(first: Rows, second: Rows) -> Way:
    """The rotation from one orientation to another by half a turn or less."""
    relative = np.asarray(second) @ np.asarray(first).T
    quaternion = _quaternion(relative)
    # A quaternion and its reverse are the same rotation; this one is the short way.
    w, *vector = quaternion if quaternion[0] >= 0 else -quaternion
    sine = float(np.linalg.norm(vector))
    angle = 2 * math.atan2(sine, float(w))
    x, y, z = (float(value) for value in unit_vector(vector if sine else (0, 0, 1)))
    return Way(Turn((x, y, z), angle), math.pi - angle < HALF_TURN_TOLERANCE)


def _quaternion(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """A rotation as (w, x, y, z)."""
    # The outer product of the quaternion with itself is linear in the rotation matrix;
    # its row with the largest diagonal loses no digits (Shepperd 1978).
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    product = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    row = product[int(np.argmax(np.diag(product)))]
    return row / np.linalg.norm(row)


def _rows(matrix: Float[np.ndarray, "3 3"]) -> Rows:
    return tuple((x, y, z) for x, y, z in matrix.tolist())


# Steps in which places of bodies, over a length, and cosines of axes are compared.
_SAME_PLACE = 1e-6
_SAME_TURN = 1e-9


# Every snapshot of a motion compares all bodies, most of which are at rest.
@lru_cache(maxsize=2**14)
def relative_key(first: tuple, second: tuple, length: float) -> tuple[tuple, tuple]:
    """`Pose.relative_key` of two poses by their translations and rotations."""
    translation, rotation = first
    other_translation, other_rotation = second
    axes = np.asarray(rotation, float)
    offset = linear_map(np.subtract(other_translation, translation), axes)
    place = np.rint(offset / (_SAME_PLACE * length))
    turn = np.rint(axes.T @ np.asarray(other_rotation) / _SAME_TURN)
    return tuple(place.tolist()), tuple(turn.ravel().tolist())
