"""Sources as a camera sees them: where rays meet them, and their radiance.

All functions take rays from `origin` [m] with `step` [m] per metre of depth. They give
the radiance for a unit of strength, 0 where a ray misses, and the depth of the source.
"""

import math

import numpy as np
from jaxtyping import Float

from ...geometry.vectors import row_dot, unit_vectors


_Rays = Float[np.ndarray, "p 3"]
Appearance = tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]
"""Radiance for a unit of strength, and depth along the optical axis [m]."""

SUN_HALF_ANGLE = 0.0046505
"""Apparent radius of the sun, 695 700 km at 149 597 871 km [rad] (IAU 2015 B3)."""


def _seen(hit: np.ndarray, radiance: float, depth: np.ndarray) -> Appearance:
    return np.where(hit, radiance, 0.0), np.where(hit, depth, np.inf)


def distant_disc(step: _Rays, towards: Float[np.ndarray, "3"]) -> Appearance:
    """Sun in a direction, radiance E / (pi sin^2 a) of an irradiance E normal to it."""
    # By the chord: the cosine of so small an angle has lost its digits.
    gap = unit_vectors(step) - towards
    hit = np.linalg.norm(gap, axis=1) <= 2 * math.sin(SUN_HALF_ANGLE / 2)
    radiance = 1 / (math.pi * math.sin(SUN_HALF_ANGLE) ** 2)
    return _seen(hit, radiance, np.full(len(step), np.inf))


def sphere(
    origin: _Rays, step: _Rays, centre: Float[np.ndarray, "3"], radius: float
) -> Appearance:
    """Diffuse sphere, radiance I / (pi R^2) of a radiant intensity I."""
    square = row_dot(step, step)
    offset = origin - centre
    half = row_dot(offset, step) / square
    under = half * half - (row_dot(offset, offset) - radius * radius) / square
    depth = -half - np.sqrt(np.maximum(under, 0.0))
    hit = (under >= 0) & (depth > 0)
    return _seen(hit, 1 / (math.pi * radius * radius), depth)


def rectangle(
    origin: _Rays,
    step: _Rays,
    centre: Float[np.ndarray, "3"],
    edges: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
) -> Appearance:
    """Diffuse rectangle of a given radiance, from the front: width x height."""
    front = np.cross(*edges)
    towards = step @ front
    facing = towards < 0
    depth = (centre - origin) @ front / np.where(facing, towards, -1.0)
    offset = origin + depth[:, None] * step - centre
    within = [np.abs(offset @ edge) <= edge @ edge / 2 for edge in edges]
    return _seen(facing & (depth > 0) & within[0] & within[1], 1.0, depth)
