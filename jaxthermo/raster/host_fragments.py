"""Fragments of triangles and their depth layers by numpy, on the host.

The same as those of the compiled program in `fragments`, from the same integers, depths
to their last bit. Every size of mesh and image takes a program of its own, which is
compiled in many times the time in which numpy is done.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_union
from ..errors import InputError


SNAP = 1024
"""Steps per pixel of the snapped coordinates."""

_MAX_COORDINATE = 2**20
"""Limit [pixels] below which the products of 64-bit integers cannot overflow."""

# Limit [pixels] below which float64 is exact: products of snapped coordinates and their
# sums stay below 2^53, and so does the error of a quotient below its distance from the
# next integer. It has vector instructions for all of them.
_MAX_EXACT = 2**15

# Triangles that are drawn together: temporaries stay in the cache, and the allocator
# keeps them instead of returning them.
_CHUNK = 4096


def within_raster(corners: Float[np.ndarray, "*n 3"]) -> bool:
    """True if no product of corners (column, row, depth) can overflow."""
    ends = corners.min(initial=0), corners.max(initial=0)
    # Most often the bounds of all numbers suffice, which are quick to find.
    return bool(np.abs(ends).max() <= _MAX_COORDINATE) or bool(
        np.isfinite(ends).all()
        and np.abs(corners[..., :2]).max(initial=0) <= _MAX_COORDINATE
    )


def check_coordinates(corners: Float[np.ndarray, "*n 3"]) -> None:
    """Refuse what is not `within_raster`.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    if not within_raster(corners):
        raise InputError(
            "raster: a triangle is not finite or over a million pixels away; "
            "use a coarser pitch or clip the mesh to the view"
        )


class HostFragments(NamedTuple):
    """Fragments in any order."""

    pixel: Int[np.ndarray, " k"]
    """row * width + column."""
    depth: Float[np.ndarray, " k"]
    triangle: Int[np.ndarray, " k"]
    entering: Bool[np.ndarray, " k"]
    """True if the ray meets the outer side of the triangle."""


def host_fragments(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
) -> HostFragments:
    """All fragments of triangles with corners `points` (column, row, depth).

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    chunks = [*fragment_chunks(points, faces=faces, width=width, height=height)]
    kinds = np.int64, np.int64, np.float64
    none = tuple(np.empty(0, kind) for kind in kinds)
    triangle, pixel, depth = (
        np.concatenate(part) for part in zip(none, *chunks, strict=True)
    )
    # Of the snapped corners: the side that a sliver shows may be the other one's.
    x, y = (np.rint(points[:, axis] * SNAP) for axis in range(2))
    first, *others = np.ascontiguousarray(faces.T)
    (ux, uy), (vx, vy) = ((x[own] - x[first], y[own] - y[first]) for own in others)
    return HostFragments(
        pixel=pixel,
        depth=depth,
        triangle=triangle,
        entering=(ux * vy - vx * uy < 0)[triangle],
    )


def host_layers(
    fragments: HostFragments, pixel_bits: int
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Permutation that sorts by pixel, then depth, and the layer of each fragment."""
    pixel, depth, triangle, _ = fragments
    # The key of `_sort_fragments`, which explains it.
    bits = min(63 - pixel_bits, 52)
    low = depth.min(initial=np.inf)
    span = depth.max(initial=-np.inf) - low
    fraction = (depth - low) / (span if span > 0 else 1.0)
    key = (pixel << bits) | (fraction * (2.0**bits - 1)).astype(np.int64)
    order = np.argsort(key)
    key = key[order]
    # The fast sort leaves equal keys in any order: by triangle.
    tied = np.flatnonzero(key[1:] == key[:-1])
    if len(tied):
        tied = sorted_union(tied, tied + 1)
        at = order[tied]
        order[tied] = at[np.lexsort((triangle[at], key[tied]))]
    pixel = key >> bits
    begins = np.ones(len(pixel), bool)
    np.not_equal(pixel[1:], pixel[:-1], out=begins[1:])
    first = np.flatnonzero(begins)
    counts = np.diff(np.append(first, len(pixel)))
    return order, np.arange(len(pixel)) - np.repeat(first, counts)


def fragment_chunks(
    points: np.ndarray, faces: np.ndarray, width: int, height: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Triangles, pixels and depths of the fragments of some triangles after others.

    Of triangles with corners `points` (column, row, depth).

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    check_coordinates(points)
    across, down, depth = np.ascontiguousarray(points.T)
    largest = max(np.abs(across).max(initial=0), np.abs(down).max(initial=0))
    kind = np.float64 if largest <= _MAX_EXACT else np.int64
    x, y = (np.rint(each * SNAP).astype(kind) for each in (across, down))
    chosen = _around_centres(x, y=y, faces=faces, width=width, height=height)
    for first in range(0, len(chosen), _CHUNK):
        part = chosen[first : first + _CHUNK]
        corners = np.ascontiguousarray(faces[part].T)
        hit, pixel, key = _fragments(
            x, y=y, depth=depth, corners=corners, width=width, height=height
        )
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
    face, row, left, count = _spans(x, y=y, corners=corners, width=width, height=height)
    span, step = _slots(count)
    hit, row, column = face[span], row[span], left[span] + step
    key = _plane_at(
        x, y=y, depth=depth, corners=corners, face=hit, column=column, row=row
    )
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
    return _Spans(
        face=face,
        row=row,
        left=left,
        count=np.clip(np.maximum(one, other), 0, width) - left,
    )


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
