"""Wind speed in the wake of an object, and distances of surfaces behind objects.

    u / U = 1 - A (1 + (x / l)^2)^(-p / 2)

x and l in diameters of the object, from its rear: the family of steady laminar wakes.
Fitted to computed centrelines at Re 10 to 40 its error is 0.007 to 0.03 (a pure
exponential: 0.07 to 0.08); far away p tends to 1/2 (Schlichting). The thesis (6.2)
draws such a "convergent function" without a formula.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, is_traced, require_memory
from ...errors import InputError
from ...geometry.mesh import part_labels
from ...module import Module
from ...raster.fragments import DepthLayers
from ...raster.views import orthographic_view
from ...stored_findings import stored_search


# Where the formula is negative, u / U decays to 0 over about this much.
_TRANSITION = 0.05

# Reynolds numbers of the objects to whose wakes the family was fitted.
_FITTED_REYNOLDS = 10.0, 40.0


class WakeDeficit(Module):
    """Wake u / U = 1 - A (1 + (x / l)^2)^(-p / 2); the defaults fit Re 20.

    Any other callable from x / D to u / U in (0, 1] can be given instead.
    """

    amplitude: Scalar = 1.027
    """A [-], in (0, 1.3)."""
    length: Scalar = 2.227
    """l / D [-]."""
    exponent: Scalar = 0.497
    """p [-], in [0.4, 1.1]."""

    def __check_init__(self):
        _check("amplitude", self.amplitude, 0.0, 1.3)
        _check("length", self.length, 0.0, np.inf)
        _check("exponent", self.exponent, 0.4 - 1e-9, 1.1 + 1e-9)

    def __call__(self, x: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Speed ratio u / U [-] at x diameters behind the rear."""
        a, l, p = (
            jnp.asarray(v, x.dtype)
            for v in (self.amplitude, self.length, self.exponent)
        )
        ratio = 1 - a * (1 + (x / l) ** 2) ** (-p / 2)
        # Inside the bubble the mean flow runs backwards; a speed cannot.
        return jax.nn.softplus(ratio / _TRANSITION) / jax.nn.softplus(1 / _TRANSITION)


def _check(name: str, value: Any, low: float, high: float) -> None:
    if is_traced(value):
        return
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not low < number < high:
        raise InputError(
            f"WakeDeficit({name}={value!r}): give a number between {low:.3g} and "
            f"{high:.3g}"
        )


def wake_notes(wake: Any, reynolds: Float[np.ndarray, " n"]) -> tuple[str, ...]:
    """Note on a wake of objects at other Reynolds numbers V D / nu than its fit."""
    low, high = _FITTED_REYNOLDS
    beyond = reynolds[(reynolds < low) | (reynolds > high)]
    # What another function was fitted to is not known.
    if not isinstance(wake, WakeDeficit) or not len(beyond):
        return ()
    ends = f"{beyond.min():.3g}"
    if beyond.max() > beyond.min() * 1.01:
        ends += f" to {beyond.max():.3g}"
    sooner = ": a turbulent wake recovers sooner" if beyond.max() > high else ""
    return (
        f"the wake is of an object at Re {ends}, and the deficit was fitted at Re "
        f"{low:g} to {high:g} (its defaults at 20){sooner}",
    )


def wake_speed_ratio(wake: Any, x: Float[np.ndarray, " g"]) -> Float[Any, " g"]:
    """Speed ratio u / U [-] at x / D, which is infinite with nothing upstream.

    Raises:
        InputError: if `wake` returns values outside (0, 1].
    """
    behind = np.isfinite(x)
    # The power of an infinite distance has no derivative.
    with jax.ensure_compile_time_eval():
        ratio = jnp.where(behind, wake(jnp.asarray(np.where(behind, x, 1.0))), 1.0)
        if is_traced(ratio):
            return ratio
        values = np.asarray(ratio)
    bad = ~((values > 0) & (values <= 1))
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"Wind(wake=): gives u/U = {values[first]:.3g} at x/D = {x[first]:.3g}; "
            "it must lie in (0, 1]"
        )
    return values


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
    view = orthographic_view(triangles, direction, pitch)
    require_memory(view.width * view.height * 16, "a wake", "use a coarser pitch")
    # Shapes are known while the rest of a scene is traced.
    with jax.ensure_compile_time_eval():
        layers = view.peel(triangles)
    # The last point upstream on the ray through a fragment where the wind left another
    # object is the rear of that object. A connected part of the mesh is one object: its
    # own wake is in the correlation for a cylinder already.
    objects = _objects(triangles)
    layer_object = objects[layers.triangle]
    diameter = _diameters(triangles, objects, view.frame) / view.pitch
    seen = view.project(position)
    row = np.clip(seen[:, 1].astype(np.int64), 0, view.height - 1)
    column = np.clip(seen[:, 0].astype(np.int64), 0, view.width - 1)
    pixel, depth = row * view.width + column, seen[:, 2]
    point_object = _point_objects(layers, layer_object, pixel, depth)
    behind, width = np.full(len(position), np.inf), np.zeros(len(position))
    for number in np.unique(point_object):
        points = np.flatnonzero(point_object == number)
        rear = np.flatnonzero(~layers.entering & (layer_object != number))
        for offset in _NEIGHBOURS:
            # A wake is at least as wide as its object: one more pixel around.
            points = points[np.isinf(behind[points])]
            near = _shifted(layers, pixel[points], offset)
            last = _last_before(layers, rear, near, depth[points])
            hit = last >= 0
            found = rear[last[hit]]
            gap = depth[points[hit]] - layers.depth[found]
            behind[points[hit]] = gap / diameter[layer_object[found]]
            width[points[hit]] = diameter[layer_object[found]] * view.pitch
    return Wakes(behind, width)


def _objects(triangles: Float[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " f"]:
    """Object number of each triangle; corners at equal positions connect triangles."""
    corners = triangles.reshape(-1, 3)
    _, vertex = np.unique(corners, axis=0, return_inverse=True)
    return part_labels(vertex.reshape(-1, 3))


def _diameters(
    triangles: Float[np.ndarray, "f 3 3"],
    objects: Int[np.ndarray, " f"],
    frame: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, " o"]:
    """Diameter of each object's silhouette [m], from triangles that face the wind."""
    # The smaller side of the rectangle with the same second moments as the silhouette:
    # exact for a long cylinder across the wind, 0.87 D for a sphere. Where a triangle
    # hides another both count, which changes the result little.
    corners = triangles @ frame[:2].T
    normal = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    area = np.maximum(-normal @ frame[2], 0) / 2
    total = np.maximum(np.bincount(objects, area), np.finfo(float).tiny)
    mean = lambda values: np.bincount(objects, area * values, len(total)) / total
    centre = np.stack([mean(corners[..., i].mean(1)) for i in range(2)], axis=1)
    corners = corners - centre[objects][:, None]
    # Second moments of a triangle: (sum of the squared corners + squared sum) / 12.
    square = lambda i, j: (
        (corners[..., i] * corners[..., j]).sum(1)
        + corners[..., i].sum(1) * corners[..., j].sum(1)
    )
    xx, yy, xy = (mean(square(i, j)) / 12 for i, j in ((0, 0), (1, 1), (0, 1)))
    return np.sqrt(12 * ((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)))


def _key(layers: DepthLayers, pixel, depth) -> Float[np.ndarray, " n"]:
    """Sort key that increases with the pixel, and within a pixel with the depth."""
    span = 1 + layers.depth.max(initial=0.0)
    return pixel * (2 * span) + np.clip(depth, -0.5 * span, span)


def _next_layer(layers, chosen, pixel, depth) -> Int[np.ndarray, " s"]:
    """Index in `chosen` of the first layer not before each point, in ray order."""
    keys = _key(layers, layers.pixel[chosen], layers.depth[chosen])
    return np.searchsorted(keys, _key(layers, pixel, depth))


def _last_before(layers, chosen, pixel, depth) -> Int[np.ndarray, " s"]:
    """Index in `chosen` of the last layer before each point on its ray; -1 for none."""
    last = _next_layer(layers, chosen, pixel, depth) - 1
    if not len(chosen):
        return last
    return np.where(layers.pixel[chosen[np.maximum(last, 0)]] == pixel, last, -1)


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
    found = np.zeros(len(pixel), np.int64)
    nearest = np.full(len(pixel), np.inf)
    for offset in _NEIGHBOURS:
        near = _shifted(layers, pixel, offset)
        after = _next_layer(layers, everything, near, depth)
        for layer in (after - 1, after):
            layer = np.clip(layer, 0, len(everything) - 1)
            apart = np.abs(layers.depth[layer] - depth) + np.hypot(*offset)
            better = (layers.pixel[layer] == near) & (apart < nearest)
            found[better], nearest[better] = layer_object[layer[better]], apart[better]
    return found
