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

On a processor without an accelerator numpy does the same faster (`host_fragments`), and
compiles nothing; the program here is for accelerators, and the reference in the tests.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .host_fragments import SNAP, check_coordinates, host_fragments, host_layers


MIN_CAPACITY = 2**14
"""Smallest array size: smaller ones save no time, only compile more programs."""


class _Fragments(NamedTuple):
    """Fragments in fixed-size arrays; slots from `count` on are padding."""

    pixel: Int[Array, " k"]
    """row * width + column; width * height in the padding."""
    depth: Float[Array, " k"]
    triangle: Int[Array, " k"]
    entering: Bool[Array, " k"]
    """True if the ray meets the outer side of the triangle (see `_rasterize`)."""
    count: Int[Array, ""]
    """Number of fragments, larger than the arrays if the capacity was too small."""
    rows_needed: Int[Array, ""]
    """Number of (triangle, row) pairs, against `row_capacity`."""


def _ceil_div(numerator, denominator):
    return -((-numerator) // denominator)


def _first_centre(snapped):
    """Index of the first pixel centre at or after a snapped coordinate."""
    return _ceil_div(snapped - SNAP // 2, SNAP)


def _expand(counts, capacity):
    """Owner of each of `sum(counts)` slots, and the position within its owner."""
    ends = jnp.cumsum(counts)
    owner = jnp.repeat(
        jnp.arange(counts.shape[0]), counts, total_repeat_length=capacity
    )
    slot = jnp.arange(capacity)
    return owner, slot - (ends - counts)[owner], slot < ends[-1], ends[-1]


def _crossings(corners, row):
    """First and last column between the edges of each triangle in a row of centres."""
    # From the lower to the upper end in either triangle of an edge, so that both
    # divide the same integers.
    start, end = corners, jnp.roll(corners, -1, axis=1)
    swap = start[..., 1:] > end[..., 1:]
    low, high = jnp.where(swap, end, start), jnp.where(swap, start, end)
    centre = (row * SNAP + SNAP // 2)[:, None]
    rise = high[..., 1] - low[..., 1]
    # Half-open: a centre at the height of a vertex belongs to one of two edges.
    covers = (low[..., 1] <= centre) & (centre < high[..., 1])
    rise = jnp.where(covers, rise, 1)
    numerator = low[..., 0] * rise + (centre - low[..., 1]) * (
        high[..., 0] - low[..., 0]
    )
    column = _ceil_div(numerator - rise * (SNAP // 2), rise * SNAP)
    far = jnp.iinfo(column.dtype).max
    left = jnp.where(covers, column, far).min(axis=1)
    right = jnp.where(covers, column, -far).max(axis=1)
    return left, right


def _plane_at(corners, depths, row, column):
    """Depth of each triangle's plane at a pixel centre, and twice its signed area."""
    (x0, y0), (x1, y1), (x2, y2) = [
        (corners[:, i, 0], corners[:, i, 1]) for i in range(3)
    ]
    z0, z1, z2 = depths[:, 0], depths[:, 1], depths[:, 2]
    dx, dy = column * SNAP + SNAP // 2 - x0, row * SNAP + SNAP // 2 - y0
    double_area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    w1 = dx * (y2 - y0) - dy * (x2 - x0)
    w2 = dy * (x1 - x0) - dx * (y1 - y0)
    # Integers up to here; only the depth itself is rounded.
    weighted = w1.astype(z0.dtype) * (z1 - z0) + w2.astype(z0.dtype) * (z2 - z0)
    depth = z0 + weighted / jnp.where(double_area == 0, 1, double_area).astype(z0.dtype)
    # Planes nearly parallel to the ray extrapolate wildly; the corners bound them.
    return jnp.clip(depth, depths.min(axis=1), depths.max(axis=1)), double_area


@partial(jax.jit, static_argnames=("row_capacity", "capacity"))
def _rasterize_fixed(
    triangles: Float[Array, "f 3 3"],
    width: int | Int[Array, ""],
    height: int | Int[Array, ""],
    *,
    row_capacity: int,
    capacity: int,
) -> _Fragments:
    """Compute the fragments of triangles (column, row, depth) in arrays of fixed size.

    If `count > capacity` or `rows_needed > row_capacity` the result is incomplete and
    the caller must call again with more.
    """
    # int64 needs x64 mode, which the caller must have enabled.
    corners = jnp.round(triangles[..., :2] * SNAP).astype(jnp.int64)
    low = jnp.clip(_first_centre(corners[..., 1].min(axis=1)), 0, height)
    high = jnp.clip(_first_centre(corners[..., 1].max(axis=1)), 0, height)
    owner, step, real, rows_needed = _expand(high - low, row_capacity)
    row = low[owner] + step
    left, right = _crossings(corners[owner], row)
    left, right = jnp.clip(left, 0, width), jnp.clip(right, 0, width)
    spans = jnp.where(real, jnp.maximum(right - left, 0), 0)
    span, offset, valid, count = _expand(spans, capacity)
    triangle, column, line = owner[span], left[span] + offset, row[span]
    depth, area = _plane_at(
        corners[triangle], depths=triangles[triangle, :, 2], row=line, column=column
    )
    return _Fragments(
        pixel=jnp.where(valid, line * width + column, width * height),
        depth=depth,
        triangle=triangle,
        entering=area < 0,
        count=count,
        rows_needed=rows_needed,
    )


def _rounded_up(number: float | int) -> int:
    """Round up to 2^n or 3/4 2^n, so that few array sizes and programs occur."""
    power = 2 ** int(np.ceil(np.log2(max(number, 1024.0))))
    return int(0.75 * power) if number <= 0.75 * power else power


def capacities(
    triangles: Float[np.ndarray, "f 3 3"], width: int, height: int
) -> tuple[int, int]:
    """Array sizes sufficient for all rows and very likely for all fragments."""
    # Corner by corner: numpy is slow at the minimum along an axis of length three.
    x, y = (tuple(triangles[:, corner, i] for corner in range(3)) for i in range(2))
    least = lambda c: np.minimum(np.minimum(c[0], c[1]), c[2])
    most = lambda c: np.maximum(np.maximum(c[0], c[1]), c[2])
    bottom, top = np.clip(least(y), 0, height), np.clip(most(y), 0, height)
    # Snapping can move an end beyond one more centre.
    slack = 1 / SNAP
    rows = (np.ceil(top - 0.5 + slack) - np.ceil(bottom - 0.5 - slack)).sum()
    left, right = np.clip(least(x), 0, width), np.clip(most(x), 0, width)
    area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    area = 0.5 * np.abs(area)
    # A triangle has about as many fragments as pixels of area; the margin covers the
    # scatter of that count.
    covered = np.minimum(area, (right - left) * (top - bottom)).sum()
    return _rounded_up(rows), _rounded_up(1.05 * covered + 8 * np.sqrt(covered) + 256)


def shared_capacities(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int,
    height: int,
    minimum: tuple[int, int] = (MIN_CAPACITY, MIN_CAPACITY),
) -> tuple[int, int]:
    """`capacities`, at least `minimum`, so that most views share one program."""
    rows, fragments = capacities(triangles, width, height)
    return max(rows, minimum[0]), max(fragments, minimum[1])


def _padded(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "k 3 3"]:
    # Triangles without area cover no pixel: views and meshes share one program.
    size = _rounded_up(max(len(triangles), MIN_CAPACITY))
    return np.concatenate([triangles, np.zeros((size - len(triangles), 3, 3))])


def _rasterize(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int,
    height: int,
    sizes: tuple[int, int] | None = None,
) -> _Fragments:
    """Compute the fragments of triangles (column, row, depth), in arrays of any size.

    A fragment is `entering` if its triangle's corners turn counter-clockwise on an
    image with rows downwards: for triangles wound counter-clockwise seen from outside
    and a right-handed view (right, down, forward), the ray enters the body there.
    `sizes` are initial (row, fragment) capacities, to share a compiled program.

    Raises:
        InputError: if a corner is not finite or more than 2^20 pixels away.
    """
    check_coordinates(triangles)
    row_capacity, capacity = sizes or shared_capacities(triangles, width, height)
    with jax.enable_x64(True):
        corners = jnp.asarray(_padded(triangles), jnp.float64)
        while True:
            fragments = _rasterize_fixed(
                corners,
                width,
                height,
                row_capacity=row_capacity,
                capacity=capacity,
            )
            rows, count = int(fragments.rows_needed), int(fragments.count)
            if rows <= row_capacity and count <= capacity:
                return fragments
            row_capacity = max(row_capacity, _rounded_up(rows))
            capacity = max(capacity, _rounded_up(count))


@dataclass(frozen=True)
class DepthLayers:
    """Fragments sorted by pixel, then depth; `layer` counts from 0 at the front."""

    pixel: Int[np.ndarray, " k"]
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
        chosen = self.layer == layer
        shape = (self.height * self.width, *values.shape[1:])
        flat = np.full(shape, background, values.dtype)
        flat[self.pixel[chosen]] = values[chosen]
        return flat.reshape(self.height, self.width, *values.shape[1:])


def _depth_steps(depth, bits):
    low = depth.min()
    span = depth.max() - low
    fraction = (depth - low) / jnp.where(span > 0, span, 1.0)
    return (fraction * (2.0**bits - 1)).astype(jnp.int64)


@jax.jit
def _sort_fragments(
    fragments: _Fragments, pixel_bits: int | Int[Array, ""]
) -> tuple[Int[Array, " k"], Int[Array, " k"]]:
    """Permutation that sorts by pixel, then depth, and the layer of each fragment."""
    # Pixel and depth share one 64-bit key (x64 mode must be on), which resolves depths
    # to 2^-40 of their range in an image of eight million pixels.
    # More bits than a float64 holds would round up into the pixel's.
    depth_bits = jnp.minimum(63 - pixel_bits, 52)
    key = fragments.pixel.astype(jnp.int64) << depth_bits
    key |= _depth_steps(fragments.depth, depth_bits)
    slots = jnp.arange(key.shape[0], dtype=jnp.int32)
    key, order = jax.lax.sort((key, slots), num_keys=1, is_stable=True)
    pixel = key >> depth_bits
    first = jnp.concatenate([jnp.ones(1, bool), pixel[1:] != pixel[:-1]])
    start = jax.lax.cummax(jnp.where(first, slots, 0))
    return order, slots - start


def peel(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int,
    height: int,
    sizes: tuple[int, int] | None = None,
) -> DepthLayers:
    """All depth layers of triangles given as (column, row, depth) [pixels]."""
    if _on_host():
        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        return _peel_on_host(
            triangles.reshape(-1, 3), faces=faces, width=width, height=height
        )
    fragments = _rasterize(triangles, width=width, height=height, sizes=sizes)
    with jax.enable_x64(True):
        # Padding has pixel width * height: it sorts behind all fragments.
        sorted_by = _sort_fragments(fragments, int(width * height).bit_length())
    count = int(fragments.count)
    order, layer = (np.asarray(each)[:count] for each in sorted_by)
    return _sorted_layers(
        fragments, order=order, layer=layer, width=width, height=height
    )


def peel_views(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    views: Sequence[tuple[tuple[int, int, int], int, int]],
) -> list[DepthLayers]:
    """Depth layers of triangles in several views along axes of their corners.

    A view is the axes of its columns, rows and depth, its width and its height.
    """
    frames = ((points[:, axes], width, height) for axes, width, height in views)
    if _on_host():
        return [_peel_on_host(own, faces, *size) for own, *size in frames]
    every = [(own[faces], width, height) for own, width, height in frames]
    # One array size for all views: one program is compiled.
    sizes = [shared_capacities(*view) for view in every]
    rows, fragments = (max(size) for size in zip(*sizes, strict=True))
    return [peel(*view, (rows, fragments)) for view in every]


def _peel_on_host(
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    width: int,
    height: int,
) -> DepthLayers:
    found = host_fragments(points, faces=faces, width=width, height=height)
    order, layer = host_layers(found, int(width * height).bit_length())
    return _sorted_layers(found, order=order, layer=layer, width=width, height=height)


def _sorted_layers(
    found: Any, order: np.ndarray, layer: np.ndarray, width: int, height: int
) -> DepthLayers:
    take = lambda array, kind: np.asarray(array).astype(kind, copy=False)[order]
    return DepthLayers(
        pixel=take(found.pixel, np.int64),
        depth=take(found.depth, np.float64),
        triangle=take(found.triangle, np.int64),
        entering=take(found.entering, np.bool_),
        layer=layer.astype(np.int64, copy=False),
        width=width,
        height=height,
    )


def _on_host() -> bool:
    """True without an accelerator; what is compiled would run on the processor too."""
    return jax.default_backend() == "cpu"
