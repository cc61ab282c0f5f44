"""A body as a combination of cylinders (thesis ch. 3): what its convection goes by."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..raster.directions import unit_vector


@dataclass(frozen=True)
class Cylinder:
    """A circular cylinder in the body's own frame.

    Raises:
        InputError: if the axis has no direction, or a size is not positive.
    """

    axis_point: Any
    """The middle of its axis [m]: three numbers."""
    axis: Any
    """Three numbers of any length."""
    diameter: Any
    """[m]"""
    length: Any = None
    """[m]; without one it has no ends."""
    body: int = 0
    """Number of the body in the scene."""

    def __post_init__(self):
        _finite_point(self.axis_point)
        unit_vector(self.axis, "Cylinder(axis=)")
        for name in ("axis_point", "axis"):
            # Tuples can be compared and hashed, arrays cannot.
            plain = tuple(float(x) for x in getattr(self, name))
            object.__setattr__(self, name, plain)
        for name in ("diameter", "length"):
            size = getattr(self, name)
            if name == "length" and size is None:
                continue
            if not isinstance(size, int | float) or not 0 < size < np.inf:
                raise InputError(f"Cylinder({name}={size!r}): give a length in metres")

    @property
    def direction(self) -> Float[np.ndarray, "3"]:
        """The axis, of length one."""
        return unit_vector(self.axis)

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """From its surface, negative inside [m]."""
        offset = points - np.asarray(self.axis_point, float)
        along = offset @ self.direction
        across = np.linalg.norm(offset - along[:, None] * self.direction, axis=1)
        radial = across - self.diameter / 2
        beyond = np.abs(along) - (np.inf if self.length is None else self.length / 2)
        outside = np.hypot(np.maximum(radial, 0), np.maximum(beyond, 0))
        return outside + np.minimum(np.maximum(radial, beyond), 0)


def _finite_point(point: Any) -> None:
    try:
        good = np.isfinite(np.asarray(point, float)).all() and len(point) == 3
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(f"Cylinder(axis_point={point!r}): give three finite numbers")


class CylinderParts(NamedTuple):
    """Cylinders, and to which of them each surface fragment belongs."""

    cylinders: tuple[Cylinder, ...]
    fragment: Int[np.ndarray, " s"]

    def rows(self) -> list[dict[str, Any]]:
        """The table of the parts, in plain types."""
        counts = np.bincount(self.fragment, minlength=len(self.cylinders))
        return [
            {
                "part": number,
                "axis_point_m": [float(x) for x in cylinder.axis_point],
                "axis": [float(x) for x in cylinder.direction],
                "diameter_m": float(cylinder.diameter),
                "length_m": None if cylinder.length is None else float(cylinder.length),
                "fragments": int(counts[number]),
            }
            for number, cylinder in enumerate(self.cylinders)
        ]


def nearest_parts(
    cylinders: Sequence[Cylinder], points: Float[np.ndarray, "s 3"]
) -> CylinderParts:
    """Each point to the cylinder whose surface it is nearest to, or deepest in.

    Raises:
        InputError: if no point is within a diameter of any of them.
    """
    distance = np.stack([cylinder.distance(points) for cylinder in cylinders])
    diameter = np.array([cylinder.diameter for cylinder in cylinders])
    apart = distance.min(1)
    if (apart > diameter).all():
        raise InputError(
            f"cylinders: none is near the surface of body {cylinders[0].body}; the "
            f"nearest is {apart.min():.3g} m away: give axis_point in metres, in the "
            "body's own frame"
        )
    return CylinderParts(tuple(cylinders), distance.argmin(0))


def given_cylinders(given: Any) -> tuple[Cylinder, ...]:
    """What a user gives as `cylinders`; empty for None.

    Raises:
        InputError: if it is no list of them.
    """
    try:
        found = list(given or ())
    except (TypeError, ValueError):
        found = [given]
    cylinders = tuple(each for each in found if isinstance(each, Cylinder))
    if len(cylinders) < len(found):
        raise InputError(f"cylinders={given!r}: give a list of Cylinder, or None")
    return cylinders
