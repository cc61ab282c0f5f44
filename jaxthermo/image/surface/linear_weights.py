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
from ...parallel.threads import in_threads


_REGULARIZATION = 1e-6
"""e [-]; the mean position differs from the point by R e |l|."""

# Newton's method: steps of l, the largest of them at first, and those in which weights
# change linearly.
_MAX_STEPS = 16
_MAX_STEP = 4.0
_SHORT_STEP = 1e-3

_LAST_MOVE = 1e-7
"""Way of the mean position in the last step, over the radius [-].

The step itself may grow without end, where the point is outside of what has weights.
"""

# Points that are solved together: temporaries stay in the cache.
_CHUNK = 4096


def linear_weights(
    weights: csr_array,
    rows: Int[np.ndarray, " q"],
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    position: Float[np.ndarray, "s 3"],
    radius: Float[np.ndarray, " p"],
) -> csr_array:
    """Weights [p, s] with the mean positions of the points.

    Args:
        weights: weights [p, s] above 0, which add up to 1 in each row.
        rows: points whose weights are replaced.
        points: at which the means hold [m].
        normals: unit vectors of the planes through the points.
        position: of what has the weights [m].
        radius: of the weights at each point [m].
    """
    groups = _groups(weights, position)
    tilted = groups.weight.copy()
    columns = np.ascontiguousarray(position[groups.member].T)
    number = np.diff(groups.start)
    # Points with about as many groups together: a table has room for the most.
    order = rows[np.argsort(number[rows], kind="stable")]

    def replace(chosen: Int[np.ndarray, " c"]) -> None:
        count = number[chosen]
        row = np.arange(count.max())[:, None]
        # A table repeats the last group of a point that has fewer, without weight.
        group = groups.start[chosen] + np.minimum(row, count - 1)
        is_group = row < count
        offset = np.zeros((2, *group.shape))
        # Column by column: numbers that are read together are close in memory.
        along = np.stack(tangents(normals[chosen])) / radius[chosen, None]
        for axis, column in enumerate(columns):
            away = column[group] - points[chosen, axis]
            for way, direction in zip(offset, along[..., axis], strict=True):
                way += away * direction
        table = _tilted(np.where(is_group, groups.weight[group], 0), offset)
        tilted[group[is_group]] = table[is_group]

    chunks = [order[at : at + _CHUNK] for at in range(0, len(order), _CHUNK)]
    # A group belongs to one point: no two threads write to the same.
    for _ in in_threads(replace, chunks):
        pass
    data = weights.data * (tilted / groups.weight)[groups.number]
    return csr_array((data, weights.indices, weights.indptr), weights.shape)


class _Groups(NamedTuple):
    """Groups of successive weights of one point at one place.

    Their factor is the same: their sum takes their place.
    """

    number: Int[np.ndarray, " w"]
    """Number of the group of each of the w weights."""
    weight: Float[np.ndarray, " g"]
    """Sum of the weights of each group."""
    member: Int[np.ndarray, " g"]
    """Something with a weight at the place of each group."""
    start: Int[np.ndarray, " p1"]
    """First group of each point, and the number of groups."""


def _groups(weights: csr_array, position: Float[np.ndarray, "s 3"]) -> _Groups:
    """Groups of weights, if those at one place follow each other."""
    moves = (np.diff(position, axis=0) != 0).any(axis=1)
    place = np.append(0, np.cumsum(moves))[weights.indices]
    begins = np.append(True, place[1:] != place[:-1])
    begins[weights.indptr[:-1]] = True
    first = np.flatnonzero(begins)
    number = np.cumsum(begins) - 1
    return _Groups(
        number=number,
        weight=np.add.reduceat(weights.data, first),
        member=weights.indices[first],
        start=np.append(number, len(first))[weights.indptr],
    )


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

    weight: Float[np.ndarray, "n p"]
    mean: Float[np.ndarray, "2 p"]
    """Sum of w r [-]."""
    spread: _Spread


def _tilted(
    weight: Float[np.ndarray, "n p"], offset: Float[np.ndarray, "2 n p"]
) -> Float[np.ndarray, "n p"]:
    """Weights of the n neighbours of each point."""
    result = np.empty_like(weight)
    # Points that are not solved yet, and some that are.
    active = np.arange(weight.shape[1])
    tilt = np.zeros((2, len(active)))
    largest = np.full(len(active), _MAX_STEP)
    previous = np.zeros((2, len(active)))
    for _ in range(_MAX_STEPS):
        moments = _moments(weight, offset, tilt)
        step = -_solved(moments.spread, moments.mean + _REGULARIZATION * tilt)
        length = np.hypot(*step)
        # A step that turns back has jumped over the solution.
        back = (step * previous).sum(axis=0) < 0
        largest = np.where(back, largest / 2, largest)
        step *= np.minimum(1, largest / np.maximum(length, 1e-300))
        moves = np.hypot(*_product(moments.spread, step)) > _LAST_MOVE
        goes_on = (length > _SHORT_STEP) & moves
        if goes_on.sum() <= len(active) / 2:
            short = np.where(length <= _SHORT_STEP, step, 0)
            centred = offset - moments.mean[:, None]
            change = (short[:, None] * centred).sum(axis=0)
            result[:, active] = moments.weight * (1 + change)
            active = active[goes_on]
            if not len(active):
                break
            weight = weight.compress(goes_on, axis=1)
            offset = offset.compress(goes_on, axis=2)
            step = step[:, goes_on]
            tilt = tilt[:, goes_on]
            largest = largest[goes_on]
        tilt = tilt + step
        previous = step
    else:
        result[:, active] = _moments(weight, offset, tilt).weight
    return result


def _moments(
    weight: Float[np.ndarray, "n p"],
    offset: Float[np.ndarray, "2 n p"],
    tilt: Float[np.ndarray, "2 p"],
) -> _Moments:
    x, y = offset
    exponent = x * tilt[0] + y * tilt[1]
    exponent -= exponent.max(axis=0)
    tilted = weight * np.exp(exponent, out=exponent)
    tilted /= tilted.sum(axis=0)
    along_x = tilted * x
    along_y = tilted * y
    mean_x = along_x.sum(axis=0)
    mean_y = along_y.sum(axis=0)
    spread = _Spread(
        xx=(along_x * x).sum(axis=0) - mean_x * mean_x,
        xy=(along_x * y).sum(axis=0) - mean_x * mean_y,
        yy=(along_y * y).sum(axis=0) - mean_y * mean_y,
    )
    return _Moments(tilted, np.stack([mean_x, mean_y]), spread)


def _product(
    spread: _Spread, vector: Float[np.ndarray, "2 p"]
) -> Float[np.ndarray, "2 p"]:
    """Product of the covariance and a vector."""
    x, y = vector
    return np.stack([spread.xx * x + spread.xy * y, spread.xy * x + spread.yy * y])


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
