"""Depth peeling without passes: one sort of all fragments by (pixel, depth).

The thesis (4.1, after Everitt 2001) renders again and again, each pass discarding what
the passes before it have seen, until an occlusion query counts nothing. Sorting gives
every pass at once: the rank of a fragment within its pixel is its layer, and the layers
end where the fragments do.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .fragments import Fragments, padded, rasterize, shared_room


@dataclass(frozen=True)
class DepthLayers:
    """Fragments in order of pixel, then depth; `layer` counts from 0 at the front."""

    pixel: Int[np.ndarray, " k"]
    depth: Float[np.ndarray, " k"]
    triangle: Int[np.ndarray, " k"]
    entering: Bool[np.ndarray, " k"]
    """Whether the ray meets the outer side of the triangle, in a right-handed view."""
    layer: Int[np.ndarray, " k"]
    width: int
    height: int

    @property
    def count(self) -> int:
        """How many layers there are."""
        return int(self.layer.max()) + 1 if len(self.layer) else 0

    def image(self, layer: int, values: np.ndarray, background: Any = 0) -> np.ndarray:
        """One layer of per-fragment `values` as an image [height, width, ...]."""
        chosen = self.layer == layer
        shape = (self.height * self.width, *values.shape[1:])
        flat = np.full(shape, background, values.dtype)
        flat[self.pixel[chosen]] = values[chosen]
        return flat.reshape(self.height, self.width, *values.shape[1:])


def _depth_steps(depth, bits):
    """`depth` as integers of `bits` bits that span its range."""
    low = depth.min()
    span = depth.max() - low
    share = (depth - low) / jnp.where(span > 0, span, 1.0)
    return (share * (2.0**bits - 1)).astype(jnp.int64)


@jax.jit
def sort_fragments(
    fragments: Fragments, pixel_bits: int | Int[Array, ""]
) -> tuple[Int[Array, " k"], Int[Array, " k"]]:
    """Order of the fragments by pixel, then depth, and the layer of each in it.

    Must be traced where 64-bit types are enabled: pixel and depth share one key, which
    tells depths apart to 2^-40 of their range in an image of eight million pixels.
    """
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
    """All depth layers of triangles given as (column, row, depth) in pixels."""
    fragments = rasterize(triangles, width, height, sizes)
    with jax.enable_x64(True):
        # The padding's pixel is width * height.
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

    Where nothing is, the nearest is infinite and the farthest minus infinite. May be
    called while something else is traced.

    Args:
        triangles: in pixels and any unit of depth.
        width: columns of the image.
        height: rows of the image.
        sizes: capacities to start with, as for `rasterize`.
    """
    sizes = sizes or shared_room(triangles, width, height)
    with jax.ensure_compile_time_eval():
        fragments = rasterize(padded(triangles), width, height, sizes)
    count = int(fragments.count)
    pixel = np.asarray(fragments.pixel)[:count]
    depth = np.asarray(fragments.depth)[:count]
    nearest = np.full(width * height, np.inf)
    farthest = np.full(width * height, -np.inf)
    np.minimum.at(nearest, pixel, depth)
    np.maximum.at(farthest, pixel, depth)
    return nearest.reshape(height, width), farthest.reshape(height, width)
