"""Weights of means that reproduce linear functions and stay positive.

A mean of nodes around a point is that of their mean position: near the border of a wall
it is off by part of a cell. Of all weights with the right mean position, those nearest
to the given ones w_i (in relative entropy) are

    w'_i = w_i exp(l . r_i) / sum_j w_j exp(l . r_j),    r_i = (x_i - x) / R,

with x_i - x in the plane through the point x and R the radius of the weights. l
minimizes the convex function log sum_i w_i exp(l . r_i) + e l^2 / 2; e keeps it finite
where no such mean exists, as on the border itself. Source: Arroyo and Ortiz, Int. J.
Numer. Methods Eng. 65 (2006) 2167.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from ...geometry.vectors import row_dot, tangents


_REGULARIZATION = 1e-6
"""e [-]; the mean position differs from the point by R e |l|."""

# Newton's method: steps of l, the largest of them at first, and the last one.
_MAX_STEPS = 50
_MAX_STEP = 4.0
_LAST_STEP = 1e-7

# Points that are solved together: temporaries stay in the cache.
_CHUNK = 2048


def linear_weights(
    weights: csr_array,
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    position: Float[np.ndarray, "s 3"],
    radius: float,
) -> csr_array:
    """Weights [p, s] with the mean positions of the points.

    Args:
        weights: weights [p, s] above 0, which add up to 1 in each row.
        points: at which the means hold [m].
        normals: unit vectors of the planes through the points.
        position: of what has the weights [m].
        radius: of the weights [m].
    """
    data = np.empty_like(weights.data)
    for start in range(0, len(points), _CHUNK):
        stop = min(start + _CHUNK, len(points))
        bounds = weights.indptr[start : stop + 1]
        entries = slice(bounds[0], bounds[-1])
        offset = offsets(
            points[start:stop],
            normals=normals[start:stop],
            count=np.diff(bounds),
            neighbour=position[weights.indices[entries]],
        )
        data[entries] = _tilted(weights.data[entries], offset / radius, bounds)
    return csr_array((data, weights.indices, weights.indptr), weights.shape)


def offsets(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    count: Int[np.ndarray, " p"],
    neighbour: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "2 n"]:
    """Positions relative to points, along two directions in their planes [m].

    `neighbour` has `count` positions for the first point, then those for the next.
    """
    away = neighbour - np.repeat(points, count, axis=0)
    first, second = tangents(normals)
    return np.stack(
        [
            row_dot(away, np.repeat(first, count, axis=0)),
            row_dot(away, np.repeat(second, count, axis=0)),
        ]
    )


def linear_slopes(
    weight: Float[np.ndarray, " n"],
    change: Float[np.ndarray, "k n"],
    offset: Float[np.ndarray, "2 n"],
    step: Float[np.ndarray, "k 2 p"],
    count: Int[np.ndarray, " p"],
) -> Float[np.ndarray, "k n"]:
    """Change of the weights of `linear_weights` as their points move in their planes.

    Args:
        weight: weights w' of `count` entries for the first point, then for the next.
        change: relative change of the given weights w times w', for each movement.
        offset: r of the entries [-].
        step: movements of the points over the radius, along both directions [-].
        count: number of entries of each point.
    """
    first = np.cumsum(count) - count

    def sums(values: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k p"]:
        return np.add.reduceat(values, first, axis=1)

    def at_entries(values: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "k n"]:
        return np.repeat(values, count, axis=1)

    centred = offset - at_entries(sums(weight * offset))
    spread = _Spread(*sums(weight * centred[[0, 0, 1]] * centred[[0, 1, 1]]))
    # The mean position follows the point.
    slopes = []
    for moved, towards in zip(change, step, strict=True):
        tilt = _solved(spread, towards - sums(moved * centred))
        total = moved + weight * (at_entries(tilt) * centred).sum(axis=0)
        slopes.append(total - weight * at_entries(sums(total[None]))[0])
    return np.stack(slopes)


class _Spread(NamedTuple):
    """Covariance of r at points [-]."""

    xx: Float[np.ndarray, " p"]
    xy: Float[np.ndarray, " p"]
    yy: Float[np.ndarray, " p"]


class _Moments(NamedTuple):
    """Means of some points with the weights at l."""

    weight: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, "2 p"]
    """Sum of w r [-]."""
    spread: _Spread


def _tilted(
    weight: Float[np.ndarray, " n"],
    offset: Float[np.ndarray, "2 n"],
    bounds: Int[np.ndarray, " p1"],
) -> Float[np.ndarray, " n"]:
    """Weights of points, whose entries lie between successive bounds."""
    result = weight.copy()
    # Entries of the points that are not solved yet.
    count = np.diff(bounds)
    entry = np.arange(len(weight))
    active = np.arange(len(count))
    tilt = np.zeros((2, len(count)))
    largest = np.full(len(count), _MAX_STEP)
    previous = np.zeros((2, len(count)))
    for _ in range(_MAX_STEPS):
        moments = _moments(
            weight[entry], offset[:, entry], tilt[:, active], count[active]
        )
        result[entry] = moments.weight
        gradient = moments.mean + _REGULARIZATION * tilt[:, active]
        step = -_solved(moments.spread, gradient)
        length = np.hypot(*step)
        # A step that turns back has jumped over the solution.
        back = (step * previous[:, active]).sum(axis=0) < 0
        largest[active] = np.where(back, largest[active] / 2, largest[active])
        step *= np.minimum(1, largest[active] / np.maximum(length, 1e-300))
        tilt[:, active] += step
        previous[:, active] = step
        goes_on = length > _LAST_STEP
        if not goes_on.any():
            break
        entry = entry[np.repeat(goes_on, count[active])]
        active = active[goes_on]
    return result


def _moments(
    weight: Float[np.ndarray, " n"],
    offset: Float[np.ndarray, "2 n"],
    tilt: Float[np.ndarray, "2 p"],
    count: Int[np.ndarray, " p"],
) -> _Moments:
    first = np.cumsum(count) - count
    x, y = offset
    exponent = x * np.repeat(tilt[0], count) + y * np.repeat(tilt[1], count)
    exponent -= np.repeat(np.maximum.reduceat(exponent, first), count)
    tilted = weight * np.exp(exponent)
    tilted /= np.repeat(np.add.reduceat(tilted, first), count)

    def mean(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " p"]:
        return np.add.reduceat(tilted * values, first)

    mean_x = mean(x)
    mean_y = mean(y)
    spread = _Spread(
        xx=mean(x * x) - mean_x * mean_x,
        xy=mean(x * y) - mean_x * mean_y,
        yy=mean(y * y) - mean_y * mean_y,
    )
    return _Moments(tilted, np.stack([mean_x, mean_y]), spread)


def _solved(
    spread: _Spread, right: Float[np.ndarray, "2 p"]
) -> Float[np.ndarray, "2 p"]:
    """Solution of (covariance + e) l = right."""
    x, y = right
    xx = np.maximum(spread.xx, 0) + _REGULARIZATION
    yy = np.maximum(spread.yy, 0) + _REGULARIZATION
    xy = spread.xy
    determinant = np.maximum(xx * yy - xy * xy, _REGULARIZATION**2)
    return np.stack([yy * x - xy * y, xx * y - xy * x]) / determinant
