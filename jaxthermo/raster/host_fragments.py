"""Fragments of triangles and their depth layers by numpy, on the host.

The same as those of the compiled program in `fragments`, depths to their last bit.
Every size of mesh and image takes a program of its own, which is compiled in many times
the time in which numpy is done.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_union


_AT_ONCE = 2**16
"""Number of fragments whose arrays fit into the processor's cache."""


class HostFragments(NamedTuple):
    """Fragments in the order of their triangles, rows and columns."""

    pixel: Int[np.ndarray, " k"]
    """row * width + column."""
    depth: Float[np.ndarray, " k"]
    triangle: Int[np.ndarray, " k"]
    entering: Bool[np.ndarray, " k"]
    """True if the ray meets the outer side of the triangle."""


class _Spans(NamedTuple):
    """Rows of triangles that cover at least one pixel."""

    triangle: Int[np.ndarray, " s"]
    row: Int[np.ndarray, " s"]
    left: Int[np.ndarray, " s"]
    """First column."""
    count: Int[np.ndarray, " s"]


def host_fragments(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int, snap: int
) -> HostFragments:
    """Fragments of triangles (column, row, depth), corners snapped to 1/`snap` pixel.

    Triangles are within the limits that `fragments` checks.
    """
    corners = np.round(triangles[..., :2] * snap).astype(np.int64)
    spans = _spans(corners, width, height, snap)
    depths = triangles[..., 2]
    ends = np.cumsum(spans.count)
    total = int(ends[-1]) if len(ends) else 0
    found = HostFragments(
        np.empty(total, np.int64),
        np.empty(total),
        np.empty(total, np.int64),
        np.empty(total, bool),
    )
    first = done = 0
    while done < total:
        last = max(int(np.searchsorted(ends, done + _AT_ONCE, "right")), first + 1)
        some = _Spans(*(part[first:last] for part in spans))
        made = _of_spans(some, corners, depths, width, snap)
        end = int(ends[last - 1])
        for whole, part in zip(found, made, strict=True):
            whole[done:end] = part
        first, done = last, end
    return found


def host_layers(
    pixel: Int[np.ndarray, " k"], depth: Float[np.ndarray, " k"], pixel_bits: int
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Permutation that sorts by pixel, then depth, and the layer of each fragment."""
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
        order[tied] = order[tied][np.lexsort((order[tied], key[tied]))]
    pixel = key >> bits
    begins = np.ones(len(pixel), bool)
    np.not_equal(pixel[1:], pixel[:-1], out=begins[1:])
    first = np.flatnonzero(begins)
    counts = np.diff(np.append(first, len(pixel)))
    return order, np.arange(len(pixel)) - np.repeat(first, counts)


def _first_centre(snapped: Int[np.ndarray, "*n"], snap: int) -> Int[np.ndarray, "*n"]:
    return -((snap // 2 - snapped) // snap)


def _spans(
    corners: Int[np.ndarray, "f 3 2"], width: int, height: int, snap: int
) -> _Spans:
    y = corners[:, 0, 1], corners[:, 1, 1], corners[:, 2, 1]
    low = np.minimum(np.minimum(y[0], y[1]), y[2])
    high = np.maximum(np.maximum(y[0], y[1]), y[2])
    low, high = (np.clip(_first_centre(end, snap), 0, height) for end in (low, high))
    rows = high - low
    triangle = np.repeat(np.arange(len(rows)), rows)
    row = np.arange(len(triangle)) - np.repeat(np.cumsum(rows) - rows - low, rows)
    left = np.full(len(row), width)
    right = np.zeros(len(row), np.int64)
    centre = row * snap + snap // 2
    for start in range(3):
        edge = _edge(corners, start)
        x_low, y_low, y_high, run = (each[triangle] for each in edge)
        # Half-open: a centre at the height of a vertex belongs to one of two edges.
        at = np.flatnonzero((y_low <= centre) & (centre < y_high))
        x_low, y_low, run = x_low[at], y_low[at], run[at]
        rise = y_high[at] - y_low
        numerator = x_low * rise + (centre[at] - y_low) * run
        column = -((rise * (snap // 2) - numerator) // (rise * snap))
        left[at] = np.minimum(left[at], column)
        right[at] = np.maximum(right[at], column)
    np.maximum(left, 0, out=left)
    count = np.minimum(right, width) - left
    covers = np.flatnonzero(count > 0)
    return _Spans(triangle[covers], row[covers], left[covers], count[covers])


def _edge(corners: Int[np.ndarray, "f 3 2"], start: int) -> tuple[np.ndarray, ...]:
    """Lower end of an edge (column, row), row of the upper one, columns in between."""
    (xa, ya), (xb, yb) = corners[:, start].T, corners[:, (start + 1) % 3].T
    # From the lower to the upper end in either triangle of an edge, so that both
    # divide the same integers.
    swap = ya > yb
    x_low, x_high = np.where(swap, xb, xa), np.where(swap, xa, xb)
    return x_low, np.minimum(ya, yb), np.maximum(ya, yb), x_high - x_low


def _of_spans(
    spans: _Spans,
    corners: Int[np.ndarray, "f 3 2"],
    depths: Float[np.ndarray, "f 3"],
    width: int,
    snap: int,
) -> HostFragments:
    corner, z = corners[spans.triangle], depths[spans.triangle]
    (x0, y0), (x1, y1), (x2, y2) = (corner[:, i].T for i in range(3))
    z0, z1, z2 = z.T
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    dx, dy = spans.left * snap + snap // 2 - x0, spans.row * snap + snap // 2 - y0
    # At the first column; each further one adds the same.
    first1, first2 = dx * (y2 - y0) - dy * (x2 - x0), dy * (x1 - x0) - dx * (y1 - y0)
    step1, step2 = (y2 - y0) * snap, (y0 - y1) * snap
    each = lambda values: np.repeat(values, spans.count)
    offset = np.arange(int(spans.count.sum())) - each(
        np.cumsum(spans.count) - spans.count
    )
    # Integers up to here; only the depth itself is rounded.
    weighted = (each(first1) + offset * each(step1)) * each(z1 - z0)
    weighted += (each(first2) + offset * each(step2)) * each(z2 - z0)
    weighted /= each(np.where(area == 0, 1, area))
    weighted += each(z0)
    # Planes nearly parallel to the ray extrapolate wildly; the corners bound them.
    least, most = np.minimum(np.minimum(z0, z1), z2), np.maximum(np.maximum(z0, z1), z2)
    depth = np.clip(weighted, each(least), each(most))
    pixel = each(spans.row * width + spans.left) + offset
    return HostFragments(pixel, depth, each(spans.triangle), each(area < 0))
