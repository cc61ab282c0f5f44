"""Procedural bodies: watertight, wound outward, centred at the origin.

Round shapes are widened slightly so that their volume, and with it their heat capacity,
is exact; their vertices lie just outside the given radius.
"""

import numpy as np
from jaxtyping import Float, Int
from skimage.measure import marching_cubes

from ..errors import InputError, positive_length
from .mesh import Mesh


__all__ = ["box", "cylinder", "figurine", "slab", "sphere"]

_Size = float | int | tuple[float | int, float | int, float | int]

# Corner number 4 i + 2 j + k of the unit cube is at (i, j, k).
_BOX_QUADS = np.array([
    [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
])  # fmt: skip


def box(size: _Size) -> Mesh:
    """Box of 12 triangles with edges `size` along x, y, z [m]; one number: a cube."""
    edges = size if isinstance(size, tuple) else (size, size, size)
    lengths = np.array([positive_length("size", edge) for edge in edges])
    corners = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    faces = np.concatenate([_BOX_QUADS[:, [0, 1, 2]], _BOX_QUADS[:, [0, 2, 3]]])
    return Mesh(corners * lengths, faces, "box")


def slab(thickness: float | int, width: float | int, length: float | int) -> Mesh:
    """Box `thickness` thick along x, `width` along y, `length` along z [m]."""
    plate = box((thickness, width, length))
    return Mesh(plate.vertices, plate.faces, "slab")


def sphere(radius: float | int, subdivisions: int = 4) -> Mesh:
    """Sphere of `radius` [m]: an icosahedron with its faces repeatedly cut in four.

    Of 20 * 4^subdivisions faces. The volume is exact; the area is too large by 1e-3 of
    itself at 3 subdivisions, a quarter of that with each further one.
    """
    radius = positive_length("radius", radius)
    points, faces = _icosahedron()
    for _ in range(subdivisions):
        points, faces = _cut_in_four(points, faces)
    # Widened so that the volume is that of the sphere.
    unit = Mesh(points, faces, "sphere")
    widening = (4.0 / 3.0 * np.pi / unit.volume) ** (1.0 / 3.0)
    return Mesh(points * radius * widening, faces, "sphere")


def cylinder(radius: float | int, height: float | int, sections: int = 64) -> Mesh:
    """Cylinder along z of `radius` and `height` [m] with `sections` sides [-]."""
    radius = positive_length("radius", radius)
    height = positive_length("height", height)
    if sections < 3:
        raise InputError(f"sections={sections} make no cylinder: give 3 or more")
    angle = 2.0 * np.pi * np.arange(sections) / sections
    # Widened so that the polygon has the area of the circle.
    widening = np.sqrt(2.0 * np.pi / sections / np.sin(2.0 * np.pi / sections))
    rim = radius * widening * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([rim, np.full(sections, -0.5 * height)])
    high = np.column_stack([rim, np.full(sections, 0.5 * height)])
    centres = np.array([[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]])
    index = np.arange(sections)
    after = np.roll(index, -1)
    bottom, top = np.full(sections, 2 * sections), np.full(sections, 2 * sections + 1)
    faces = np.concatenate(
        [
            np.stack([index, after, after + sections], axis=1),
            np.stack([index, after + sections, index + sections], axis=1),
            np.stack([bottom, after, index], axis=1),
            np.stack([top, index + sections, after + sections], axis=1),
        ]
    )
    return Mesh(np.concatenate([low, high, centres]), faces, "cylinder")


def _icosahedron() -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Icosahedron of radius 1: two poles and two rings of five at z = +-1/sqrt(5)."""
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    z = 1.0 / np.sqrt(5.0)
    upper = np.column_stack([2 * z * np.cos(angle), 2 * z * np.sin(angle)])
    lower = np.column_stack(
        [2 * z * np.cos(angle + np.pi / 5), 2 * z * np.sin(angle + np.pi / 5)]
    )
    points = np.zeros((12, 3))
    points[0, 2], points[11, 2] = 1.0, -1.0
    points[1:6, :2], points[1:6, 2] = upper, z
    points[6:11, :2], points[6:11, 2] = lower, -z
    u, n = np.arange(1, 6), np.roll(np.arange(1, 6), -1)
    faces = [
        np.stack([np.zeros(5, int), u, n], axis=1),
        np.stack([u, u + 5, n], axis=1),
        np.stack([n, u + 5, n + 5], axis=1),
        np.stack([np.full(5, 11), n + 5, u + 5], axis=1),
    ]
    return points, np.concatenate(faces)


def _cut_in_four(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    ends, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middles = points[ends].mean(1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (number.reshape(-1, 3) + len(points)).T
    a, b, c = faces.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    cut = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return np.concatenate([points, middles]), cut


_Field = Float[np.ndarray, "x y z"]
_Point = tuple[float, float, float]
_Points = tuple[_Field, _Field, _Field]


# The figurine is the zero level of a signed distance field, negative inside. The
# distances of its primitives from points x, y, z are exact or slightly too small, which
# is sufficient for surface extraction.
def _ellipsoid(points: _Points, centre: _Point, radii: _Point) -> _Field:
    """Distance to an ellipsoid with axes along x, y, z, to first order."""
    scaled = [(p - c) / r for p, c, r in zip(points, centre, radii, strict=True)]
    level = np.sqrt(sum(s**2 for s in scaled))
    slope = np.sqrt(sum((s / r) ** 2 for s, r in zip(scaled, radii, strict=True)))
    return level * (level - 1.0) / np.maximum(slope, 1e-9)


def _capsule(
    points: _Points, a: _Point, b: _Point, thick: tuple[float, float]
) -> _Field:
    """Distance to a rounded rod from `a` to `b` with linearly varying radius."""
    along = np.subtract(b, a)
    offset = [p - c for p, c in zip(points, a, strict=True)]
    dot = sum(o * d for o, d in zip(offset, along, strict=True))
    t = np.clip(dot / float(along @ along), 0.0, 1.0)
    gap = sum((o - t * d) ** 2 for o, d in zip(offset, along, strict=True))
    return np.sqrt(gap) - (thick[0] + t * (thick[1] - thick[0]))


def _disc(
    points: _Points, low: float, high: float, radius: float, edge: float
) -> _Field:
    """Distance to an upright cylinder whose rims are rounded by `edge`."""
    x, y, z = points
    beyond = np.sqrt(x**2 + y**2) - (radius - edge)
    above = np.abs(z - 0.5 * (low + high)) - (0.5 * (high - low) - edge)
    outside = np.sqrt(np.maximum(beyond, 0.0) ** 2 + np.maximum(above, 0.0) ** 2)
    return outside + np.minimum(np.maximum(beyond, above), 0.0) - edge


def _smooth_union(a: _Field, b: _Field, blend: float) -> _Field:
    """Union with a fillet of about the width `blend`."""
    overlap = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - 0.25 * blend * overlap**2


def _smooth_intersection(a: _Field, b: _Field, blend: float) -> _Field:
    return -_smooth_union(-a, -b, blend)


# Lengths in units of the height. The figure faces -y; its right hand is at -x.
_LOWER: _Point = (-0.40, -0.30, -0.03)
_UPPER: _Point = (0.34, 0.25, 1.03)
_WALL = 0.034
_MIN_RESOLUTION = 48
# Robe: heights, half widths (x) and half depths (y), from hem to neck.
_ROBE_Z = (0.05, 0.08, 0.20, 0.36, 0.50, 0.60, 0.69, 0.745, 0.78)
_ROBE_X = (0.172, 0.168, 0.137, 0.107, 0.085, 0.098, 0.116, 0.092, 0.036)
_ROBE_Y = (0.150, 0.147, 0.117, 0.090, 0.070, 0.076, 0.080, 0.064, 0.036)


def figurine(height: float | int = 0.3, resolution: int = 118) -> Mesh:
    """Robed figure on a plinth that stands on z = 0 and faces -y.

    For thermal pictures: a thick plinth, a hollow robe (its cavity is a second closed
    surface), thin sleeves that shade the robe, a stretched arm with a ball.

    Args:
        height: Total height [m].
        resolution: Samples of the distance field along the height [-].
    """
    height = positive_length("height", height)
    if resolution < _MIN_RESOLUTION:
        raise InputError(
            f"resolution={resolution} loses the thin parts: give at least "
            f"{_MIN_RESOLUTION}"
        )
    step = 1.0 / resolution
    axes = [np.arange(a, b, step) for a, b in zip(_LOWER, _UPPER, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    vertices, faces, _, _ = marching_cubes(
        _body((x, y, z)), 0.0, spacing=(step, step, step), gradient_direction="descent"
    )
    points = vertices.astype(np.float64) + np.array(_LOWER)
    low, high = points[:, 2].min(), points[:, 2].max()
    points[:, 2] -= low
    return Mesh(points * height / (high - low), faces.astype(np.int64), "figurine")


def _body(points: _Points) -> _Field:
    robe = _robe(points)
    body = _smooth_union(robe, _head(points), 0.02)
    # To the side and forward, with a ball on the open hand.
    elbow, wrist = (-0.200, -0.020, 0.625), (-0.290, -0.125, 0.690)
    hand = _ellipsoid(points, (-0.302, -0.148, 0.705), (0.026, 0.032, 0.016))
    right = _arm(points, (-0.088, 0.0, 0.712), elbow, wrist, hand)
    ball = _ellipsoid(points, (-0.304, -0.152, 0.752), (0.036, 0.036, 0.036))
    right = _smooth_union(right, ball, 0.008)
    right_sleeve = _sleeve(points, elbow, wrist, (0.08, 0.24))
    # In front of the robe without contact: its shadow falls on the pleats.
    elbow, wrist = (0.176, -0.060, 0.590), (0.062, -0.195, 0.575)
    hand = _ellipsoid(points, (0.040, -0.213, 0.582), (0.030, 0.022, 0.020))
    left = _arm(points, (0.088, 0.0, 0.712), elbow, wrist, hand)
    left_sleeve = _sleeve(points, elbow, wrist, (0.09, 0.25))
    for arm, sleeve in ((right, right_sleeve), (left, left_sleeve)):
        body = _smooth_union(body, arm, 0.03)
        body = _smooth_union(body, sleeve, 0.012)
    plinth = _smooth_union(
        _disc(points, 0.0, 0.040, 0.215, 0.012),
        _disc(points, 0.02, 0.074, 0.196, 0.012),
        0.006,
    )
    body = _smooth_union(body, plinth, 0.008)
    for side in (-1.0, 1.0):
        foot = _ellipsoid(points, (0.052 * side, -0.148, 0.082), (0.032, 0.042, 0.026))
        body = _smooth_union(body, foot, 0.01)
    # Hollow of the casting: the robe without its wall, closed at both ends.
    ends = np.abs(points[2] - 0.385) - 0.275
    return np.maximum(body, -_smooth_intersection(robe + _WALL, ends, 0.04))


def _robe(points: _Points) -> _Field:
    x, y, z = points
    wide, deep = _profile(z, _ROBE_X), _profile(z, _ROBE_Y)
    angle = np.arctan2(y / deep, x / wide)
    # Pleats fade out upward; their phase varies, or they would seem turned on a lathe.
    pleat = np.clip((0.56 - z) / 0.5, 0.0, 1.0) ** 1.2
    fold = 0.012 * pleat * np.cos(15.0 * angle + 5.0 * z * np.cos(angle))
    level = np.sqrt((x / wide) ** 2 + (y / deep) ** 2)
    around = (level - 1.0) * np.minimum(wide, deep) * 0.9 - fold
    belt = 0.010 * np.exp(-(((z - 0.505) / 0.016) ** 2))
    collar = 0.012 * np.exp(-(((z - 0.768) / 0.014) ** 2))
    span = np.abs(z - 0.415) - 0.365
    return _smooth_intersection(around - belt - collar, span, 0.02)


def _profile(z: _Field, radii: tuple[float, ...]) -> _Field:
    """Radii at heights z by cubic Hermite interpolation of the table."""
    heights, values = np.array(_ROBE_Z), np.array(radii)
    slopes = np.gradient(values, heights)
    i = np.clip(np.searchsorted(heights, z) - 1, 0, len(heights) - 2)
    gap = heights[i + 1] - heights[i]
    t = np.clip((z - heights[i]) / gap, 0.0, 1.0)
    ends = values[i] * (1 + 2 * t) * (1 - t) ** 2 + values[i + 1] * t**2 * (3 - 2 * t)
    return ends + gap * t * (1 - t) * (slopes[i] * (1 - t) - slopes[i + 1] * t)


def _head(points: _Points) -> _Field:
    neck = _capsule(points, (0.0, 0.0, 0.74), (0.0, -0.006, 0.85), (0.034, 0.03))
    head = _ellipsoid(points, (0.0, -0.012, 0.872), (0.056, 0.064, 0.076))
    jaw = _ellipsoid(points, (0.0, -0.034, 0.836), (0.036, 0.036, 0.034))
    nose = _capsule(points, (0.0, -0.072, 0.888), (0.0, -0.083, 0.862), (0.006, 0.010))
    hair = _ellipsoid(points, (0.0, 0.004, 0.886), (0.074, 0.075, 0.080))
    # The face is cut out of the hair.
    face = _ellipsoid(points, (0.0, -0.088, 0.843), (0.058, 0.070, 0.084))
    hair = _smooth_intersection(hair, -face, 0.008)
    bun = _ellipsoid(points, (0.0, 0.022, 0.976), (0.032, 0.032, 0.026))
    skull = _smooth_union(_smooth_union(head, jaw, 0.03), nose, 0.012)
    crown = _smooth_union(hair, bun, 0.012)
    return _smooth_union(_smooth_union(skull, crown, 0.004), neck, 0.02)


def _arm(points: _Points, shoulder: _Point, elbow: _Point, wrist: _Point, hand: _Field):
    upper = _capsule(points, shoulder, elbow, (0.042, 0.034))
    lower = _capsule(points, elbow, wrist, (0.034, 0.024))
    return _smooth_union(_smooth_union(upper, lower, 0.02), hand, 0.015)


def _sleeve(
    points: _Points, elbow: _Point, wrist: _Point, drop: tuple[float, float]
) -> _Field:
    """Thin wavy sheet below the forearm, longer towards the wrist."""
    along = np.subtract(wrist, elbow)[:2]
    length = float(np.hypot(*along))
    across = (points[0] - elbow[0]) * along[0] + (points[1] - elbow[1]) * along[1]
    u = across / length**2
    aside = (points[0] - elbow[0]) * along[1] - (points[1] - elbow[1]) * along[0]
    below = elbow[2] + u * (wrist[2] - elbow[2]) - points[2]
    # Waves grow downward: cloth is gathered at the top.
    hang = np.clip(below / drop[1], 0.0, 1.0)
    wave = 0.012 * hang * np.sin(2.0 * np.pi * 1.3 * u + 0.6)
    sheet = np.abs(aside / length - wave) - 0.0125
    fall = drop[1] - drop[0]
    ramp = np.clip(u, 0.0, 1.0)
    hem = below - drop[0] - fall * ramp**2 * (3.0 - 2.0 * ramp)
    # Divided by its slope, or the extracted hem would have steps.
    slope = 6.0 * ramp * (1.0 - ramp) * fall / length
    hem = hem / np.sqrt(1.0 + slope**2)
    ends = (np.abs(u - 0.5) - 0.5) * length
    outline = _smooth_intersection(_smooth_intersection(hem, ends, 0.07), -below, 0.02)
    return _smooth_intersection(sheet, outline, 0.012)
