"""The built-in figurine: a robed figure on a plinth, from a signed distance field."""

import numpy as np
from jaxtyping import Float
from skimage.measure import marching_cubes

from ..errors import InputError, positive_length
from ..memo.stored import stored_search
from .mesh import Mesh


_Field = Float[np.ndarray, "x y z"]
_Point = tuple[float, float, float]
_Points = tuple[_Field, _Field, _Field]


# The figurine is the zero level of a signed distance field, negative inside. The
# distances of its primitives from points x, y, z are exact or slightly too small, which
# is sufficient for surface extraction.
def _ellipsoid(points: _Points, centre: _Point, radii: _Point) -> _Field:
    """Distance to an ellipsoid with axes along x, y, z, to first order."""
    scaled = []
    gradient = []
    for coordinate, middle, radius in zip(points, centre, radii, strict=True):
        component = (coordinate - middle) / radius
        scaled.append(component)
        gradient.append(component / radius)
    level = np.sqrt(sum(s**2 for s in scaled))
    slope = np.sqrt(sum(g**2 for g in gradient))
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
    first_radius, last_radius = thick
    radius = first_radius + t * (last_radius - first_radius)
    return np.sqrt(gap) - radius


def _disc(
    points: _Points, low: float, high: float, radius: float, edge: float
) -> _Field:
    """Distance to an upright cylinder whose rims are rounded by `edge`."""
    x, y, z = points
    middle = 0.5 * (low + high)
    half_height = 0.5 * (high - low)
    beyond = np.sqrt(x**2 + y**2) - (radius - edge)
    above = np.abs(z - middle) - (half_height - edge)
    outward = np.maximum(beyond, 0.0)
    upward = np.maximum(above, 0.0)
    outside = np.sqrt(outward**2 + upward**2)
    inside = np.minimum(np.maximum(beyond, above), 0.0)
    return outside + inside - edge


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
    return _sculpted(float(height), int(resolution))


@stored_search("figurine", (Mesh,))
def _sculpted(height: float, resolution: int) -> Mesh:
    step = 1.0 / resolution
    axes = [np.arange(a, b, step) for a, b in zip(_LOWER, _UPPER, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    vertices, faces, _, _ = marching_cubes(
        _body((x, y, z)),
        level=0.0,
        spacing=(step, step, step),
        gradient_direction="descent",
    )
    points = vertices.astype(np.float64) + np.array(_LOWER)
    low = points[:, 2].min()
    high = points[:, 2].max()
    points[:, 2] -= low
    return Mesh(
        vertices=points * height / (high - low),
        faces=faces.astype(np.int64),
        name="figurine",
    )


def _body(points: _Points) -> _Field:
    robe = _robe(points)
    body = _smooth_union(robe, _head(points), 0.02)
    # To the side and forward, with a ball on the open hand.
    elbow = (-0.200, -0.020, 0.625)
    wrist = (-0.290, -0.125, 0.690)
    hand = _ellipsoid(points, (-0.302, -0.148, 0.705), (0.026, 0.032, 0.016))
    right = _arm(
        points, shoulder=(-0.088, 0.0, 0.712), elbow=elbow, wrist=wrist, hand=hand
    )
    ball = _ellipsoid(points, (-0.304, -0.152, 0.752), (0.036, 0.036, 0.036))
    right = _smooth_union(right, ball, 0.008)
    right_sleeve = _sleeve(points, elbow=elbow, wrist=wrist, drop=(0.08, 0.24))
    # In front of the robe without contact: its shadow falls on the pleats.
    elbow = (0.176, -0.060, 0.590)
    wrist = (0.062, -0.195, 0.575)
    hand = _ellipsoid(points, (0.040, -0.213, 0.582), (0.030, 0.022, 0.020))
    left = _arm(
        points, shoulder=(0.088, 0.0, 0.712), elbow=elbow, wrist=wrist, hand=hand
    )
    left_sleeve = _sleeve(points, elbow=elbow, wrist=wrist, drop=(0.09, 0.25))
    for arm, sleeve in ((right, right_sleeve), (left, left_sleeve)):
        body = _smooth_union(body, arm, 0.03)
        body = _smooth_union(body, sleeve, 0.012)
    foot_plate = _disc(points, low=0.0, high=0.040, radius=0.215, edge=0.012)
    upper_plate = _disc(points, low=0.02, high=0.074, radius=0.196, edge=0.012)
    plinth = _smooth_union(foot_plate, upper_plate, blend=0.006)
    body = _smooth_union(body, plinth, 0.008)
    for side in (-1.0, 1.0):
        foot = _ellipsoid(points, (0.052 * side, -0.148, 0.082), (0.032, 0.042, 0.026))
        body = _smooth_union(body, foot, 0.01)
    # Hollow of the casting: the robe without its wall, closed at both ends.
    ends = np.abs(points[2] - 0.385) - 0.275
    hollow = _smooth_intersection(robe + _WALL, ends, blend=0.04)
    return np.maximum(body, -hollow)


def _robe(points: _Points) -> _Field:
    x, y, z = points
    wide = _profile(z, _ROBE_X)
    deep = _profile(z, _ROBE_Y)
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
    heights = np.array(_ROBE_Z)
    values = np.array(radii)
    slopes = np.gradient(values, heights)
    i = np.clip(np.searchsorted(heights, z) - 1, 0, len(heights) - 2)
    gap = heights[i + 1] - heights[i]
    t = np.clip((z - heights[i]) / gap, 0.0, 1.0)
    ends = values[i] * (1 + 2 * t) * (1 - t) ** 2 + values[i + 1] * t**2 * (3 - 2 * t)
    return ends + gap * t * (1 - t) * (slopes[i] * (1 - t) - slopes[i + 1] * t)


def _head(points: _Points) -> _Field:
    neck = _capsule(
        points, a=(0.0, 0.0, 0.74), b=(0.0, -0.006, 0.85), thick=(0.034, 0.03)
    )
    head = _ellipsoid(points, (0.0, -0.012, 0.872), (0.056, 0.064, 0.076))
    jaw = _ellipsoid(points, (0.0, -0.034, 0.836), (0.036, 0.036, 0.034))
    nose = _capsule(
        points, a=(0.0, -0.072, 0.888), b=(0.0, -0.083, 0.862), thick=(0.006, 0.010)
    )
    hair = _ellipsoid(points, (0.0, 0.004, 0.886), (0.074, 0.075, 0.080))
    # The face is cut out of the hair.
    face = _ellipsoid(points, (0.0, -0.088, 0.843), (0.058, 0.070, 0.084))
    hair = _smooth_intersection(hair, -face, 0.008)
    bun = _ellipsoid(points, (0.0, 0.022, 0.976), (0.032, 0.032, 0.026))
    face_and_jaw = _smooth_union(head, jaw, blend=0.03)
    skull = _smooth_union(face_and_jaw, nose, blend=0.012)
    crown = _smooth_union(hair, bun, blend=0.012)
    dressed_head = _smooth_union(skull, crown, blend=0.004)
    return _smooth_union(dressed_head, neck, blend=0.02)


def _arm(points: _Points, shoulder: _Point, elbow: _Point, wrist: _Point, hand: _Field):
    upper = _capsule(points, a=shoulder, b=elbow, thick=(0.042, 0.034))
    lower = _capsule(points, a=elbow, b=wrist, thick=(0.034, 0.024))
    bare_arm = _smooth_union(upper, lower, blend=0.02)
    return _smooth_union(bare_arm, hand, blend=0.015)


def _sleeve(
    points: _Points, elbow: _Point, wrist: _Point, drop: tuple[float, float]
) -> _Field:
    """Thin wavy sheet below the forearm, longer towards the wrist."""
    along = np.subtract(wrist, elbow)[:2]
    length = float(np.hypot(*along))
    along_x, along_y = along
    x_from_elbow = points[0] - elbow[0]
    y_from_elbow = points[1] - elbow[1]
    across = x_from_elbow * along_x + y_from_elbow * along_y
    u = across / length**2
    aside = x_from_elbow * along_y - y_from_elbow * along_x
    forearm_height = elbow[2] + u * (wrist[2] - elbow[2])
    below = forearm_height - points[2]
    # Waves grow downward: cloth is gathered at the top.
    drop_at_elbow, drop_at_wrist = drop
    hang = np.clip(below / drop_at_wrist, 0.0, 1.0)
    wave = 0.012 * hang * np.sin(2.0 * np.pi * 1.3 * u + 0.6)
    sheet = np.abs(aside / length - wave) - 0.0125
    fall = drop_at_wrist - drop_at_elbow
    ramp = np.clip(u, 0.0, 1.0)
    hem = below - drop_at_elbow - fall * ramp**2 * (3.0 - 2.0 * ramp)
    # Divided by its slope, or the extracted hem would have steps.
    slope = 6.0 * ramp * (1.0 - ramp) * fall / length
    hem = hem / np.sqrt(1.0 + slope**2)
    ends = (np.abs(u - 0.5) - 0.5) * length
    hemmed = _smooth_intersection(hem, ends, blend=0.07)
    outline = _smooth_intersection(hemmed, -below, blend=0.02)
    return _smooth_intersection(sheet, outline, blend=0.012)
