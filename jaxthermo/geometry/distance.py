"""Signed distances, negative inside, and smooth ways to join them.

All take points `x, y, z` as arrays of one shape and give distances of that shape. They
are exact or slightly too small, which is all that a surface extraction needs.
"""

import numpy as np
from jaxtyping import Float


Field = Float[np.ndarray, "x y z"]
Point = tuple[float, float, float]
Points = tuple[Field, Field, Field]


def ellipsoid(points: Points, centre: Point, radii: Point) -> Field:
    """Distance to an ellipsoid with axes along x, y, z, to first order."""
    scaled = [(p - c) / r for p, c, r in zip(points, centre, radii, strict=True)]
    level = np.sqrt(sum(s**2 for s in scaled))
    slope = np.sqrt(sum((s / r) ** 2 for s, r in zip(scaled, radii, strict=True)))
    return level * (level - 1.0) / np.maximum(slope, 1e-9)


def capsule(points: Points, a: Point, b: Point, thick: tuple[float, float]) -> Field:
    """Distance to a rounded rod from `a` to `b`, its radius going from one to other."""
    along = np.subtract(b, a)
    offset = [p - c for p, c in zip(points, a, strict=True)]
    dot = sum(o * d for o, d in zip(offset, along, strict=True))
    t = np.clip(dot / float(along @ along), 0.0, 1.0)
    gap = sum((o - t * d) ** 2 for o, d in zip(offset, along, strict=True))
    return np.sqrt(gap) - (thick[0] + t * (thick[1] - thick[0]))


def disc(points: Points, low: float, high: float, radius: float, edge: float) -> Field:
    """Distance to an upright cylinder whose rims are rounded by `edge`."""
    x, y, z = points
    beyond = np.sqrt(x**2 + y**2) - (radius - edge)
    above = np.abs(z - 0.5 * (low + high)) - (0.5 * (high - low) - edge)
    outside = np.sqrt(np.maximum(beyond, 0.0) ** 2 + np.maximum(above, 0.0) ** 2)
    return outside + np.minimum(np.maximum(beyond, above), 0.0) - edge


def smooth_union(a: Field, b: Field, blend: float) -> Field:
    """Union with a fillet of about the width `blend`."""
    overlap = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - 0.25 * blend * overlap**2


def smooth_intersection(a: Field, b: Field, blend: float) -> Field:
    """Intersection with an edge rounded over about the width `blend`."""
    return -smooth_union(-a, -b, blend)
