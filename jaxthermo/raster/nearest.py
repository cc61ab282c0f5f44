"""The first and the last depth in each pixel, without sorting what lies between."""

import jax
import numpy as np
from jaxtyping import Float

from .fragments import padded, rasterize, shared_room


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
