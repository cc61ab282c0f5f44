"""Fragments: the pixels whose centres lie inside each triangle; their depth layers.

Coordinates are pixels: the centre of pixel (row, column) is (row + 1/2, column + 1/2).
In each row a triangle covers the pixels between the two columns at which its edges
cross the line of pixel centres. Corners are snapped to 1/1024 pixel and compared in
integers, half-open on the right and above, so that two triangles with a common edge
agree on the owner of a pixel on it: no fragment is lost or doubled, and every ray
crosses a watertight mesh an even number of times.

The thesis (4.1, after Everitt 2001) renders one depth layer per pass, each discarding
what the passes before it have drawn. Sorting by (pixel, depth) gives all layers at
once: the layer of a fragment is its rank within its pixel.
"""

from collections.abc import Iterator
from dataclasses import dataclass
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
# next integer. Processors have vector instructions for float64 quotients.
_MAX_EXACT = 2**15

# Triangles that are drawn together: temporaries stay in the cache, and the allocator
# keeps them instead of returning them.
_CHUNK = 4096


@dataclass(frozen=True)
class DepthLayers:
    """Fragments sorted by pixel, then depth; `layer` counts from 0 at the front."""

    pixel: Int[np.ndarray, " k"]
    """row * width + column."""
    depth: Float[np.ndarray, " k"]
    triangle: Int[np.ndarray, " k"]
    entering: Bool[np.ndarray, " k"]
    """True if the ray meets the outer side of the triangle, in a right-handed view."""
    layer: Int[np.ndarray, " k"]
    width: int
    height: int

    @property
    def count(self) -> int:
        """Number of layers."""
        return int(self.layer.max()) + 1 if len(self.layer) else 0

    def image(self, layer: int, values: np.ndarray, background: Any = 0) -> np.ndarray:
        """Draw one layer of per-fragment `values` as an image [height, width, ...]."""
        in_layer = self.layer == layer
        shape = (self.height * self.width, *values.shape[1:])
        flat = np.full(shape, background, values.dtype)
        flat[self.pixel[in_layer]] = values[in_layer]
        return flat.reshape(self.height, self.width, *values.shape[1:])


def peel(triangles: Float[np.ndarray, "f 3 3"], width: int, height: int) -> DepthLayers:
    """All depth layers of triangles given as (column, row, depth) [pixels].

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    points = triangles.reshape(-1, 3)
    return peel_mesh(points, faces=faces, width=width, height=height)


def peel_mesh(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
) -> DepthLayers:
    """All depth layers of triangles with corners `points` (column, row, depth).

    A fragment is `entering` if its triangle's corners turn counter-clockwise on an
    image with rows downwards: for triangles wound counter-clockwise seen from outside
    and a right-handed view (right, down, forward), the ray enters the body there.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    triangle, pixel, depth = _all_fragments(
        points, faces=faces, width=width, height=height
    )
    order, layer = _sorted_layers(
        triangle, pixel=pixel, depth=depth, pixel_bits=(width * height).bit_length()
    )
    triangle = triangle[order]
    return DepthLayers(
        pixel=pixel[order],
        depth=depth[order],
        triangle=triangle,
        entering=_turns_to_viewer(points, faces)[triangle],
        layer=layer,
        width=width,
        height=height,
    )


def _all_fragments(
    points: np.ndarray, faces: np.ndarray, width: int, height: int
) -> "FragmentChunk":
    # A function of its own, so that the chunks are freed before the sort.
    chunks = [*fragment_chunks(points, faces=faces, width=width, height=height)]
    no_integers = np.empty(0, np.int64)
    no_depths = np.empty(0)
    triangles = [chunk.triangle for chunk in chunks]
    pixels = [chunk.pixel for chunk in chunks]
    depths = [chunk.depth for chunk in chunks]
    return FragmentChunk(
        triangle=np.concatenate([no_integers, *triangles]),
        pixel=np.concatenate([no_integers, *pixels]),
        depth=np.concatenate([no_depths, *depths]),
    )


def _turns_to_viewer(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " f"]:
    # By the snapped corners: they may show the other side of a sliver.
    x = np.rint(points[:, 0] * SNAP)
    y = np.rint(points[:, 1] * SNAP)
    a, b, c = np.ascontiguousarray(faces.T)
    across_to_b = x[b] - x[a]
    down_to_b = y[b] - y[a]
    across_to_c = x[c] - x[a]
    down_to_c = y[c] - y[a]
    doubled_area = across_to_b * down_to_c - across_to_c * down_to_b
    return doubled_area < 0


def _sorted_layers(
    triangle: Int[np.ndarray, " k"],
    pixel: Int[np.ndarray, " k"],
    depth: Float[np.ndarray, " k"],
    pixel_bits: int,
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Permutation that sorts by pixel, then depth, and the layer of each fragment."""
    # Pixel and depth share one 64-bit key, which resolves depths to 2^-40 of their
    # range in an image of eight million pixels. More bits than a float64 holds would
    # round up into those of the pixel.
    bits = min(63 - pixel_bits, 52)
    low = depth.min(initial=np.inf)
    span = depth.max(initial=-np.inf) - low
    scale = span if span > 0 else 1.0
    fraction = (depth - low) / scale
    key = (pixel << bits) | (fraction * (2.0**bits - 1)).astype(np.int64)
    order = np.argsort(key)
    key = key[order]
    # The fast sort leaves equal keys in any order: by triangle.
    tied = np.flatnonzero(key[1:] == key[:-1])
    if len(tied):
        tied = sorted_union(tied, tied + 1)
        fragment = order[tied]
        by_triangle = np.lexsort((triangle[fragment], key[tied]))
        order[tied] = fragment[by_triangle]
    sorted_pixel = key >> bits
    begins = np.ones(len(sorted_pixel), bool)
    np.not_equal(sorted_pixel[1:], sorted_pixel[:-1], out=begins[1:])
    first = np.flatnonzero(begins)
    bounds = np.append(first, len(sorted_pixel))
    counts = np.diff(bounds)
    front = np.repeat(first, counts)
    layer = np.arange(len(sorted_pixel)) - front
    return order, layer


def expected_fragments(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int
) -> float:
    """Number of fragments of triangles (column, row, depth), from their areas."""
    # A triangle has about as many fragments as pixels of area within the image.
    x, y, _ = np.moveaxis(triangles, 2, 0)
    visible_width = np.ptp(np.clip(x, 0, width), axis=1)
    visible_height = np.ptp(np.clip(y, 0, height), axis=1)
    visible_box = visible_width * visible_height
    x0, x1, x2 = x.T
    y0, y1, y2 = y.T
    doubled_area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    area = 0.5 * np.abs(doubled_area)
    return float(np.minimum(area, visible_box).sum())


def within_raster(corners: Float[np.ndarray, "*n 3"]) -> bool:
    """True if no product of corners (column, row, depth) can overflow."""
    lowest = corners.min(initial=0)
    highest = corners.max(initial=0)
    ends = (lowest, highest)
    # Most often the bounds of all numbers suffice, which are quick to compute.
    if np.abs(ends).max() <= _MAX_COORDINATE:
        return True
    in_image = corners[..., :2]
    farthest = np.abs(in_image).max(initial=0)
    is_finite = np.isfinite(ends).all()
    return bool(is_finite and farthest <= _MAX_COORDINATE)


class SomePixels(NamedTuple):
    """Some pixels of an image, as row * width + column."""

    pixel: Int[np.ndarray, " p"]
    """Each once, ascending."""
    before: Int[np.ndarray, " n"]
    """Number of them before each pixel of the image, and in all of it."""

    @classmethod
    def of(cls, pixel: Int[np.ndarray, " k"], size: int) -> "SomePixels":
        """Pixels of an image of so many, in any order and perhaps several times."""
        is_one = np.zeros(size, bool)
        is_one[pixel] = True
        before = np.zeros(size + 1, np.int32)
        np.cumsum(is_one, out=before[1:])
        return cls(pixel=np.flatnonzero(is_one), before=before)


class FragmentChunk(NamedTuple):
    """Fragments of some triangles, in any order."""

    triangle: Int[np.ndarray, " k"]
    pixel: Int[np.ndarray, " k"]
    """row * width + column."""
    depth: Float[np.ndarray, " k"]


def fragment_chunks(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
    within: SomePixels | None = None,
) -> Iterator[FragmentChunk]:
    """Fragments of triangles with corners `points` (column, row, depth), in chunks.

    Those in some pixels alone if `within` is not None: the others cost nothing.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    if not within_raster(points):
        raise InputError(
            "raster: a triangle is not finite or over a million pixels away; "
            "use a coarser pitch or clip the mesh to the view"
        )
    across, down, depth = np.ascontiguousarray(points.T)
    farthest_across = np.abs(across).max(initial=0)
    farthest_down = np.abs(down).max(initial=0)
    largest = max(farthest_across, farthest_down)
    dtype = np.float64 if largest <= _MAX_EXACT else np.int64
    x = np.rint(across * SNAP).astype(dtype)
    y = np.rint(down * SNAP).astype(dtype)
    near_centres = _around_centres(x, y=y, faces=faces, width=width, height=height)
    for first in range(0, len(near_centres), _CHUNK):
        chunk = near_centres[first : first + _CHUNK]
        corners = np.ascontiguousarray(faces[chunk].T)
        spans = _spans(x, y=y, corners=corners, width=width, height=height)
        first_pixel = spans.row * width + spans.left
        if within is None:
            span, step = _slots(spans.count)
            pixel = first_pixel[span] + step
        else:
            start = within.before[first_pixel]
            stop = within.before[first_pixel + spans.count]
            span, step = _slots(stop - start)
            pixel = within.pixel[start[span] + step]
        face = spans.face[span]
        row = spans.row[span]
        column = pixel - row * width
        plane_depth = _plane_at(
            x, y=y, depth=depth, corners=corners, face=face, column=column, row=row
        )
        yield FragmentChunk(triangle=chunk[face], pixel=pixel, depth=plane_depth)


def _slots(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Owners of `count` slots each, and the numbers of the slots within their owner."""
    full = np.flatnonzero(count)
    ends = np.cumsum(count[full])
    total = int(ends[-1]) if len(full) else 0
    # The owner as a running sum of steps, instead of a call for each run of slots.
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
    for coordinate, size in ((x, width), (y, height)):
        centre = _first_centre(coordinate, size)
        a, b, c = centre[faces.T]
        low, high = _ends(a, b, c)
        inside &= low < high
    return np.flatnonzero(inside)


def _ends(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of three arrays."""
    # Pair by pair: numpy is slow at the minimum along an axis of length three.
    low = np.minimum(np.minimum(a, b), c)
    high = np.maximum(np.maximum(a, b), c)
    return low, high


class _Spans(NamedTuple):
    """Runs of pixels that a triangle covers in one row."""

    face: Int[np.ndarray, " r"]
    row: Int[np.ndarray, " r"]
    left: Int[np.ndarray, " r"]
    """First column."""
    count: Int[np.ndarray, " r"]
    """Number of pixels."""


def _spans(
    x: np.ndarray, y: np.ndarray, corners: np.ndarray, width: int, height: int
) -> _Spans:
    # Below and above the middle corner two edges cross a row, one of them the longest.
    # Each edge starts at its lower end, so that both of its triangles divide the same
    # integers.
    bottom, middle, top = _by_height(x[corners], y[corners])
    low = _first_centre(bottom.y, height)
    split = _first_centre(middle.y, height)
    high = _first_centre(top.y, height)
    rows_below = split - low
    rows_above = high - split
    half, step = _slots(np.append(rows_below, rows_above))
    count = len(low)
    face = np.where(half < count, half, half - count)
    first_row = np.append(low, split)
    row = first_row[half] + step
    centre = (row * SNAP + SNAP // 2).astype(x.dtype)
    long_edge = _line(bottom, top)
    long_crossing = _crossing(long_edge, edge=face, centre=centre)
    lower = _line(bottom, middle)
    upper = _line(middle, top)
    short_edge = _Line(
        slope=np.append(lower.slope, upper.slope),
        offset=np.append(lower.offset, upper.offset),
        scale=np.append(lower.scale, upper.scale),
    )
    short_crossing = _crossing(short_edge, edge=half, centre=centre)
    left_crossing = np.minimum(long_crossing, short_crossing)
    right_crossing = np.maximum(long_crossing, short_crossing)
    left = np.clip(left_crossing, 0, width)
    right = np.clip(right_crossing, 0, width)
    return _Spans(face=face, row=row, left=left, count=right - left)


class _Corner(NamedTuple):
    """One corner of each triangle, in steps."""

    x: np.ndarray
    y: np.ndarray


def _by_height(x: np.ndarray, y: np.ndarray) -> list[_Corner]:
    """The corners of triangles [3, k] with the lowest y first."""
    corners = [_Corner(*corner) for corner in zip(x, y, strict=True)]
    for i, j in ((0, 1), (1, 2), (0, 1)):
        a = corners[i]
        b = corners[j]
        is_above = a.y > b.y
        corners[i] = _Corner(
            x=np.where(is_above, b.x, a.x),
            y=np.minimum(a.y, b.y),
        )
        corners[j] = _Corner(
            x=np.where(is_above, a.x, b.x),
            y=np.maximum(a.y, b.y),
        )
    return corners


class _Line(NamedTuple):
    """Edges of triangles: x = (y slope + offset) / scale, in pixels and steps."""

    slope: np.ndarray
    offset: np.ndarray
    scale: np.ndarray


def _line(low: _Corner, high: _Corner) -> _Line:
    run = high.x - low.x
    rise = high.y - low.y
    offset = low.x * rise - low.y * run - rise * (SNAP // 2)
    return _Line(slope=run, offset=offset, scale=rise * SNAP)


def _crossing(
    line: _Line, edge: Int[np.ndarray, " r"], centre: np.ndarray
) -> Int[np.ndarray, " r"]:
    """First column at or after edges in rows of centres, which they cross."""
    numerator = centre * line.slope[edge] + line.offset[edge]
    scale = line.scale[edge]
    if numerator.dtype != np.float64:
        return -(-numerator // scale)
    # Rounded up to an integer without the pass of `np.ceil`.
    quotient = numerator / scale
    truncated = quotient.astype(np.int64)
    return truncated + (quotient > truncated)


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
    x0, x1, x2 = x[corners]
    y0, y1, y2 = y[corners]
    z0, z1, z2 = depth[corners]
    ux = x1 - x0
    uy = y1 - y0
    vx = x2 - x0
    vy = y2 - y0
    low, high = _ends(z0, z1, z2)
    dx = column * SNAP + SNAP // 2 - x0[face]
    dy = row * SNAP + SNAP // 2 - y0[face]
    # Integers up to here; only the depth itself is rounded.
    weight_1 = dx * vy[face] - dy * vx[face]
    weight_2 = dy * ux[face] - dx * uy[face]
    rise = weight_1 * (z1 - z0)[face] + weight_2 * (z2 - z0)[face]
    plane = z0[face] + rise / (ux * vy - vx * uy)[face]
    # Planes nearly parallel to the ray extrapolate wildly; the corners bound them.
    return np.minimum(np.maximum(plane, low[face]), high[face])
