"""Nearest triangle in each pixel, and ranges of depth, by depth buffers.

They need no sort, unlike `peel`, which finds all layers in between.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .fragments import FragmentChunk, SomePixels, fragment_chunks


class _NearestHits(NamedTuple):
    """The first triangle that the ray of each pixel meets, in pixels that show any."""

    pixel: Int[np.ndarray, " p"]
    """row * width + column, ascending."""
    depth: Float[np.ndarray, " p"]
    triangle: Int[np.ndarray, " p"]
    """Number of the triangle; the lowest number of several at one depth."""


def nearest_hits(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
) -> _NearestHits:
    """Find the visible triangles with corners `points` (column, row, depth).

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    nearest = np.full(width * height, np.inf)
    owner = np.full(width * height, len(faces))
    for chunk in fragment_chunks(points, faces=faces, width=width, height=height):
        # Only fragments nearer than those drawn before.
        ahead = np.flatnonzero(chunk.depth < nearest[chunk.pixel])
        triangle = chunk.triangle[ahead]
        pixel = chunk.pixel[ahead]
        depth = chunk.depth[ahead]
        _draw(nearest, pixel, depth)
        first = np.flatnonzero(depth == nearest[pixel])
        owner[pixel[first]] = np.iinfo(owner.dtype).max
        np.minimum.at(owner, pixel[first], triangle[first])
    seen = np.flatnonzero(owner < len(faces))
    return _NearestHits(pixel=seen, depth=nearest[seen], triangle=owner[seen])


def depth_range(
    triangles: Float[np.ndarray, "f 3 3"],
    row: Int[np.ndarray, " p"],
    column: Int[np.ndarray, " p"],
    width: int,
    height: int,
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Nearest and farthest depth in some pixels of triangles (column, row, depth).

    Those of empty pixels are inf and -inf.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    pixel = row * width + column
    pixels = SomePixels.of(pixel, width * height)
    nearest, negative = np.full((2, len(pixels.pixel)), np.inf)
    for chunk in _triangle_chunks(triangles, width, height, pixels):
        number = pixels.before[chunk.pixel]
        _draw(nearest, number, chunk.depth)
        _draw(negative, number, -chunk.depth)
    number = pixels.before[pixel]
    return nearest[number], -negative[number]


def nearest_depth(
    triangles: Float[np.ndarray, "f 3 3"],
    row: Int[np.ndarray, " p"],
    column: Int[np.ndarray, " p"],
    width: int,
    height: int,
) -> Float[np.ndarray, " p"]:
    """Nearest depth alone, see `depth_range`."""
    pixel = row * width + column
    pixels = SomePixels.of(pixel, width * height)
    nearest = np.full(len(pixels.pixel), np.inf)
    for chunk in _triangle_chunks(triangles, width, height, pixels):
        _draw(nearest, pixels.before[chunk.pixel], chunk.depth)
    return nearest[pixels.before[pixel]]


def _triangle_chunks(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int, within: SomePixels
) -> Iterator[FragmentChunk]:
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    points = triangles.reshape(-1, 3)
    return fragment_chunks(
        points, faces=faces, width=width, height=height, within=within
    )


def _draw(
    buffer: Float[np.ndarray, " b"],
    number: Int[np.ndarray, " k"],
    depth: Float[np.ndarray, " k"],
) -> None:
    """Lower the values of these numbers in a buffer to the smallest depth of each."""
    # Whole arrays at a time instead of `np.minimum.at`: few fragments are left after
    # the second pass.
    while len(depth):
        ahead = np.flatnonzero(depth < buffer[number])
        number = number[ahead]
        depth = depth[ahead]
        buffer[number] = depth
