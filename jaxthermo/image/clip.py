"""Clipping triangles at a near plane, so that none passes behind the eye."""

import numpy as np
from jaxtyping import Float, Int


def _cut(inside: np.ndarray, outside: np.ndarray, near: float) -> np.ndarray:
    """Points where edges from inside to outside meet the plane."""
    share = (near - inside[:, 2]) / (outside[:, 2] - inside[:, 2])
    return inside + share[:, None] * (outside - inside)


def _turned(triangles: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, ...]:
    """The three corners of each triangle, starting at corner `first`."""
    rows = np.arange(len(triangles))
    return tuple(triangles[rows, (first + k) % 3] for k in range(3))


def clip_near(
    triangles: Float[np.ndarray, "f 3 3"], near: float
) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
    """The parts of triangles with z >= near, and the triangle each part is of."""
    ahead = triangles[..., 2] >= near
    count = ahead.sum(axis=1)
    whole, one, two = (np.flatnonzero(count == n) for n in (3, 1, 2))
    # One corner ahead leaves a triangle, two leave a quadrilateral: two triangles.
    a, b, c = _turned(triangles[one], ahead[one].argmax(1))
    tips = np.stack([a, _cut(a, b, near), _cut(a, c, near)], axis=1)
    behind, d, e = _turned(triangles[two], (~ahead[two]).argmax(1))
    at_d, at_e = _cut(d, behind, near), _cut(e, behind, near)
    lower = np.stack([d, e, at_e], axis=1)
    upper = np.stack([d, at_e, at_d], axis=1)
    pieces = np.concatenate([triangles[whole], tips, lower, upper])
    return pieces, np.concatenate([whole, one, two, two])
