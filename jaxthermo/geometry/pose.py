"""Where a body stands: a rigid placement."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..errors import InputError


class Pose(eqx.Module):
    """A rigid placement: x -> rotation x + translation."""

    translation: tuple[float, float, float] = eqx.field(
        static=True, default=(0.0, 0.0, 0.0)
    )
    """[m]"""
    rotation: tuple[tuple[float, float, float], ...] = eqx.field(
        static=True, default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    """Rows of a rotation matrix."""

    def __check_init__(self):
        matrix = np.asarray(self.rotation, float)
        if matrix.shape != (3, 3) or not (
            np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
            and np.linalg.det(matrix) > 0
        ):
            raise InputError(
                f"Pose(rotation={self.rotation!r}): give a 3 x 3 rotation matrix"
            )

    def place(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the body in the world [m]."""
        return self.turn(points) + np.asarray(self.translation, float)

    def turn(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Directions of the body in the world."""
        return vectors @ np.asarray(self.rotation, float).T

    def unplace(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World points in the body's frame [m]."""
        return self.unturn(points - np.asarray(self.translation, float))

    def unturn(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World directions in the body's frame."""
        return vectors @ np.asarray(self.rotation, float)

    def at(self, time: float) -> "Pose":
        """Itself: it does not move."""
        del time
        return self

    def snapshot_times(self, end: float) -> tuple[float, ...]:
        """When it must be taken anew: never."""
        del end
        return ()
