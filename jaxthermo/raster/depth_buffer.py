"""Nearest triangle in each pixel, and ranges of depth: depth buffers of numpy.

Fragments are those of `fragments`, the tested reference, from the same integers. Where
the layers in between and their sort are not needed, this takes half of the time, and
nothing is compiled: a program of XLA has a fixed size of all its arrays.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .fragments import SNAP, check_coordinates


# Limit [pixels] below which float64 is exact: products of snapped coordinates and their
# sums stay below 2^53, and so does the error of a quotient below its distance from the
# next integer. It has vector instructions for all of them.
_MAX_EXACT = 2**15

# Triangles that are drawn together: temporaries stay in the cache, and the allocator
# keeps them instead of returning them.
_CHUNK = 4096


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
    for triangle, pixel, key in _chunks(points, faces, width, height):
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
    for _, pixel, key in _chunks(triangles.reshape(-1, 3), faces, width, height):
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


def _chunks(
    points: np.ndarray, faces: np.ndarray, width: int, height: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Triangles, pixels and depths of the fragments of some triangles after others."""
    check_coordinates(points)
    across, down, depth = np.ascontiguousarray(points.T)
    largest = max(np.abs(across).max(initial=0), np.abs(down).max(initial=0))
    kind = np.float64 if largest <= _MAX_EXACT else np.int64
    x, y = (np.rint(each * SNAP).astype(kind) for each in (across, down))
    chosen = _around_centres(x, y, faces, width, height)
    for first in range(0, len(chosen), _CHUNK):
        part = chosen[first : first + _CHUNK]
        corners = np.ascontiguousarray(faces[part].T)
        hit, pixel, key = _fragments(x, y, depth, corners, width, height)
        yield part[hit], pixel, key


def _fragments(
    x: np.ndarray,
    y: np.ndarray,
    depth: np.ndarray,
    corners: np.ndarray,
    width: int,
    height: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles, pixels and depths of all fragments of some triangles."""
    face, row, left, count = _spans(x, y, corners, width, height)
    span, step = _slots(count)
    hit, row, column = face[span], row[span], left[span] + step
    key = _plane_at(x, y, depth, corners, hit, column, row)
    return hit, row * width + column, key


def _slots(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Owners of `count` slots each, and the numbers of the slots within their owner."""
    full = np.flatnonzero(count)
    ends = np.cumsum(count[full])
    total = int(ends[-1]) if len(full) else 0
    # A sum of steps, which takes a quarter of the time of `np.repeat`.
    owner = np.zeros(total, np.int64)
    owner[ends[:-1]] = np.diff(full)
    owner[:1] = full[:1]
    np.cumsum(owner, out=owner)
    return owner, np.arange(total) - (np.cumsum(count) - count)[owner]


def _first_centre(snapped: np.ndarray, size: int) -> Int[np.ndarray, " k"]:
    """Index from 0 to `size` of the first pixel centre at or after a coordinate."""
    # Snapped coordinates are whole numbers, also in float64.
    return np.clip((snapped.astype(np.int64) + (SNAP // 2 - 1)) // SNAP, 0, size)


def _around_centres(
    x: np.ndarray, y: np.ndarray, faces: np.ndarray, width: int, height: int
) -> Int[np.ndarray, " k"]:
    """Triangles with the centre of a pixel in their bounding box."""
    # Most triangles of a fine mesh lie between the centres.
    inside: Any = True
    for along, size in ((x, width), (y, height)):
        low, high = _ends(*_first_centre(along, size)[faces.T])
        inside &= low < high
    return np.flatnonzero(inside)


class _Spans(NamedTuple):
    """Runs of pixels that a triangle covers in one row."""

    face: Int[np.ndarray, " r"]
    row: Int[np.ndarray, " r"]
    left: Int[np.ndarray, " r"]
    """First column."""
    count: Int[np.ndarray, " r"]


def _spans(
    x: np.ndarray, y: np.ndarray, corners: np.ndarray, width: int, height: int
) -> _Spans:
    # Below and above the middle corner two edges cross a row, one of them the longest.
    # From its lower end in either triangle of an edge: both divide the same integers.
    bottom, middle, top = _by_height(x[corners], y[corners])
    low, split, high = (
        _first_centre(each[1], height) for each in (bottom, middle, top)
    )
    part, step = _slots(np.append(split - low, high - split))
    count = len(low)
    face = np.where(part < count, part, part - count)
    row = np.append(low, split)[part] + step
    centre = (row * SNAP + SNAP // 2).astype(x.dtype)
    one = _crossing(_line(bottom, top), face, centre)
    lower, upper = _line(bottom, middle), _line(middle, top)
    short = map(np.append, lower, upper)
    other = _crossing(short, part, centre)
    left = np.clip(np.minimum(one, other), 0, width)
    return _Spans(face, row, left, np.clip(np.maximum(one, other), 0, width) - left)


def _ends(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Pair by pair: numpy is slow at the minimum along an axis of length three.
    low, high = np.minimum(a, b), np.maximum(a, b)
    return np.minimum(low, c), np.maximum(high, c)


_Corner = tuple[np.ndarray, np.ndarray]
"""Columns and rows of one corner of each triangle, in steps."""


def _by_height(x: np.ndarray, y: np.ndarray) -> list[_Corner]:
    """The corners of triangles [3, k] with the lowest first."""
    corner = [*zip(x, y, strict=True)]
    for one, other in ((0, 1), (1, 2), (0, 1)):
        (x0, y0), (x1, y1) = corner[one], corner[other]
        turned = y0 > y1
        corner[one] = np.where(turned, x1, x0), np.minimum(y0, y1)
        corner[other] = np.where(turned, x0, x1), np.maximum(y0, y1)
    return corner


def _line(low: _Corner, high: _Corner) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slope, offset and scale with which `_crossing` finds an edge in a row."""
    (x0, y0), (x1, y1) = low, high
    run, rise = x1 - x0, y1 - y0
    return run, x0 * rise - y0 * run - rise * (SNAP // 2), rise * SNAP


def _crossing(line, edge: np.ndarray, centre: np.ndarray) -> Int[np.ndarray, " r"]:
    """First column at or after edges in rows of centres, which they cross."""
    run, offset, scale = (each[edge] for each in line)
    numerator = centre * run + offset
    if numerator.dtype != np.float64:
        return -(-numerator // scale)
    # Faster than `np.ceil`.
    quotient = numerator / scale
    whole = quotient.astype(np.int64)
    return whole + (quotient > whole)


def _plane_at(
    x: np.ndarray,
    y: np.ndarray,
    depth: np.ndarray,
    corners: np.ndarray,
    face: np.ndarray,
    column: np.ndarray,
    row: np.ndarray,
) -> Float[np.ndarray, " k"]:
    """Depths of the planes of triangles at pixel centres inside them."""
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = x[corners], y[corners], depth[corners]
    ux, uy, vx, vy = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    low, high = _ends(z0, z1, z2)
    of = lambda each: each[face]
    dx, dy = column * SNAP + SNAP // 2 - of(x0), row * SNAP + SNAP // 2 - of(y0)
    # Integers up to here; only the depth itself is rounded.
    w1, w2 = dx * of(vy) - dy * of(vx), dy * of(ux) - dx * of(uy)
    weighted = w1 * of(z1 - z0) + w2 * of(z2 - z0)
    found = of(z0) + weighted / of(ux * vy - vx * uy)
    # Planes nearly parallel to the ray extrapolate wildly; the corners bound them.
    return np.minimum(np.maximum(found, of(low)), of(high))
