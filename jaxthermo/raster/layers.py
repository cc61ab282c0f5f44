"""Depth peeling without passes: one sort of all fragments by (pixel, depth).

The thesis (4.1, after Everitt 2001) renders again and again, each pass discarding what
the passes before it have seen, until an occlusion query counts nothing. Sorting gives
every pass at once: the rank of a fragment within its pixel is its layer, and the layers
end where the fragments do.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .fragments import Fragments, rasterize


@dataclass(frozen=True)
class DepthLayers:
    """Fragments in order of pixel, then depth; `layer` counts from 0 at the front."""

    pixel: Int[np.ndarray, " k"]
    depth: Float[np.ndarray, " k"]
    triangle: Int[np.ndarray, " k"]
    layer: Int[np.ndarray, " k"]
    width: int
    height: int

    @property
    def count(self) -> int:
        """How many layers there are."""
        return int(self.layer.max()) + 1 if len(self.layer) else 0

    def image(self, layer: int, values: np.ndarray, background=0) -> np.ndarray:
        """One layer of per-fragment `values` as an image [height, width, ...]."""
        chosen = self.layer == layer
        shape = (self.height * self.width, *values.shape[1:])
        flat = np.full(shape, background, values.dtype)
        flat[self.pixel[chosen]] = values[chosen]
        return flat.reshape(self.height, self.width, *values.shape[1:])


def _ordered_bits(depth):
    """Integers in the order of the float32 `depth`, for use in a packed sort key."""
    bits = jax.lax.bitcast_convert_type(depth.astype(jnp.float32), jnp.int32)
    ordered = jnp.where(bits < 0, jnp.iinfo(jnp.int32).min - bits, bits)
    return ordered.astype(jnp.int64) - jnp.iinfo(jnp.int32).min


@jax.jit
def sort_fragments(
    fragments: Fragments,
) -> tuple[Int[Array, " k"], Int[Array, " k"]]:
    """Order of the fragments by pixel, then depth, and the layer of each in it.

    Must be traced where 64-bit types are enabled: pixel and depth share one key.
    """
    key = (fragments.pixel.astype(jnp.int64) << 32) | _ordered_bits(fragments.depth)
    slots = jnp.arange(key.shape[0], dtype=jnp.int32)
    key, order = jax.lax.sort((key, slots), num_keys=1, is_stable=True)
    pixel = key >> 32
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
        order, layer = sort_fragments(fragments)
    count = int(fragments.count)
    order = np.asarray(order)[:count]
    take = lambda array, kind: np.asarray(array).astype(kind, copy=False)[order]
    return DepthLayers(
        pixel=take(fragments.pixel, np.int64),
        depth=take(fragments.depth, np.float64),
        triangle=take(fragments.triangle, np.int64),
        layer=np.asarray(layer)[:count].astype(np.int64),
        width=width,
        height=height,
    )
