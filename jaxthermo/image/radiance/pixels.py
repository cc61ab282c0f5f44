"""Values of fragments and of bodies at the pixels of a view."""

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ...scene.scene import SolvedSurface, per_fragment
from ..surface.view import View
from ..surface.weights import MovingWeights
from .radiometry import Values


def means(weights: csr_array | MovingWeights, values: Values) -> Values:
    """Weighted means of the fragments of each row, [s, k] to [p, k]."""
    if isinstance(weights, MovingWeights):
        return weights.means(jnp.asarray(values))
    count = len(weights.indptr) - 1
    if isinstance(values, np.ndarray):
        return (weights @ values).astype(values.dtype, copy=False)
    row = np.repeat(np.arange(count), np.diff(weights.indptr))
    contributions = (
        jnp.asarray(weights.data, values.dtype)[:, None] * values[weights.indices]
    )
    # The rows of the weights are sorted, which lets XLA sum without scattering.
    return jax.ops.segment_sum(contributions, row, count, indices_are_sorted=True)


def temperature_at_pixels(view: View, kelvin: Float[Values, " s"]) -> Values:
    """Surface temperatures of fragments [K], interpolated to the pixels [p]."""
    if isinstance(kelvin, np.ndarray):
        return _weights(view, kelvin.dtype) @ kelvin
    return means(view.weights, kelvin[:, None])[:, 0]


# By view, with which they are released: half the memory traffic in float32.
_typed_weights: WeakKeyDictionary[View, dict[np.dtype, csr_array]] = WeakKeyDictionary()


def _weights(view: View, dtype: np.dtype) -> csr_array:
    """Weights of the view in a type."""
    typed = _typed_weights.setdefault(view, {})
    if dtype not in typed:
        weights = view.weights
        # Points that move have their values of JAX.
        assert isinstance(weights, csr_array)
        entries = weights.data.astype(dtype), weights.indices, weights.indptr
        typed[dtype] = csr_array(entries, shape=weights.shape)
    return typed[dtype]


def property_at_pixels(
    view: View, surfaces: tuple[SolvedSurface, ...], field: str, xp: Any
) -> Values:
    """A property of surfaces, "emissivity" or "absorptivity", at the pixels [p]."""
    numbers = [getattr(surface, field) for surface in surfaces]
    # Points that move do not know their bodies, but all their fragments do.
    moving = isinstance(view.weights, MovingWeights)
    if moving or any(np.ndim(number) for number in numbers):
        fragments = per_fragment(surfaces, field, xp)
        return means(view.weights, fragments[:, None])[:, 0]
    # A body of one number has it everywhere.
    return xp.stack([xp.asarray(number) for number in numbers])[view.body]


def irradiation_at_pixels(
    view: View, values: Float[Values, "s k"]
) -> Float[Values, "p k"]:
    """Radiation on fragments to pixels, both in W/m^2, see `facets`."""
    facets = view.facets
    on_host = isinstance(values, np.ndarray)
    weights = _weights(view, values.dtype) if on_host else view.weights
    plain = means(weights, values)
    if facets is None:
        return plain
    xp: Any = np if on_host else jnp
    local_mean = means(facets.local_mean, values)
    share = xp.asarray(facets.share, values.dtype)[:, :, None]
    joined, alone = (
        (share * means(corner_weights, values)[facets.corner]).sum(axis=1)
        for corner_weights in (facets.joined, facets.alone)
    )
    scale = xp.minimum(local_mean / xp.where(alone > 0, alone, 1), 1)
    smooth = local_mean + xp.where(alone > 0, scale, 1) * (joined - alone)
    return replaced(plain, facets.point, smooth)


def replaced(values: Values, where: Any, new: Any) -> Values:
    """An array with new values at some places."""
    if not isinstance(values, np.ndarray):
        return values.at[where].set(new)
    values = values.copy()
    values[where] = new
    return values


def filled(view: View, values: Any, background: Any, dtype: Any, xp: Any) -> Values:
    """Image [h, w] of pixel values, with a background behind the bodies."""
    width, height = view.camera.size
    blank = xp.asarray(background, dtype)
    blank = xp.broadcast_to(blank, (height * width, *values.shape[1:]))
    image = replaced(blank, view.pixel, xp.asarray(values, dtype))
    return image.reshape(height, width, *values.shape[1:])


class _GeometryFrames(NamedTuple):
    """Geometry that a view shows, the same at all times."""

    depth: Float[Array | np.ndarray, "h w"]
    object_id: Int[Array | np.ndarray, "h w"]
    normal: Float[Array | np.ndarray, "h w 3"]
    part_id: Int[Array | np.ndarray, "h w"] | None


_frames: WeakKeyDictionary[View, dict[np.dtype, _GeometryFrames]] = WeakKeyDictionary()


def geometry_frames(view: View, dtype: Any) -> _GeometryFrames:
    """Depth, body and normal of every pixel, kept as long as the view."""
    frames = _frames.setdefault(view, {})
    pixel_type = np.dtype(dtype)
    if pixel_type not in frames:
        depth = filled(view, values=view.depth, background=np.inf, dtype=dtype, xp=np)
        body = filled(view, values=view.body, background=-1, dtype=np.int32, xp=np)
        normal = filled(view, values=view.normal, background=0, dtype=dtype, xp=np)
        part_id = None
        if view.part_id is not None:
            part_id = filled(
                view, values=view.part_id, background=-1, dtype=np.int32, xp=np
            )
        geometry = _GeometryFrames(
            depth=depth, object_id=body, normal=normal, part_id=part_id
        )
        for image in geometry:
            # Frames of all times share them.
            if image is not None:
                np.asarray(image).flags.writeable = False
        frames[pixel_type] = geometry
    return frames[pixel_type]
