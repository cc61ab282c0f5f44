"""Rigid placement of a body."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..errors import InputError


class Pose(eqx.Module):
    """Rigid placement of a body in the world: x -> rotation x + translation."""

    translation: tuple[float, float, float] = eqx.field(
        static=True, default=(0.0, 0.0, 0.0)
    )
    """Position of the body's origin in the world [m]."""
    rotation: tuple[tuple[float, float, float], ...] = eqx.field(
        static=True, default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    """Rows of a rotation matrix [-]."""

    def __check_init__(self):
        matrix = np.asarray(self.rotation, float)
        if matrix.shape != (3, 3) or not (
            np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
            and np.linalg.det(matrix) > 0
        ):
            raise InputError(
                f"Pose(rotation={self.rotation!r}): give a 3 x 3 rotation matrix"
            )

    def to_world(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform points from the body to the world [m]."""
        return self.rotate(points) + np.asarray(self.translation, float)

    def rotate(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Rotate directions from the body to the world."""
        return vectors @ np.asarray(self.rotation, float).T

    def to_body(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform points from the world to the body [m]."""
        return self.rotate_back(points - np.asarray(self.translation, float))

    def rotate_back(
        self, vectors: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Rotate directions from the world to the body."""
        return vectors @ np.asarray(self.rotation, float)

    def at(self, time: float) -> "Pose":
        """Pose at a time [s], here always the same."""
        del time
        return self

    def snapshot_times(self, end: float) -> tuple[float, ...]:
        """Times at which the geometry changes: none."""
        del end
        return ()
