"""View factors in closed form, and of flat patches by quadrature without obstacles.

Sources: Howell and Menguc, A Catalog of Radiation Heat Transfer Configuration Factors;
Incropera et al., Fundamentals of Heat and Mass Transfer, table 13.2.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..arrays import Scalar
from ..geometry.vectors import unit_vector
from ..physics.radiation.area_source import polygon_view_factor
from ..raster.views import view_frame


def parallel_rectangles(width: Scalar, length: Scalar, gap: Scalar) -> float:
    """View factor between two equal opposite rectangles [-]; lengths in m."""
    x = float(width) / float(gap)
    y = float(length) / float(gap)
    p = np.sqrt(1 + x * x)
    q = np.sqrt(1 + y * y)
    diagonal = np.sqrt(1 + x * x + y * y)
    corners = np.log(p * q / diagonal)
    sides = x * q * np.arctan(x / q)
    sides += y * p * np.arctan(y / p)
    ends = x * np.arctan(x)
    ends += y * np.arctan(y)
    scale = 2 / (np.pi * x * y)
    return float(scale * (corners + sides - ends))


def perpendicular_rectangles(shared: Scalar, height: Scalar, width: Scalar) -> float:
    """View factor from a floor to a wall on one of its edges [-]; lengths in m.

    `shared` is the length of the common edge, `width` that of the floor.
    """
    h = float(height) / float(shared)
    w = float(width) / float(shared)
    h2 = h * h
    w2 = w * w
    s = h2 + w2
    angles = w * np.arctan(1 / w) + h * np.arctan(1 / h)
    angles -= np.sqrt(s) * np.arctan(1 / np.sqrt(s))
    powers = np.log((1 + w2) * (1 + h2) / (1 + s))
    powers += w2 * np.log(w2 * (1 + s) / ((1 + w2) * s))
    powers += h2 * np.log(h2 * (1 + s) / ((1 + h2) * s))
    return float((angles + powers / 4) / (np.pi * w))


def coaxial_discs(first: Scalar, second: Scalar, gap: Scalar) -> float:
    """View factor from a disc to a coaxial second one [-]; radii and gap in m."""
    a = float(first) / float(gap)
    b = float(second) / float(gap)
    # The smaller root: a view factor is at most 1.
    s = 1 + (1 + b * b) / (a * a)
    discriminant = s * s - 4 * (b / a) ** 2
    return float((s - np.sqrt(discriminant)) / 2)


def element_to_disc(radius: Scalar, gap: Scalar) -> float:
    """View factor from an element on the axis of a disc: R^2 / (R^2 + H^2)."""
    square = float(radius) ** 2
    return square / (square + float(gap) ** 2)


def element_to_rectangle(width: Scalar, length: Scalar, gap: Scalar) -> float:
    """View factor from an element to a parallel rectangle, below its corner [-]."""
    x = float(width) / float(gap)
    y = float(length) / float(gap)
    p = np.sqrt(1 + x * x)
    q = np.sqrt(1 + y * y)
    angles = x / p * np.arctan(y / p)
    angles += y / q * np.arctan(x / q)
    return float(angles / (2 * np.pi))


def element_to_strip(width: Scalar, gap: Scalar) -> float:
    """View factor from an element to an infinite strip centred above it [-].

    It is the sine of half the angle that the strip spans; lengths in m.
    """
    half = float(width) / 2
    return half / np.hypot(half, float(gap))


class _Rule(NamedTuple):
    """Quadrature points of a patch with their areas as weights."""

    position: Float[np.ndarray, "q 3"]
    """[m]"""
    normal: Float[np.ndarray, "q 3"]
    weight: Float[np.ndarray, " q"]
    """[m^2]"""


def _unit_interval(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre rule on [0, 1], refined at both ends."""
    # Neighbouring patches may touch there, where the integrand is singular.
    node, weight = np.polynomial.legendre.leggauss(count)
    t = (node + 1) / 2
    w = weight / 2
    refined_node = t * t * t * (10 - 15 * t + 6 * t * t)
    refined_weight = 30 * w * t * t * (1 - t) ** 2
    return refined_node, refined_weight


def rectangle_rule(
    corner: Float[np.ndarray, "3"],
    first: Float[np.ndarray, "3"],
    second: Float[np.ndarray, "3"],
    count: int,
) -> _Rule:
    """Rule of `count` x `count` points of a rectangle; its front is first x second.

    `first` and `second` are its edges from a corner [m].
    """
    t, w = _unit_interval(count)
    across = np.cross(first, second)
    rows, columns = np.meshgrid(t, t, indexing="ij")
    a = rows.reshape(-1, 1)
    b = columns.reshape(-1, 1)
    area = np.linalg.norm(across)
    weight = np.outer(w, w).reshape(-1) * area
    position = corner + a * first + b * second
    normal = np.broadcast_to(unit_vector(across), position.shape)
    return _Rule(position=position, normal=normal, weight=weight)


def disc_rule(
    centre: Float[np.ndarray, "3"], normal: object, radius: float, count: int
) -> _Rule:
    """Rule of a disc in `count` rings with twice as many points on each."""
    # Equidistant angles integrate a periodic function with spectral accuracy.
    node, weight = np.polynomial.legendre.leggauss(count)
    turn = 2 * np.pi * np.arange(2 * count) / (2 * count)
    ring = radius * (node + 1) / 2
    right, down, front = view_frame(normal)
    around = np.cos(turn)[:, None] * right
    around += np.sin(turn)[:, None] * down
    offset = ring[:, None, None] * around
    position = centre + offset.reshape(-1, 3)
    point_area = np.pi * radius / (2 * count) * weight * ring
    area = np.repeat(point_area, 2 * count)
    normal = np.broadcast_to(front, position.shape)
    return _Rule(position=position, normal=normal, weight=area)


def view_factor(first: _Rule, second: _Rule) -> float:
    """View factor between patches that do not touch, by the double integral [-].

    F = 1 / A_1 integral of cos_1 cos_2 / (pi R^2) dA_2 dA_1
    """
    # Away from each other's front two elements exchange nothing: cosines below 0 are 0.
    gap = second.position[None] - first.position[:, None]
    square = np.einsum("ijk,ijk->ij", gap, gap)
    leaves = np.einsum("ijk,ik->ij", gap, first.normal).clip(0)
    meets = -np.einsum("ijk,jk->ij", gap, second.normal).clip(None, 0)
    kernel = leaves * meets / (np.pi * square * square)
    area = first.weight.sum()
    return float(first.weight @ kernel @ second.weight / area)


def view_factor_to_polygon(first: _Rule, corners: Float[np.ndarray, "c 3"]) -> float:
    """View factor from a patch to a convex polygon that may touch it [-].

    The inner integral is exact. Corners are counter-clockwise seen from the front [m].
    """
    seen = polygon_view_factor(first.position, first.normal, corners)
    area = first.weight.sum()
    return float(first.weight @ seen / area)
