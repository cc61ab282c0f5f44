"""Clipping triangles at a plane."""

import numpy as np
from jaxtyping import Float


def _cut(inside, outside, depth_in, depth_out):
    """Points where edges from inside to outside meet the plane."""
    share = depth_in / (depth_in - depth_out)
    return inside + share[:, None] * (outside - inside)


def clip_half_space(
    triangles: Float[np.ndarray, "f 3 3"],
    normal: Float[np.ndarray, "3"],
    least: float,
) -> Float[np.ndarray, "k 3 3"]:
    """The parts of triangles where normal . x >= least, wound as they were."""
    depth = triangles @ normal - least
    ahead = depth >= 0
    count = ahead.sum(axis=1)
    one, two = np.flatnonzero(count == 1), np.flatnonzero(count == 2)

    def corners(chosen, first):
        """Of the chosen triangles with their depths, starting at corner `first`."""
        turns = [(first + k) % 3 for k in range(3)]
        points = (triangles[chosen, turn] for turn in turns)
        return (*points, *(depth[chosen, turn] for turn in turns))

    # One corner ahead leaves a triangle, two leave a quadrilateral: two triangles.
    a, b, c, da, db, dc = corners(one, ahead[one].argmax(1))
    tips = np.stack([a, _cut(a, b, da, db), _cut(a, c, da, dc)], axis=1)
    behind, d, e, db, dd, de = corners(two, (~ahead[two]).argmax(1))
    at_d, at_e = _cut(d, behind, dd, db), _cut(e, behind, de, db)
    lower, upper = np.stack([d, e, at_e], axis=1), np.stack([d, at_e, at_d], axis=1)
    return np.concatenate([triangles[count == 3], tips, lower, upper])
