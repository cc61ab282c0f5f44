"""Where a term or a material applies: a side, a box in space, marked fragments, all."""

import abc
from typing import Any

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


class AbstractSpace(AbstractSelection):
    """A part of space, which chooses what lies in it: surface and inside alike."""

    @abc.abstractmethod
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points (own frame) lie in it."""

    def chooses(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """Fragments that lie in it."""
        del normal
        return self.contains(position)


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


class Region(AbstractSpace):
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


class Everything(AbstractSpace):
    """A whole body."""

    body: int = eqx.field(static=True, default=0)

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """All points."""
        return np.ones(len(points), bool)


class FragmentMask(AbstractSelection):
    """The surface fragments that are marked, in the order of the body's grid."""

    body: int = eqx.field(static=True)
    count: int = eqx.field(static=True)
    """How many fragments the mask is for."""
    packed: bytes = eqx.field(static=True)
    """The mask, eight fragments a byte: unlike an array it can be compared."""

    def __init__(self, mask: Any, body: int = 0):
        """Takes one truth value a fragment.

        Args:
            mask: as from `grid.fragment_position[:, 2] > 0.1`.
            body: number of the body.

        Raises:
            InputError: for anything but one-dimensional truth values.
        """
        marks = np.asarray(mask)
        if marks.dtype != bool or marks.ndim != 1:
            raise InputError(
                f"FragmentMask(mask=): got {marks.dtype} values of shape "
                f"{marks.shape}: give one True or False for each fragment"
            )
        self.body, self.count = body, len(marks)
        self.packed = np.packbits(marks).tobytes()

    @property
    def mask(self) -> Bool[np.ndarray, " s"]:
        """Which fragments are marked."""
        bits = np.frombuffer(self.packed, np.uint8)
        return np.unpackbits(bits, count=self.count).astype(bool)

    def __repr__(self) -> str:
        marked = int(np.count_nonzero(self.mask))
        return f"FragmentMask({marked} of {self.count} fragments, body={self.body})"

    def chooses(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """The marked fragments.

        Raises:
            InputError: if the mask is of another number of fragments.
        """
        del normal
        if len(position) != self.count:
            raise InputError(
                f"FragmentMask(mask=): it has {self.count} values and body "
                f"{self.body} has {len(position)} fragments: make it from the grid of "
                "that body"
            )
        return self.mask
