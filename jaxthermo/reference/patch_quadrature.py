"""View factors of flat patches by a deterministic quadrature, nothing in between.

The inner integral over a polygon is exact (Lambert), so that patches may touch.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..physics.radiation.polygon import polygon_view_factor
from ..raster.directions import unit_vector, view_frame


class Rule(NamedTuple):
    """Points of a patch with their share of its area."""

    position: Float[np.ndarray, "q 3"]
    """[m]"""
    normal: Float[np.ndarray, "q 3"]
    weight: Float[np.ndarray, " q"]
    """[m^2]"""


def _unit_interval(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre on [0, 1], crowded at both ends, where a neighbour may touch."""
    node, weight = np.polynomial.legendre.leggauss(count)
    t, w = (node + 1) / 2, weight / 2
    return t * t * t * (10 - 15 * t + 6 * t * t), 30 * w * t * t * (1 - t) ** 2


def rectangle_rule(
    corner: Float[np.ndarray, "3"],
    first: Float[np.ndarray, "3"],
    second: Float[np.ndarray, "3"],
    count: int,
) -> Rule:
    """`count` x `count` points of a rectangle; its front is first x second.

    Args:
        corner: [m]
        first: edge from it [m].
        second: edge from it, across the first [m].
        count: along each edge.
    """
    t, w = _unit_interval(count)
    across = np.cross(first, second)
    a, b = (x.reshape(-1, 1) for x in np.meshgrid(t, t, indexing="ij"))
    weight = np.outer(w, w).reshape(-1) * np.linalg.norm(across)
    normal = np.broadcast_to(unit_vector(across), (len(weight), 3))
    return Rule(corner + a * first + b * second, normal, weight)


def disc_rule(
    centre: Float[np.ndarray, "3"], normal: object, radius: float, count: int
) -> Rule:
    """Rings of a disc, twice as many points on each as there are rings.

    Args:
        centre: [m]
        normal: out of its front.
        radius: [m]
        count: of the rings.
    """
    node, weight = np.polynomial.legendre.leggauss(count)
    turn = 2 * np.pi * np.arange(2 * count) / (2 * count)
    ring = radius * (node + 1) / 2
    right, down, front = view_frame(normal)
    around = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * down
    position = centre + (ring[:, None, None] * around).reshape(-1, 3)
    area = np.pi * radius / (2 * count) * weight * ring
    area = np.repeat(area, 2 * count)
    return Rule(position, np.broadcast_to(front, position.shape), area)


def view_factor(first: Rule, second: Rule) -> float:
    """From the first patch to the second, which must not touch: the double integral.

    F = 1 / A_1 integral of cos_1 cos_2 / (pi R^2) dA_2 dA_1
    """
    gap = second.position[None] - first.position[:, None]
    square = np.einsum("ijk,ijk->ij", gap, gap)
    leaves = np.einsum("ijk,ik->ij", gap, first.normal).clip(0)
    meets = -np.einsum("ijk,jk->ij", gap, second.normal).clip(None, 0)
    kernel = leaves * meets / (np.pi * square * square)
    return float(first.weight @ kernel @ second.weight / first.weight.sum())


def view_factor_to_polygon(first: Rule, corners: Float[np.ndarray, "c 3"]) -> float:
    """From a patch to a convex polygon that may touch it.

    Args:
        first: the patch that emits.
        corners: counter-clockwise seen from the polygon's front [m].
    """
    seen = polygon_view_factor(first.position, first.normal, corners)
    return float(first.weight @ seen / first.weight.sum())
