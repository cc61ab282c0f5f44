"""Frames of surfaces in a view, differentiable in their temperatures.

Radiance that leaves a surface, total over the spectrum [W/(m^2 sr)]:

    L = [eps sigma T^4 + (1 - eps) H + (1 - a) E] / pi,

the emission and the reflected irradiation: H thermal, E of sources, which are those of
the heat balance. A camera set to emissivity 1 shows T_apparent = (pi L / sigma)^(1/4).

Within the band of a detector L_b(T) is the radiance of a black surface, and

    L = eps L_b(T) + (1 - eps) [L_b((H / sigma)^(1/4)) + f E / pi],

f the fraction of a source's spectrum within the band: surfaces reflect there as much as
they do not emit, and surroundings of several temperatures count as their mean. A camera
shows the T at which L_b(T) = L. Effects of a camera on surfaces and along the line of
sight change these radiances.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...arrays import HOST, array_namespace, namespace
from ...physics.radiation.irradiation import Irradiance
from ...physics.radiation.source import AbstractSource
from ...physics.term import AbstractTerm
from ...physics.time_varying import value_at
from ...scene.scene import SolvedSurface, per_fragment
from ..surface.background import VisibleSource, horizon_at
from ..surface.view import View
from ..surface.weights import MovingWeights, weighted_means
from .band import Band, Values, apparent_temperature, black_radiance
from .effect import NO_EFFECTS, Effects, Horizon, PixelRadiation, prepared_for
from .image import Image


class Moment(NamedTuple):
    """State of a scene at one time, as far as a camera sees it."""

    surfaces: tuple[SolvedSurface, ...]
    """Surfaces of the bodies, with their motion."""
    terms: tuple[AbstractTerm, ...]
    """Terms of the scene, for sky, ground and sources."""
    temperature: Values
    """Temperature of every fragment [K]."""
    received: Irradiance | None
    """Radiation that reaches every fragment [W/m^2]; None for none."""
    time: Any
    """Time of the frame [s]."""
    load_time: Any = None
    """Time of the values of sky, ground and sources [s]; `time` if None."""


def draw(
    view: View, moment: Moment, band: Band | None = None, effects: Effects = NO_EFFECTS
) -> Image:
    """Draw the frame of a moment in a view, as it reaches the lens.

    Args:
        view: of a camera on the scene.
        moment: temperatures, irradiation and loads.
        band: of the detector; None for all wavelengths.
        effects: of a camera; here those of surfaces and of the line of sight act.
    """
    # Derivatives need JAX, which otherwise would compile a program for every view.
    xp = namespace((moment, effects, view.weights))
    fragments = xp.asarray(moment.temperature)
    dtype = fragments.dtype
    time = jnp.asarray(moment.time, dtype)
    load_time = time if moment.load_time is None else _precise(moment.load_time, dtype)
    behind = tuple(xp.asarray(end) for end in horizon_at(moment.terms, load_time))
    horizon = Horizon(*(black_radiance(kelvin, band) for kelvin in behind))

    temperature = view.means(fragments)
    emissivity = _property_at_pixels(view, moment.surfaces, field="emissivity", xp=xp)
    incident = _within_band(moment.received, band, xp)
    if effects.surface:
        radiation = _directional(
            view,
            surfaces=moment.surfaces,
            temperature=temperature,
            emissivity=emissivity,
            incident=incident,
            band=band,
        )
        for effect in effects.surface:
            arrays = prepared_for(effect, view, dtype)
            radiation = effect.apply(radiation, arrays, horizon)
        emissivity = radiation.emissivity
        radiance = radiation.radiance
    else:
        radiance = _lambertian(
            view,
            surfaces=moment.surfaces,
            temperature=temperature,
            emissivity=emissivity,
            incident=incident,
            band=band,
        )
    for effect in effects.path:
        radiance = effect.apply(radiance, prepared_for(effect, view, dtype), band)

    geometry = view.geometry_frames(dtype)

    def frame(values: Values, background: Any) -> Values:
        blank = xp.broadcast_to(xp.asarray(background, dtype), (geometry.depth.size,))
        image = _replaced(blank, view.pixel, xp.asarray(values, dtype))
        return image.reshape(geometry.depth.shape)

    image = Image(
        time=time,
        temperature=frame(temperature, view.background.of(*behind)),
        radiance=frame(radiance, view.background.of(*horizon)),
        emissivity=frame(emissivity, 1),
        depth=xp.asarray(geometry.depth),
        object_id=xp.asarray(geometry.object_id),
        normal=xp.asarray(geometry.normal),
        part_id=None if geometry.part_id is None else xp.asarray(geometry.part_id),
        part_names=view.part_names,
        body_names=view.body_names,
        band=band,
    )
    for visible in view.background.sources:
        source = moment.terms[visible.number]
        assert isinstance(source, AbstractSource)
        strength = xp.asarray(value_at(source.strength, load_time))
        if band is not None:
            spectrum = xp.asarray(value_at(source.spectrum, load_time))
            strength = xp.asarray(strength * _share(band, spectrum))
        image = _with_source(image, visible, strength)
    return image


def _precise(time: Any, dtype: Any) -> Any:
    """A time [s] of the host as it is; others in the type of the temperatures."""
    return time if isinstance(time, HOST) else jnp.asarray(time, dtype)


def _property_at_pixels(
    view: View, surfaces: tuple[SolvedSurface, ...], field: str, xp: Any
) -> Values:
    """A property of surfaces, "emissivity" or "absorptivity", at the pixels [p]."""
    numbers = [getattr(surface, field) for surface in surfaces]
    # Points that move do not know their bodies, but all their fragments do.
    moving = isinstance(view.weights, MovingWeights)
    if moving or any(np.ndim(number) for number in numbers):
        return view.means(per_fragment(surfaces, field, xp))
    # A body of one number has it everywhere.
    return xp.stack([xp.asarray(number) for number in numbers])[view.body]


def _within_band(
    received: Irradiance | None, band: Band | None, xp: Any
) -> Irradiance | None:
    """The part of the irradiance [W/m^2] within the band, in arrays of `xp`."""
    if received is None:
        return None
    thermal, sources, spectrum = map(xp.asarray, received)
    if band is None:
        return Irradiance(thermal, sources, spectrum)
    # A black body at the mean of what surrounds a surface.
    smallest = np.asarray(1e-12, thermal.dtype)
    mean = apparent_temperature(xp.maximum(thermal, smallest) / math.pi)
    return Irradiance(
        thermal=math.pi * black_radiance(mean, band),
        sources=sources * _share(band, spectrum)[:, None],
        spectrum=spectrum,
    )


def _share(band: Band, spectrum: Any) -> Any:
    """Fractions of the radiation of sources within the band."""
    exact = band.share(spectrum)
    # The laws of a band are in double precision on the host.
    return exact if isinstance(exact, jax.Array) else exact.astype(spectrum.dtype)


def _absorptivity(band: Band | None) -> str:
    """Name of the property that absorbs what sources send."""
    return "absorptivity" if band is None else "emissivity"


def _lambertian(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    temperature: Float[Values, " p"],
    emissivity: Float[Values, " p"],
    incident: Irradiance | None,
    band: Band | None,
) -> Float[Values, " p"]:
    """Radiance of surfaces that emit and reflect alike in all directions."""
    xp = array_namespace(temperature)
    black = black_radiance(temperature, band)
    if incident is None:
        return emissivity * black
    # Fragments reflect: one sum to carry to the pixels, or two where the image hides a
    # fraction of the surroundings.
    reflected, lit = incident.reflected(
        per_fragment(surfaces, "emissivity", xp),
        per_fragment(surfaces, _absorptivity(band), xp),
    )
    if view.open_fraction is None:
        (back,) = _irradiation_at_pixels(view, reflected[:, None]).T
    else:
        rows = xp.stack([reflected, lit], axis=1)
        back, direct = _irradiation_at_pixels(view, rows).T
        # Sources have their own shadows: what is hidden is thermal radiation, and what
        # hides it is as warm as the surface, as in `Surroundings`.
        open_fraction = xp.asarray(view.open_fraction, temperature.dtype)
        hiding = (1 - emissivity) * math.pi * black
        back = direct + open_fraction * (back - direct) + (1 - open_fraction) * hiding
    return emissivity * black + back / math.pi


def _directional(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    temperature: Float[Values, " p"],
    emissivity: Float[Values, " p"],
    incident: Irradiance | None,
    band: Band | None,
) -> PixelRadiation:
    """Radiation of surfaces before effects that depend on the direction."""
    xp = array_namespace(temperature)
    black = black_radiance(temperature, band)
    thermal = xp.zeros_like(temperature)
    sources = thermal[None, :][:0]
    if incident is not None:
        rows = xp.concatenate([incident.thermal[None], incident.sources])
        at_pixels = _irradiation_at_pixels(view, rows.T).T
        thermal = at_pixels[0]
        sources = at_pixels[1:]
        if view.open_fraction is not None:
            open_fraction = xp.asarray(view.open_fraction, temperature.dtype)
            thermal = open_fraction * thermal + (1 - open_fraction) * math.pi * black
    return PixelRadiation(
        black=black,
        emissivity=emissivity,
        absorptivity=_property_at_pixels(
            view, surfaces, field=_absorptivity(band), xp=xp
        ),
        thermal=thermal,
        sources=sources,
    )


def _irradiation_at_pixels(
    view: View, values: Float[Values, "s k"]
) -> Float[Values, "p k"]:
    """Radiation on fragments to pixels, both in W/m^2, see `facets`."""
    facets = view.facets
    plain = view.means(values)
    if facets is None:
        return plain
    xp = array_namespace(values)
    local_mean = weighted_means(facets.local_mean, values)
    share = xp.asarray(facets.share, values.dtype)[:, :, None]
    joined, alone = (
        (share * weighted_means(corner_weights, values)[facets.corner]).sum(axis=1)
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
