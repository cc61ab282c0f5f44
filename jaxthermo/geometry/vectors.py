"""Vectors of length one, products of rows of vectors, and boxes around triangles."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError


def unit_vector(
    direction: object, argument: str = "direction"
) -> Float[np.ndarray, "3"]:
    """Scale `direction` to length one.

    Raises:
        InputError: if it is not three finite numbers or has no length.
    """
    try:
        vector = np.asarray(direction, float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    length = np.linalg.norm(vector) if vector.shape == (3,) else 0.0
    if not np.isfinite(length) or length == 0.0:
        raise InputError(
            f"{argument} {direction!r}: give three finite numbers, not all zero"
        )
    return vector / length


def triple(vector: Any) -> tuple[float, float, float]:
    """Three plain numbers, which can be compared and hashed."""
    x, y, z = np.asarray(vector, float).tolist()
    return x, y, z


def cross_product(
    first: Float[np.ndarray, "3"], second: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """The product of two vectors; `np.cross` takes many times as long for only two."""
    a, b, c = first.tolist()
    x, y, z = second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def unit_vectors(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Scale the vectors on the last axis to length one; those of length zero stay."""
    length = row_length(vectors)
    return vectors / np.where(length > 0, length, 1)[..., None]


def triangle_normals(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    """Normals of triangles, as long as twice the area.

    They point to the side from which the corners are counter-clockwise.
    """
    first, second, third = np.moveaxis(triangles, 1, 0)
    return np.cross(second - first, third - first)


def row_dot(
    a: Float[np.ndarray, "*n k"], b: Float[np.ndarray, "*n k"]
) -> Float[np.ndarray, "*n"]:
    """Scalar product of each row with the same row of the other array."""
    return np.einsum("...i,...i->...", a, b)


def row_length(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
    """Length of each row, as by `np.linalg.norm`."""
    # Which is slow along so short an axis.
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.sqrt(x * x + y * y + z * z)


def tangents(
    normal: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Two unit vectors that are at right angles to each normal and to each other."""
    # From the axis that is farthest from the normal: never parallel to it.
    axis = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = unit_vectors(np.cross(normal, axis))
    return first, np.cross(normal, first)


def part_bounds(
    triangles: Float[np.ndarray, "f 3 3"], labels: Int[np.ndarray, " f"], count: int
) -> Float[np.ndarray, "2 parts 3"]:
    """Lowest and highest corner of the box around each part of a mesh [m]."""
    low = np.full((count, 3), np.inf)
    high = np.full((count, 3), -np.inf)
    np.minimum.at(low, labels, triangles.min(axis=1))
    np.maximum.at(high, labels, triangles.max(axis=1))
    return np.stack([low, high])
