"""Clipping of triangles at a plane."""

import numpy as np
from jaxtyping import Float, Int


def clip_half_space(
    triangles: Float[np.ndarray, "f 3 3"],
    normal: Float[np.ndarray, "3"],
    offset: float,
) -> tuple[Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
    """Clip triangles to the half-space normal . x >= offset.

    Returns:
        The remaining triangles, wound as before, and the index of the triangle that
        each is a part of.
    """
    depth = triangles @ normal - offset
    ahead = depth >= 0
    count = ahead.sum(axis=1)
    whole, one, two = (np.flatnonzero(count == n) for n in (3, 1, 2))

    def corners(chosen, first):
        """Points and depths of the corners, in order from corner `first`."""
        order = [(first + k) % 3 for k in range(3)]
        points = (triangles[chosen, corner] for corner in order)
        return (*points, *(depth[chosen, corner] for corner in order))

    # One corner ahead leaves a triangle, two leave a quadrilateral: two triangles.
    a, b, c, da, db, dc = corners(one, ahead[one].argmax(1))
    tips = np.stack([a, _intersect(a, b, da, db), _intersect(a, c, da, dc)], axis=1)
    behind, d, e, db, dd, de = corners(two, (~ahead[two]).argmax(1))
    at_d, at_e = _intersect(d, behind, dd, db), _intersect(e, behind, de, db)
    lower, upper = np.stack([d, e, at_e], axis=1), np.stack([d, at_e, at_d], axis=1)
    pieces = np.concatenate([triangles[whole], tips, lower, upper])
    return pieces, np.concatenate([whole, one, two, two])


def _intersect(inside, outside, depth_in, depth_out):
    # Always from inside to outside, so that neighbours compute the same point.
    fraction = depth_in / (depth_in - depth_out)
    return inside + fraction[:, None] * (outside - inside)
