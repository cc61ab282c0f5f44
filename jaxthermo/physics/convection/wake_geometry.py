"""Objects upstream of surface points, by rays along the wind and by silhouettes."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ...geometry.mesh import part_labels
from ...geometry.vectors import triangle_normals
from ...host_memory import require_memory
from ...memo.stored import stored_search
from ...raster.fragments import DepthLayers
from ...raster.views import OrthographicView, orthographic_view, pixels_at


# Offsets (row, column) to a pixel itself and to its neighbours, nearest first.
_NEIGHBOURS = sorted(
    ((down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)),
    key=lambda offset: offset[0] ** 2 + offset[1] ** 2,
)


class Wakes(NamedTuple):
    """Objects upstream of surface points."""

    behind: Float[np.ndarray, " s"]
    """Distance x / D behind the object [-]; infinite without one."""
    diameter: Float[np.ndarray, " s"]
    """D of the object [m]; 0 without one."""


@stored_search("wakes", (Wakes,))
def upstream_wakes(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    direction: Float[np.ndarray, "3"],
    pitch: float,
) -> Wakes:
    """Objects upstream of surface points, and the distances to them.

    Triangles are the closed surfaces of all objects and contain the points, in the
    world [m]. The wind blows along the unit vector `direction`; rays are `pitch` [m]
    apart.
    """
    view, layers = _seen_along(triangles, direction, pitch)
    # The last point upstream on the ray through a fragment where the wind left another
    # object is the rear of that object. A connected part of the mesh is one object: its
    # own wake is in the correlation for a cylinder already.
    objects = _objects(triangles)
    layer_object = objects[layers.triangle]
    diameter = _silhouettes(triangles, objects, view.frame).width / view.pitch
    pixel, depth = _pixels(view, position)
    point_object = _point_objects(
        layers, layer_object=layer_object, pixel=pixel, depth=depth
    )
    behind = np.full(len(position), np.inf)
    width = np.zeros(len(position))
    for number in np.unique(point_object):
        points = np.flatnonzero(point_object == number)
        rear = np.flatnonzero(~layers.entering & (layer_object != number))
        for offset in _NEIGHBOURS:
            # A wake is at least as wide as its object: one more pixel around.
            points = points[np.isinf(behind[points])]
            near = _shifted(layers, pixel[points], offset)
            last = _last_before(layers, subset=rear, pixel=near, depth=depth[points])
            hit = last >= 0
            rear_layer = rear[last[hit]]
            gap = depth[points[hit]] - layers.depth[rear_layer]
            behind[points[hit]] = gap / diameter[layer_object[rear_layer]]
            width[points[hit]] = diameter[layer_object[rear_layer]] * view.pitch
    return Wakes(behind, width)


def _seen_along(
    triangles: Float[np.ndarray, "f 3 3"],
    direction: Float[np.ndarray, "3"],
    pitch: float,
) -> tuple[OrthographicView, DepthLayers]:
    view = orthographic_view(triangles, direction, pitch)
    require_memory(view.width * view.height * 16, "a wake", "use a coarser pitch")
    # The geometry is computed at once, even while the scene is traced.
    with jax.ensure_compile_time_eval():
        return view, view.peel(triangles)


def _pixels(
    view: OrthographicView, position: Float[np.ndarray, "s 3"]
) -> tuple[Int[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Pixel and depth of points in a view."""
    seen = view.project(position)
    row, column = pixels_at(view, seen)
    return row * view.width + column, seen[:, 2]


def _objects(triangles: Float[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " f"]:
    """Object number of each triangle; corners at equal positions connect triangles."""
    corners = triangles.reshape(-1, 3)
    _, vertex = np.unique(corners, axis=0, return_inverse=True)
    return part_labels(vertex.reshape(-1, 3))


class _Silhouettes(NamedTuple):
    """Rectangles with the second moments of objects as the wind sees them."""

    centre: Float[np.ndarray, "o 2"]
    across: Float[np.ndarray, "o 2"]
    """Unit vector along the shorter side."""
    width: Float[np.ndarray, " o"]
    """Shorter side [m]: the diameter."""
    length: Float[np.ndarray, " o"]


def _silhouettes(
    triangles: Float[np.ndarray, "f 3 3"],
    objects: Int[np.ndarray, " f"],
    frame: Float[np.ndarray, "3 3"],
) -> _Silhouettes:
    """Silhouette of each object, from triangles that face the wind."""
    # Exact for a long cylinder across the wind, 0.87 D for a sphere. Where a triangle
    # hides another both count, which changes the result little.
    corners = triangles @ frame[:2].T
    area = np.maximum(-triangle_normals(triangles) @ frame[2], 0) / 2
    total = np.maximum(np.bincount(objects, area), np.finfo(float).tiny)

    def mean(values: Float[np.ndarray, " f"]) -> Float[np.ndarray, " o"]:
        return np.bincount(objects, area * values, len(total)) / total

    centre = np.stack([mean(corners[..., i].mean(1)) for i in range(2)], axis=1)
    corners = corners - centre[objects][:, None]

    # Second moments of a triangle: (sum of the squared corners + squared sum) / 12.
    def moment(i: int, j: int) -> Float[np.ndarray, " o"]:
        squares = (corners[..., i] * corners[..., j]).sum(1)
        square = corners[..., i].sum(1) * corners[..., j].sum(1)
        return mean(squares + square) / 12

    xx = moment(0, 0)
    yy = moment(1, 1)
    xy = moment(0, 1)
    apart = np.hypot((xx - yy) / 2, xy)
    # The principal direction of the smaller moment.
    angle = np.arctan2(2 * xy, xx - yy) / 2 + np.pi / 2
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mean_moment = (xx + yy) / 2
    return _Silhouettes(
        centre=centre,
        across=across,
        width=np.sqrt(12 * np.maximum(mean_moment - apart, 0)),
        length=np.sqrt(12 * np.maximum(mean_moment + apart, 0)),
    )


def _key(layers: DepthLayers, pixel, depth) -> Float[np.ndarray, " n"]:
    """Sort key that increases with the pixel, and within a pixel with the depth."""
    span = 1 + layers.depth.max(initial=0.0)
    return pixel * (2 * span) + np.clip(depth, -0.5 * span, span)


def _next_layer(layers, subset, pixel, depth) -> Int[np.ndarray, " s"]:
    """Index in `subset` of the first layer not before each point, in ray order."""
    keys = _key(layers, layers.pixel[subset], layers.depth[subset])
    return np.searchsorted(keys, _key(layers, pixel, depth))


def _last_before(layers, subset, pixel, depth) -> Int[np.ndarray, " s"]:
    """Index in `subset` of the last layer before each point on its ray; -1 for none."""
    last = _next_layer(layers, subset=subset, pixel=pixel, depth=depth) - 1
    if not len(subset):
        return last
    return np.where(layers.pixel[subset[np.maximum(last, 0)]] == pixel, last, -1)


def _shifted(layers, pixel, offset: tuple[int, int]) -> Int[np.ndarray, " s"]:
    """Pixel that many rows and columns away, clipped to the view."""
    row, column = np.divmod(pixel, layers.width)
    row = np.clip(row + offset[0], 0, layers.height - 1)
    return row * layers.width + np.clip(column + offset[1], 0, layers.width - 1)


def _point_objects(layers, layer_object, pixel, depth) -> Int[np.ndarray, " s"]:
    """Object that each point lies on: that of the nearest layer around its ray."""
    # A ray through the middle of a pixel may miss a surface that only touches the
    # pixel, so the eight pixels around it are searched too.
    everything = np.arange(len(layers.pixel))
    point_object = np.zeros(len(pixel), np.int64)
    nearest = np.full(len(pixel), np.inf)
    for offset in _NEIGHBOURS:
        near = _shifted(layers, pixel, offset)
        following = _next_layer(layers, subset=everything, pixel=near, depth=depth)
        for layer in (following - 1, following):
            layer = np.clip(layer, 0, len(everything) - 1)
            apart = np.abs(layers.depth[layer] - depth) + np.hypot(*offset)
            better = (layers.pixel[layer] == near) & (apart < nearest)
            point_object[better] = layer_object[layer[better]]
            nearest[better] = apart[better]
    return point_object


class WakeGeometry(NamedTuple):
    """Positions of surface points relative to objects upstream, in their diameters."""

    behind: Float[np.ndarray, "o s"]
    """Distance behind the rear; far before it for the point's own object."""
    aside: Float[np.ndarray, "o s"]
    """Distance from the middle of the wake to the side."""
    diameter: Float[np.ndarray, " o"]
    """Diameter of each object [m]."""


# Distance behind an object's rear, in its diameters, of points that it does not affect.
_NOWHERE = -1e3


@stored_search("wake_geometry", (WakeGeometry,))
def wake_geometry(
    triangles: Float[np.ndarray, "f 3 3"],
    position: Float[np.ndarray, "s 3"],
    direction: Float[np.ndarray, "3"],
    pitch: float,
) -> WakeGeometry:
    """Positions of surface points in the wakes of all objects.

    Arguments as for `upstream_wakes`. An object counts as a rod along the longer side
    of its silhouette if that is much longer, else as compact. Distances change smoothly
    as objects move.
    """
    objects = _objects(triangles)
    if objects.max() == 0:
        no_points = np.zeros((0, len(position)))
        return WakeGeometry(behind=no_points, aside=no_points, diameter=np.zeros(0))
    view, layers = _seen_along(triangles, direction, pitch)
    pixel, depth = _pixels(view, position)
    point_object = _point_objects(
        layers, layer_object=objects[layers.triangle], pixel=pixel, depth=depth
    )
    silhouettes = _silhouettes(triangles, objects, view.frame)
    points = position @ view.frame.T
    behind = []
    aside = []
    for number in range(len(silhouettes.width)):
        x, y = _distances(
            points,
            triangles=triangles[objects == number] @ view.frame.T,
            silhouette=_Silhouettes(*(field[number] for field in silhouettes)),
        )
        behind.append(np.where(point_object == number, _NOWHERE, x))
        aside.append(y)
    near = np.array([(x > -1).any() for x in behind])
    return WakeGeometry(
        behind=np.stack(behind)[near],
        aside=np.stack(aside)[near],
        diameter=silhouettes.width[near],
    )


def _distances(
    points: Float[np.ndarray, "s 3"],
    triangles: Float[np.ndarray, "f 3 3"],
    silhouette: _Silhouettes,
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Distances behind and aside of an object [diameters], in the view's frame."""
    centre, across, width, length = silhouette
    along = np.array([-across[1], across[0]])
    # A rod may be inclined to the wind: its rear is a plane through its leeward side.
    leeward = np.maximum(triangle_normals(triangles)[:, 2], 0)
    on_axis = (triangles.mean(1)[:, :2] - centre) @ along
    depth = triangles.mean(1)[:, 2]
    weight = leeward / max(leeward.sum(), np.finfo(float).tiny)
    from_mean = on_axis - weight @ on_axis
    spread = max(weight @ from_mean**2, np.finfo(float).tiny)
    slope = weight @ (from_mean * depth) / spread if length > 2 * width else 0.0
    corners = triangles.reshape(-1, 3)
    rear = (corners[:, 2] - slope * ((corners[:, :2] - centre) @ along)).max()
    offset = points[:, :2] - centre
    axial = offset @ along
    half = max((length - width) / 2, 0.0)
    # Beyond the ends of a rod the distance is that from its end.
    past = np.maximum(np.abs(axial) - half, 0.0)
    at = np.clip(axial, -half, half)
    behind = (points[:, 2] - rear - slope * at) / width
    return behind, np.hypot(offset @ across, past) / width
