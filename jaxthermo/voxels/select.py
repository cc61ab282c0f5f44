"""Where a boundary condition or a material applies: a side, or a box in space."""

import abc

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..raster.directions import unit_vector


class AbstractSelection(eqx.Module):
    """What `on=` takes: some of the surface of one body."""

    body: eqx.AbstractVar[int]

    @abc.abstractmethod
    def chooses(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """Which of these surface fragments (own frame) are meant."""


class Side(AbstractSelection):
    """The fragments of a body that face `normal`, within `half_angle` [rad] of it."""

    normal: tuple[float, float, float] = eqx.field(static=True)
    body: int = eqx.field(static=True, default=0)
    half_angle: float = eqx.field(static=True, default=float(np.pi / 4))

    def __check_init__(self):
        unit_vector(self.normal, "Side(normal=)")
        if not 0 < self.half_angle <= np.pi:
            raise InputError(
                f"Side(half_angle={self.half_angle!r}): give radians in (0, pi]"
            )

    def chooses(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """Fragments whose outward normal is close enough to the side's."""
        del position
        cosine = normal @ unit_vector(self.normal)
        return np.greater(cosine, np.cos(self.half_angle) - 1e-9)


class Region(AbstractSelection):
    """Everything of a body inside a box, corners in metres."""

    lower: tuple[float, float, float] = eqx.field(static=True)
    upper: tuple[float, float, float] = eqx.field(static=True)
    body: int = eqx.field(static=True, default=0)

    def __check_init__(self):
        if not np.all(np.asarray(self.lower) < np.asarray(self.upper)):
            raise InputError(
                f"Region(lower={self.lower!r}, upper={self.upper!r}): "
                "each lower coordinate must be below its upper one"
            )

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points lie in the box."""
        inside = (points >= self.lower) & (points <= self.upper)
        return np.all(inside, axis=1)

    def chooses(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """Fragments that lie in the box."""
        del normal
        return self.contains(position)
