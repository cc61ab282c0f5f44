"""Depth layers of triangles by one sort of their fragments, and their depth range.

The thesis (4.1, after Everitt 2001) renders one layer per pass, each discarding what
the passes before it have drawn. Sorting by (pixel, depth) gives all layers at once: the
layer of a fragment is its rank within its pixel.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .fragments import Fragments, padded, rasterize, shared_capacities


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
    """Quantize `depth` to integers of `bits` bits that span its range."""
    low = depth.min()
    span = depth.max() - low
    fraction = (depth - low) / jnp.where(span > 0, span, 1.0)
    return (fraction * (2.0**bits - 1)).astype(jnp.int64)


@jax.jit
def sort_fragments(
    fragments: Fragments, pixel_bits: int | Int[Array, ""]
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
    fragments = rasterize(triangles, width, height, sizes)
    with jax.enable_x64(True):
        # Padding has pixel width * height: it sorts behind all fragments.
        order, layer = sort_fragments(fragments, int(width * height).bit_length())
    count = int(fragments.count)
    order = np.asarray(order)[:count]
    take = lambda array, kind: np.asarray(array).astype(kind, copy=False)[order]
    return DepthLayers(
        pixel=take(fragments.pixel, np.int64),
        depth=take(fragments.depth, np.float64),
        triangle=take(fragments.triangle, np.int64),
        entering=take(fragments.entering, np.bool_),
        layer=np.asarray(layer)[:count].astype(np.int64),
        width=width,
        height=height,
    )


def depth_range(
    triangles: Float[np.ndarray, "f 3 3"],
    width: int,
    height: int,
    sizes: tuple[int, int] | None = None,
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Nearest and farthest depth of triangles given as (column, row, depth).

    Empty pixels have the depths inf and -inf. Arguments as for `rasterize`. May be
    called while something else is traced.
    """
    sizes = sizes or shared_capacities(triangles, width, height)
    with jax.ensure_compile_time_eval():
        fragments = rasterize(padded(triangles), width, height, sizes)
    count = int(fragments.count)
    pixel = np.asarray(fragments.pixel)[:count]
    depth = np.asarray(fragments.depth)[:count]
    # No sort: the layers in between are not needed.
    nearest = np.full(width * height, np.inf)
    farthest = np.full(width * height, -np.inf)
    np.minimum.at(nearest, pixel, depth)
    np.maximum.at(farthest, pixel, depth)
    return nearest.reshape(height, width), farthest.reshape(height, width)
