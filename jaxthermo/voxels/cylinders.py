"""Cylinders that approximate a body for its convection (thesis ch. 3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..arrays import Number, Vector
from ..errors import InputError
from ..raster.directions import unit_vector


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder in the body's frame.

    Raises:
        InputError: if the axis has no direction, or a size is not positive.
    """

    axis_point: Vector
    """Middle of the axis: three numbers [m]."""
    axis: Vector
    """Direction of the axis: three numbers [-]."""
    diameter: Number
    """Diameter [m]."""
    length: Number | None = None
    """Length [m]; None for an infinite cylinder."""
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
        """Unit vector along the axis."""
        return unit_vector(self.axis)

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Signed distance of points from its surface, negative inside [m]."""
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
    """Cylinders, and the index of the one that each surface fragment belongs to."""

    cylinders: tuple[Cylinder, ...]
    fragment: Int[np.ndarray, " s"]

    def rows(self) -> list[dict[str, Any]]:
        """Table of the cylinders in plain types."""
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
    """Assign each point to the cylinder with the smallest signed distance.

    Raises:
        InputError: if no point is within a diameter of any of them.
    """
    distance = np.stack([cylinder.distance(points) for cylinder in cylinders])
    diameter = np.array([cylinder.diameter for cylinder in cylinders])
    gap = distance.min(1)
    if (gap > diameter).all():
        raise InputError(
            f"cylinders: none is near the surface of body {cylinders[0].body}; the "
            f"nearest is {gap.min():.3g} m away: give axis_point in metres, in the "
            "body's own frame"
        )
    return CylinderParts(tuple(cylinders), distance.argmin(0))


def given_cylinders(given: Any) -> tuple[Cylinder, ...]:
    """Validate a user's argument `cylinders`; empty for None.

    Raises:
        InputError: unless it is a list of `Cylinder` or None.
    """
    try:
        found = list(given or ())
    except (TypeError, ValueError):
        found = [given]
    cylinders = tuple(item for item in found if isinstance(item, Cylinder))
    if len(cylinders) < len(found):
        raise InputError(f"cylinders={given!r}: give a list of Cylinder, or None")
    return cylinders
