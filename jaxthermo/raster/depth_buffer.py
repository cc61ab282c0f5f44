"""Nearest triangle in each pixel, and ranges of depth: depth buffers of numpy.

Where the layers in between and their sort are not needed, this takes half of the time.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .host_fragments import fragment_chunks


class NearestHits(NamedTuple):
    """The first triangle that the ray of each pixel meets, in pixels that show any."""

    pixel: Int[np.ndarray, " p"]
    """row * width + column, ascending."""
    depth: Float[np.ndarray, " p"]
    triangle: Int[np.ndarray, " p"]
    """The first of several at one depth."""


def nearest_hits(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
) -> NearestHits:
    """Find what is seen of triangles with corners `points` (column, row, depth).

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    nearest = np.full(width * height, np.inf)
    owner = np.full(width * height, len(faces))
    for triangle, pixel, key in fragment_chunks(
        points, faces=faces, width=width, height=height
    ):
        # Where they are nearer than what was drawn before.
        ahead = np.flatnonzero(key < nearest[pixel])
        triangle, pixel, key = triangle[ahead], pixel[ahead], key[ahead]
        _draw(nearest, pixel, key)
        first = np.flatnonzero(key == nearest[pixel])
        owner[pixel[first]] = np.iinfo(owner.dtype).max
        np.minimum.at(owner, pixel[first], triangle[first])
    seen = np.flatnonzero(owner < len(faces))
    return NearestHits(seen, nearest[seen], owner[seen])


def depth_range(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Nearest and farthest depth of triangles given as (column, row, depth).

    Empty pixels have the depths inf and -inf.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    nearest, negative = np.full((2, width * height), np.inf)
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    points = triangles.reshape(-1, 3)
    for _, pixel, key in fragment_chunks(
        points, faces=faces, width=width, height=height
    ):
        _draw(nearest, pixel, key)
        _draw(negative, pixel, -key)
    return nearest.reshape(height, width), -negative.reshape(height, width)


def _draw(buffer: np.ndarray, pixel: np.ndarray, key: np.ndarray) -> None:
    """Lower the buffer to the smallest key of each pixel."""
    # Ten times as fast as `np.minimum.at`: few are left after the second pass.
    while len(key):
        ahead = np.flatnonzero(key < buffer[pixel])
        pixel, key = pixel[ahead], key[ahead]
        buffer[pixel] = key
