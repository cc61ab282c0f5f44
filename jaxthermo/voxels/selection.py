"""Selections of a body's surface or space that a term or a material applies to."""

import abc
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from ..errors import InputError
from ..raster.views import unit_vector


class AbstractSelection(eqx.Module):
    """Part of the surface of one body, as an argument `on=`."""

    # A property, not an `AbstractVar`, which editors take for the first argument.
    @property
    @abc.abstractmethod
    def body(self) -> int:
        """Number of the body in the scene."""

    @abc.abstractmethod
    def select(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        """Flag the selected surface fragments (in the body's frame)."""


class AbstractSpace(AbstractSelection):
    """Part of space, which selects the surface and the interior in it."""

    @abc.abstractmethod
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points (in the body's frame) that lie in it."""

    @override
    def select(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        del normal
        return self.contains(position)


class Side(AbstractSelection):
    """Fragments of a body whose normal is within `half_angle` [rad] of `normal`."""

    normal: tuple[float, float, float] = eqx.field(static=True)
    body: int = eqx.field(static=True, default=0)
    half_angle: float = eqx.field(static=True, default=float(np.pi / 4))

    def __check_init__(self):
        unit_vector(self.normal, "Side(normal=)")
        if not 0 < self.half_angle <= np.pi:
            raise InputError(
                f"Side(half_angle={self.half_angle!r}): give radians in (0, pi]"
            )

    @override
    def select(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        del position
        # Tolerance for normals exactly at the half angle, as on a cube or an octagon.
        cosine = normal @ unit_vector(self.normal)
        return np.greater(cosine, np.cos(self.half_angle) - 1e-9)


class Region(AbstractSpace):
    """Part of a body inside a box with corners `lower` and `upper` [m]."""

    lower: tuple[float, float, float] = eqx.field(static=True)
    upper: tuple[float, float, float] = eqx.field(static=True)
    body: int = eqx.field(static=True, default=0)

    def __check_init__(self):
        if not np.all(np.asarray(self.lower) < np.asarray(self.upper)):
            raise InputError(
                f"Region(lower={self.lower!r}, upper={self.upper!r}): "
                "each lower coordinate must be below its upper one"
            )

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        inside = (points >= self.lower) & (points <= self.upper)
        return np.all(inside, axis=1)


class Everything(AbstractSpace):
    """Whole body."""

    body: int = eqx.field(static=True, default=0)

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return np.ones(len(points), bool)


class FragmentMask(AbstractSelection):
    """Surface fragments given by a mask, in the order of the body's grid."""

    body: int = eqx.field(static=True, default=0)
    count: int = eqx.field(static=True, default=0)
    """Number of fragments of the body."""
    packed: bytes = eqx.field(static=True, default=b"")
    """Mask with eight fragments a byte: static fields must be hashable."""

    def __init__(self, mask: Any, body: int = 0):
        """Select fragments by a mask.

        Args:
            mask: one truth value per fragment, e.g.
                `grid.fragment_position[:, 2] > 0.1`.
            body: number of the body.

        Raises:
            InputError: for anything but one-dimensional truth values.
        """
        values = np.asarray(mask)
        if values.dtype != bool or values.ndim != 1:
            raise InputError(
                f"FragmentMask(mask=): got {values.dtype} values of shape "
                f"{values.shape}: give one True or False for each fragment"
            )
        self.body, self.count = body, len(values)
        self.packed = np.packbits(values).tobytes()

    @property
    def mask(self) -> Bool[np.ndarray, " s"]:
        """Flags of the selected fragments."""
        bits = np.frombuffer(self.packed, np.uint8)
        return np.unpackbits(bits, count=self.count).astype(bool)

    def __repr__(self) -> str:
        selected = int(np.count_nonzero(self.mask))
        return f"FragmentMask({selected} of {self.count} fragments, body={self.body})"

    @override
    def select(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Bool[np.ndarray, " s"]:
        del normal
        if len(position) != self.count:
            raise InputError(
                f"FragmentMask(mask=): it has {self.count} values and body "
                f"{self.body} has {len(position)} fragments: make it from the grid of "
                "that body"
            )
        return self.mask
