"""Frames of surfaces in a view, differentiable in their temperatures.

The radiance of each surface point is that of `radiometry`, changed by the effects of a
camera that act on surfaces and along the line of sight.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import csr_array

from ...arrays import array_namespace, namespace
from ...physics.radiation.irradiation import Irradiance
from ...physics.radiation.source import AbstractSource
from ...physics.term import AbstractTerm
from ...physics.time_varying import value_at
from ...scene.scene import SolvedSurface, per_fragment
from ..surface.background import VisibleSource, horizon_at
from ..surface.view import View
from ..surface.weights import MovingWeights
from .band import Band
from .effect import NO_EFFECTS, Effects, Horizon, prepared_for
from .image import Image
from .radiometry import (
    PixelRadiation,
    Values,
    apparent_temperature,
    black_radiance,
    leaving_radiance,
    share,
    within_band,
)


def _means(weights: csr_array | MovingWeights, values: Values) -> Values:
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


def _temperature_at_pixels(view: View, kelvin: Float[Values, " s"]) -> Values:
    """Surface temperatures of fragments [K], interpolated to the pixels [p]."""
    if isinstance(kelvin, np.ndarray):
        return view.typed_weights(kelvin.dtype) @ kelvin
    return _means(view.weights, kelvin[:, None])[:, 0]


def _property_at_pixels(
    view: View, surfaces: tuple[SolvedSurface, ...], field: str, xp: Any
) -> Values:
    """A property of surfaces, "emissivity" or "absorptivity", at the pixels [p]."""
    numbers = [getattr(surface, field) for surface in surfaces]
    # Points that move do not know their bodies, but all their fragments do.
    moving = isinstance(view.weights, MovingWeights)
    if moving or any(np.ndim(number) for number in numbers):
        fragments = per_fragment(surfaces, field, xp)
        return _means(view.weights, fragments[:, None])[:, 0]
    # A body of one number has it everywhere.
    return xp.stack([xp.asarray(number) for number in numbers])[view.body]


def _irradiation_at_pixels(
    view: View, values: Float[Values, "s k"]
) -> Float[Values, "p k"]:
    """Radiation on fragments to pixels, both in W/m^2, see `facets`."""
    facets = view.facets
    on_host = isinstance(values, np.ndarray)
    weights = view.typed_weights(values.dtype) if on_host else view.weights
    plain = _means(weights, values)
    if facets is None:
        return plain
    xp = array_namespace(values)
    local_mean = _means(facets.local_mean, values)
    share = xp.asarray(facets.share, values.dtype)[:, :, None]
    joined, alone = (
        (share * _means(corner_weights, values)[facets.corner]).sum(axis=1)
        for corner_weights in (facets.joined, facets.alone)
    )
    scale = xp.minimum(local_mean / xp.where(alone > 0, alone, 1), 1)
    smooth = local_mean + xp.where(alone > 0, scale, 1) * (joined - alone)
    return _replaced(plain, facets.point, smooth)


def _replaced(values: Values, where: Any, new: Any) -> Values:
    """An array with new values at some places."""
    if not isinstance(values, np.ndarray):
        return values.at[where].set(new)
    values = values.copy()
    values[where] = new
    return values


def _filled(view: View, values: Any, background: Any, dtype: Any, xp: Any) -> Values:
    """Image [h, w] of pixel values, with a background behind the bodies."""
    width, height = view.camera.size
    blank = xp.asarray(background, dtype)
    blank = xp.broadcast_to(blank, (height * width, *values.shape[1:]))
    image = _replaced(blank, view.pixel, xp.asarray(values, dtype))
    return image.reshape(height, width, *values.shape[1:])


class _PixelSurface(NamedTuple):
    """Surface temperatures and radiances of the bodies, as the pixels show them."""

    temperature: Values
    """[K]"""
    emissivity: Values
    radiance: Values
    """[W/(m^2 sr)]"""


def _lambertian(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    kelvin: Values,
    received: Irradiance | None,
    band: Band | None,
) -> _PixelSurface:
    """Surfaces that emit and reflect alike in all directions."""
    xp = array_namespace(kelvin)
    surface = _temperature_at_pixels(view, kelvin)
    seen = _property_at_pixels(view, surfaces=surfaces, field="emissivity", xp=xp)
    back: Any = xp.zeros_like(surface)
    if received is not None:
        # Fragments reflect: one sum to carry to the pixels, or two where the image
        # hides a fraction of the surroundings.
        inside = within_band(received, band, xp)
        reflected, lit = inside.reflected(
            per_fragment(surfaces, "emissivity", xp),
            per_fragment(surfaces, _absorptivity(band), xp),
        )
        hidden = view.open_fraction is not None
        rows = xp.stack([reflected, lit] if hidden else [reflected], axis=1)
        back, *lit_pixels = _irradiation_at_pixels(view, rows).T
        if hidden:
            # Sources have their own shadows: what is hidden is thermal radiation, and
            # what hides it is as warm as the surface, as in `Surroundings`.
            direct = sum(lit_pixels)
            open_fraction = xp.asarray(view.open_fraction, surface.dtype)
            hiding = (1 - seen) * math.pi * black_radiance(surface, band)
            back = (
                direct + open_fraction * (back - direct) + (1 - open_fraction) * hiding
            )
    radiance = leaving_radiance(surface, emissivity=seen, reflected=back, band=band)
    return _PixelSurface(temperature=surface, emissivity=seen, radiance=radiance)


def _absorptivity(band: Band | None) -> str:
    """Name of the property that absorbs what sources send."""
    return "absorptivity" if band is None else "emissivity"


def _directional(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    kelvin: Values,
    received: Irradiance | None,
    horizon: Horizon,
    band: Band | None,
    effects: Effects,
) -> _PixelSurface:
    """Surfaces whose radiation depends on the direction."""
    xp = array_namespace(kelvin)
    surface = _temperature_at_pixels(view, kelvin)
    seen = _property_at_pixels(view, surfaces=surfaces, field="emissivity", xp=xp)
    absorptivity = _property_at_pixels(
        view, surfaces=surfaces, field=_absorptivity(band), xp=xp
    )
    black = black_radiance(surface, band)
    thermal = xp.zeros_like(surface)
    sources = thermal[None, :][:0]
    if received is not None:
        inside = within_band(received, band, xp)
        rows = xp.concatenate([inside.thermal[None], inside.sources])
        thermal, *lit = _irradiation_at_pixels(view, rows.T).T
        sources = xp.stack(lit) if lit else sources
        if view.open_fraction is not None:
            open_fraction = xp.asarray(view.open_fraction, surface.dtype)
            thermal = open_fraction * thermal + (1 - open_fraction) * math.pi * black
    radiation = PixelRadiation(
        black=black,
        emissivity=seen,
        absorptivity=absorptivity,
        thermal=thermal,
        sources=sources,
    )
    for effect in effects.surface:
        arrays = prepared_for(effect, view=view, terms=terms, dtype=surface.dtype)
        radiation = effect.apply(radiation, arrays, horizon)
    return _PixelSurface(
        temperature=surface,
        emissivity=radiation.emissivity,
        radiance=radiation.radiance,
    )


def draw(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    temperature: Values,
    received: Irradiance | None,
    time: Float[Array, ""],
    load_time: Float[Array, ""] | None = None,
    band: Band | None = None,
    effects: Effects = NO_EFFECTS,
) -> Image:
    """Draw the frame of surfaces in a view, as it reaches the lens.

    Args:
        view: of a camera on the scene.
        surfaces: of the bodies.
        terms: of the scene, for sky, ground and sources.
        temperature: of the surfaces [K].
        received: radiation that reaches them; None for none.
        time: of the frame [s].
        load_time: time of the values of sky, ground and sources [s]; `time` if None.
        band: of the detector; None for all wavelengths.
        effects: of a camera; here those of surfaces and of the line of sight act.
    """
    load_time = time if load_time is None else load_time
    # Derivatives need JAX, which otherwise would compile a program for every view.
    inputs = temperature, received, load_time, terms, surfaces, effects, view.weights
    xp = namespace(inputs)
    kelvin = xp.asarray(temperature)
    if received is not None:
        received = Irradiance(*(xp.asarray(values) for values in received))
    behind = tuple(xp.asarray(end) for end in horizon_at(terms, load_time))
    horizon = Horizon(*(black_radiance(end, band) for end in behind))
    if effects.surface:
        drawn = _directional(
            view,
            surfaces=surfaces,
            terms=terms,
            kelvin=kelvin,
            received=received,
            horizon=horizon,
            band=band,
            effects=effects,
        )
    else:
        drawn = _lambertian(
            view, surfaces=surfaces, kelvin=kelvin, received=received, band=band
        )
    surface, emissivity, radiance = drawn
    for effect in effects.path:
        arrays = prepared_for(effect, view=view, terms=terms, dtype=radiance.dtype)
        radiance = effect.apply(radiance, arrays, band)

    def frame(values: Any, background: Any) -> Values:
        return _filled(
            view, values=values, background=background, dtype=surface.dtype, xp=xp
        )

    geometry = view.geometry_frames(surface.dtype)
    image = Image(
        time=time,
        temperature=frame(surface, view.background.of(*behind)),
        radiance=frame(radiance, view.background.of(*horizon)),
        emissivity=frame(emissivity, 1),
        depth=xp.asarray(geometry.depth),
        object_id=xp.asarray(geometry.object_id),
        normal=xp.asarray(geometry.normal),
        part_id=None if geometry.part_id is None else xp.asarray(geometry.part_id),
        part_names=view.part_names,
        band=band,
    )
    for visible in view.background.sources:
        source = terms[visible.number]
        assert isinstance(source, AbstractSource)
        strength = xp.asarray(value_at(source.strength, load_time))
        if band is not None:
            spectrum = xp.asarray(value_at(source.spectrum, load_time))
            strength = xp.asarray(strength * share(band, spectrum))
        image = _with_source(image, visible, strength)
    return image


def _with_source(image: Image, source: VisibleSource, strength: Values) -> Image:
    """The frame with a source in front; without it where it is switched off."""
    xp = array_namespace(strength)
    radiance = strength * xp.asarray(source.radiance, image.radiance.dtype)
    where = np.divmod(source.pixel, image.radiance.shape[1])

    def over(below: Values, value: Any) -> Values:
        old = below[where]
        on = (radiance > 0).reshape(-1, *(1,) * (old.ndim - 1))
        new = xp.where(on, xp.asarray(value, old.dtype), old)
        return _replaced(below, where, new)

    return dataclasses.replace(
        image,
        temperature=over(image.temperature, apparent_temperature(radiance, image.band)),
        radiance=over(image.radiance, radiance),
        emissivity=over(image.emissivity, 1),
        depth=over(image.depth, source.depth),
        object_id=over(image.object_id, -1),
        part_id=None if image.part_id is None else over(image.part_id, -1),
        normal=over(image.normal, 0),
    )
