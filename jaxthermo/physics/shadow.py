"""Shadow maps: which part of each fragment a directional source sees.

The scene's first depth layer towards the source, at half a voxel a pixel. A fragment is
sampled at four points of its own square and at each is lit if nothing lies in front of
it. Samples are lifted off the surface along its normal by 3/4 of a pixel: the depth of
a plane varies by less than that across a pixel at any angle, so a surface never shades
itself, and a shadow is displaced by less than half a voxel as the source sees it.
"""

import jax
import numpy as np
from jaxtyping import Float

from ..memory import require_memory
from ..raster.directions import OrthographicView, orthographic_view, view_frame


SAMPLE_RADIUS = 0.3
"""Distance of the four samples from the fragment's middle, in voxels."""

LIFT = 0.75
"""Along the normal, in pixels of the map; sqrt(1/2) would just do."""


def first_depth(
    view: OrthographicView, triangles: Float[np.ndarray, "f 3 3"]
) -> Float[np.ndarray, "h w"]:
    """Depth of the nearest surface in each pixel, in pixels; infinite where none is."""
    # Shapes are known while the rest of a scene is traced: shadows are found there too.
    with jax.ensure_compile_time_eval():
        layers = view.peel(triangles)
    return layers.image(0, layers.depth, background=np.inf)


def _tangents(normal: Float[np.ndarray, "s 3"]) -> tuple[np.ndarray, np.ndarray]:
    helper = np.eye(3)[np.abs(normal).argmin(1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first)


def lit_share(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    direction: object,
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of each surface point's square that parallel rays reach, 0 to 1.

    Args:
        triangles: everything that casts shadows, world [m].
        position: the points [m].
        normal: outward at them.
        direction: the way the rays travel.
        pitch: edge of the squares [m]; the map has half of it a pixel.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(normal @ view_frame(direction)[2] < 0)
    if not len(facing):
        return lit
    # Only as large as what may be lit: a vast ground beyond it costs nothing.
    view = orthographic_view(position[facing], direction, pitch / 2)
    require_memory(view.width * view.height * 16, "a shadow map", "use a coarser pitch")
    nearest = first_depth(view, triangles)
    first, second = (t * SAMPLE_RADIUS * pitch for t in _tangents(normal[facing]))
    raised = position[facing] + normal[facing] * LIFT * view.pitch
    for offset in (first, -first, second, -second):
        sample = view.project(raised + offset)
        column = np.clip(sample[:, 0].astype(int), 0, view.width - 1)
        row = np.clip(sample[:, 1].astype(int), 0, view.height - 1)
        lit[facing] += 0.25 * (sample[:, 2] <= nearest[row, column])
    return lit
