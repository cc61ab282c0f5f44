"""Shadow maps: which part of each fragment a source sees.

The scene's first depth layer as the source sees it, at half a voxel a pixel or finer. A
fragment is sampled at four points of its own square and at each is lit if nothing lies
in front of it. Samples are lifted off the surface along its normal by 3/4 of a pixel:
the depth of a plane varies by less than that across a pixel at any angle, so a surface
never shades itself, and a shadow is displaced by less than half a voxel as the source
sees it. In perspective the same holds with a pixel's size at the fragment's depth.
"""

import numpy as np
from jaxtyping import Float

from ...memory import require_memory
from ...raster.directions import OrthographicView, orthographic_view, view_frame
from ...raster.layers import depth_range
from ...raster.perspective import PerspectiveView, perspective_views


SAMPLE_RADIUS = 0.3
"""Distance of the four samples from the fragment's middle, in voxels."""

LIFT = 0.75
"""Along the normal, in pixels of the map; sqrt(1/2) would just do."""


def _tangents(normal: Float[np.ndarray, "s 3"]) -> tuple[np.ndarray, np.ndarray]:
    helper = np.eye(3)[np.abs(normal).argmin(1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first)


def _check_map(view: OrthographicView | PerspectiveView) -> None:
    require_memory(view.width * view.height * 16, "a shadow map", "use a coarser pitch")


def _unshaded(
    view: OrthographicView | PerspectiveView,
    nearest: Float[np.ndarray, "h w"],
    raised: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of the samples around lifted points with nothing in front of them."""
    lit = np.zeros(len(raised))
    first, second = (t * SAMPLE_RADIUS * pitch for t in _tangents(normal))
    for offset in (first, -first, second, -second):
        sample = view.project(raised + offset)
        column = np.clip(sample[:, 0].astype(int), 0, view.width - 1)
        row = np.clip(sample[:, 1].astype(int), 0, view.height - 1)
        lit += 0.25 * (sample[:, 2] <= nearest[row, column])
    return lit


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
    _check_map(view)
    nearest, _ = depth_range(view.project(triangles), view.width, view.height)
    raised = position[facing] + normal[facing] * LIFT * view.pitch
    lit[facing] = _unshaded(view, nearest, raised, normal[facing], pitch)
    return lit


def lit_share_from(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    eye: Float[np.ndarray, "3"],
    pitch: float,
) -> Float[np.ndarray, " s"]:
    """Share of each surface point's square that rays from one point reach, 0 to 1.

    Args:
        triangles: everything that casts shadows, world [m].
        position: the points [m].
        normal: outward at them.
        eye: where the rays come from [m].
        pitch: edge of the squares [m]; a pixel is half of it or less at each of them.
    """
    lit = np.zeros(len(position))
    facing = np.flatnonzero(np.einsum("ij,ij->i", normal, eye - position) > 0)
    if not len(facing):
        return lit
    for view, chosen in perspective_views(eye, position[facing], pitch / 2):
        _check_map(view)
        nearest = view.nearest(triangles)
        seen = facing[chosen]
        size = view.pixel * view.project(position[seen])[:, 2]
        raised = position[seen] + normal[seen] * (LIFT * size)[:, None]
        lit[seen] = _unshaded(view, nearest, raised, normal[seen], pitch)
    return lit
