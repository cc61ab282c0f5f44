"""Weights of the fragments of bodies in values at points of their surfaces."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ...geometry.vectors import row_dot
from .fragment_cells import CHUNK, Limits, cells_of
from .linear_weights import linear_weights
from .shapes import ShapePoints, Shapes


SMOOTHING_RADIUS = 2.0
"""Radius of the weights [voxels]; from 1.4 it includes a fragment of any surface."""

MAX_HEIGHT = 0.5
"""Distance from the plane of a point beyond which fragments of a thin wall have no
weight [cells]."""


def _nearest_fragments(points: ShapePoints, shapes: Shapes) -> Int[np.ndarray, " p"]:
    # Of a solid with any normal, of a thin wall on the side of the point. Only points
    # without a fragment in range search twice as far.
    nearest = np.full(len(points.shape), -1, np.int64)
    is_wall = shapes.is_two_sided[points.shape]
    radius = 1.0
    while (missing := np.flatnonzero(nearest < 0)).size:
        radius *= 2
        cells = cells_of(shapes, radius)
        for chunk in np.array_split(missing, len(missing) // CHUNK + 1):
            owner, slot = cells.pairs(points.some(chunk))
            point = chunk[owner]
            fragment = cells.front[slot]
            if is_wall.any():
                normal = points.normal[point]
                cosine = row_dot(normal, shapes.fragment_normal[fragment])
                # A triangle without area has no normal.
                fits = ~is_wall[point] | ~normal.any(axis=1) | (cosine != 0)
                point = point[fits]
                fragment = cells.facing(slot, cosine)[fits]
            offset = points.position[point] - shapes.fragment_position[fragment]
            distance = row_dot(offset, offset)
            order = np.lexsort([distance, point])
            first_of, first = np.unique(point[order], return_index=True)
            nearest[first_of] = fragment[order][first]
    return nearest


def smooth_weights(points: ShapePoints, shapes: Shapes) -> csr_array:
    """Weights [p, s] of the fragments of shapes at each point."""
    cells = cells_of(shapes, SMOOTHING_RADIUS)
    is_wall = shapes.is_two_sided[points.shape]

    # Parts too thin to have fragments show the nearest ones.
    def nearest(alone: np.ndarray) -> Int[np.ndarray, " n"]:
        return _nearest_fragments(points.some(alone), shapes)

    if not is_wall.any():
        return cells.means(points, otherwise=nearest)
    # Another leaf of a wall may be near, with the same normal.
    height = np.where(is_wall, MAX_HEIGHT * shapes.pitch[points.shape], np.inf)
    return linear_weights(
        cells.means(points, Limits(height), otherwise=nearest),
        rows=np.flatnonzero(is_wall),
        points=points.position,
        normals=points.normal,
        position=shapes.fragment_position,
        radius=cells.radius[points.shape],
    )


def nearest_weights(points: ShapePoints, shapes: Shapes) -> csr_array:
    """Weights [p, s] of the nearest fragment alone, which show the voxels."""
    nearest = _nearest_fragments(points, shapes)
    starts = np.arange(len(nearest) + 1)
    size = len(nearest), len(shapes.fragment_area)
    return csr_array((np.ones(len(nearest)), nearest, starts), size)


class MovingWeights(eqx.Module):
    """Weights of the fragments at p points, linear in how far each point moves.

        w(u) = w + u_1 dw/du_1 + u_2 dw/du_2,

    with the distances u along two directions of the surface [m].
    """

    row: Int[Array, " n"]
    """Index of the point of each weight, ascending."""
    fragment: Int[Array, " n"]
    weight: Float[Array, " n"]
    slope: Float[Array, "2 n"]
    """Change of the weight along both directions [1/m]."""
    shift: Float[Array, "p 2"]
    """Distances u that the points have moved [m]."""

    @property
    def moved_weight(self) -> Float[Array, " n"]:
        """Weights w(u) where the points are."""
        return self.weight + (self.shift[self.row] * self.slope.T).sum(axis=1)


def weighted_means(
    weights: csr_array | MovingWeights, values: Array | np.ndarray
) -> Array | np.ndarray:
    """Weighted means of the fragments of each row, [s, ...] to [p, ...]."""
    if isinstance(weights, MovingWeights):
        row = weights.row
        fragment = weights.fragment
        weight = weights.moved_weight
        count = len(weights.shift)
        values = jnp.asarray(values)
    elif isinstance(values, np.ndarray):
        return (weights @ values).astype(values.dtype, copy=False)
    else:
        count = len(weights.indptr) - 1
        row = np.repeat(np.arange(count), np.diff(weights.indptr))
        fragment = weights.indices
        weight = jnp.asarray(weights.data, values.dtype)
    weight = weight.reshape(-1, *(1,) * (values.ndim - 1))
    # The rows of the weights are sorted, which lets XLA sum without scattering.
    return jax.ops.segment_sum(
        weight * values[fragment], row, count, indices_are_sorted=True
    )
