"""Frames of surfaces in a view, differentiable in their temperatures.

The radiance of each surface point is that of `radiometry`, changed by the effects of a
camera that act on surfaces and along the line of sight.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced
from ...physics.radiation.irradiation import Irradiance
from ...physics.radiation.source import AbstractSource
from ...physics.term import AbstractTerm
from ...physics.time_varying import value_at
from ...scene.scene import SolvedSurface, per_fragment
from ..surface.background import VisibleSource, horizon_at
from ..surface.view import View
from .band import Band
from .effect import NO_EFFECTS, Effects, Horizon, prepared_for
from .image import Image
from .pixels import (
    filled,
    geometry_frames,
    irradiation_at_pixels,
    property_at_pixels,
    replaced,
    temperature_at_pixels,
)
from .radiometry import (
    PixelRadiation,
    Values,
    apparent_temperature,
    black_radiance,
    leaving_radiance,
    share,
    within_band,
)


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
    xp: Any = np if isinstance(kelvin, np.ndarray) else jnp
    surface = temperature_at_pixels(view, kelvin)
    seen = property_at_pixels(view, surfaces=surfaces, field="emissivity", xp=xp)
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
        back, *lit_pixels = irradiation_at_pixels(view, rows).T
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
    xp: Any = np if isinstance(kelvin, np.ndarray) else jnp
    surface = temperature_at_pixels(view, kelvin)
    seen = property_at_pixels(view, surfaces=surfaces, field="emissivity", xp=xp)
    absorptivity = property_at_pixels(
        view, surfaces=surfaces, field=_absorptivity(band), xp=xp
    )
    black = black_radiance(surface, band)
    thermal = xp.zeros_like(surface)
    sources = thermal[None, :][:0]
    if received is not None:
        inside = within_band(received, band, xp)
        rows = xp.concatenate([inside.thermal[None], inside.sources])
        thermal, *lit = irradiation_at_pixels(view, rows.T).T
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
    xp: Any = jnp if is_traced(inputs) else np
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
        return filled(
            view, values=values, background=background, dtype=surface.dtype, xp=xp
        )

    geometry = geometry_frames(view, surface.dtype)
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
    xp: Any = np if isinstance(strength, np.ndarray) else jnp
    radiance = strength * xp.asarray(source.radiance, image.radiance.dtype)
    where = np.divmod(source.pixel, image.radiance.shape[1])

    def over(below: Values, value: Any) -> Values:
        old = below[where]
        on = (radiance > 0).reshape(-1, *(1,) * (old.ndim - 1))
        new = xp.where(on, xp.asarray(value, old.dtype), old)
        return replaced(below, where, new)

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
