"""Thermal images of a solution, differentiable in its temperatures.

Radiance that leaves a Lambertian surface, total over the spectrum [W/(m^2 sr)]:
L = [eps sigma T^4 + (1 - eps) H + (1 - a) E] / pi, the emission and the reflected
irradiation: H thermal, E of sources, which are those of the heat balance. A camera set
to emissivity 1 shows T_apparent = (pi L / sigma)^(1/4).

Within the band of a detector L_b(T) is the radiance of a black surface, and

    L = eps L_b(T) + (1 - eps) [L_b((H / sigma)^(1/4)) + f E / pi],

f the fraction of a source's spectrum within the band: surfaces reflect there as much as
they do not emit, and surroundings of several temperatures count as their mean. A camera
shows the T at which L_b(T) = L.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ..arrays import is_traced, precision
from ..constants import STEFAN_BOLTZMANN
from ..errors import require
from ..integrate.run.solution import AbstractSolution
from ..physics.radiation.irradiation import Irradiance
from ..physics.radiation.source import AbstractSource
from ..physics.term import AbstractTerm
from ..physics.time_varying import value_at
from ..scene.scene import SolvedSurface, per_fragment
from .background import VisibleSource
from .band import Band
from .camera import AbstractCamera
from .moving_weights import MovingWeights
from .view import View, at_time, kept_view


_Values = Array | np.ndarray
"""Arrays of JAX where derivatives are taken, else of numpy."""


def _black_radiance(
    temperature: Float[_Values, "*p"], band: Band | None
) -> Float[_Values, "*p"]:
    if band is None:
        return STEFAN_BOLTZMANN / math.pi * temperature**4
    if isinstance(temperature, jax.Array):
        return band.radiance(temperature)
    return band.table.radiance(temperature)


def _apparent_temperature(
    radiance: Float[_Values, "*p"], band: Band | None = None
) -> Float[_Values, "*p"]:
    """Temperature of a black surface of the same radiance [K]."""
    if band is None:
        return (radiance * (math.pi / STEFAN_BOLTZMANN)) ** 0.25
    if isinstance(radiance, jax.Array):
        return band.temperature(radiance)
    # Of tables, where no derivatives are taken.
    return band.table.temperature(radiance)


def _leaving_radiance(
    temperature: Float[_Values, "*p"],
    emissivity: Float[_Values, "*p"],
    reflected: Float[_Values, "*p"],
    band: Band | None = None,
) -> Float[_Values, "*p"]:
    # Of a Lambertian surface [W/(m^2 sr)] that reflects radiation [W/m^2].
    return emissivity * _black_radiance(temperature, band) + reflected / math.pi


def _reflected(
    surfaces: tuple[SolvedSurface, ...],
    received: Irradiance,
    band: Band | None,
    xp: Any,
) -> tuple[_Values, _Values]:
    """Radiation that fragments reflect, and its part from sources [W/m^2]."""
    emissivity = per_fragment(surfaces, "emissivity", xp)
    if band is None:
        return received.reflected(
            emissivity, per_fragment(surfaces, "absorptivity", xp)
        )
    # A black body at the mean of what surrounds a surface.
    least = np.asarray(1e-12, received.thermal.dtype)
    mean = _apparent_temperature(xp.maximum(received.thermal, least) / math.pi)
    shares = _share(band, received.spectrum)
    seen = Irradiance(
        math.pi * _black_radiance(mean, band),
        received.sources * shares[:, None],
        received.spectrum,
    )
    return seen.reflected(emissivity, emissivity)


def _share(band: Band, spectrum: Any) -> Any:
    """Fractions of the radiation of sources within the band."""
    exact = band.share(spectrum)
    # The laws of a band are in double precision on the host.
    return exact if isinstance(exact, jax.Array) else exact.astype(spectrum.dtype)


class Image(eqx.Module):
    """Thermal frame; its background is the sky and the ground at infinite depth.

    A source is drawn as a black surface of its radiance.
    """

    time: Float[Array, ""]
    """Time [s]."""
    temperature: Float[_Values, "h w"]
    """True surface temperature; that of sky or ground in the background [K]."""
    radiance: Float[_Values, "h w"]
    """Radiance towards the camera, averaged over the pixel, total or within the band
    [W/(m^2 sr)]."""
    emissivity: Float[_Values, "h w"]
    """Emissivity [-]; 1 in the background and of a source."""
    depth: Float[_Values, "h w"]
    """Depth along the optical axis [m]; inf in the background."""
    object_id: Int[_Values, "h w"]
    """Number of the body; -1 in the background and of a source."""
    normal: Float[_Values, "h w 3"]
    """Outward normal in the world; 0 in the background and of a source."""
    band: Band | None = eqx.field(static=True, default=None)
    """Band of the detector; None for all wavelengths."""

    @property
    def apparent_temperature(self) -> Float[_Values, "h w"]:
        """Temperature that a camera set to emissivity 1 shows [K]."""
        return _apparent_temperature(self.radiance, self.band)


def _means(weights: csr_array | MovingWeights, values: _Values) -> _Values:
    """Weighted means of the fragments of each row, [s, k] to [p, k]."""
    if isinstance(weights, MovingWeights):
        return weights.means(jnp.asarray(values))
    count = len(weights.indptr) - 1
    if isinstance(values, np.ndarray):
        return (weights @ values).astype(values.dtype)
    row = np.repeat(np.arange(count), np.diff(weights.indptr))
    each = jnp.asarray(weights.data, values.dtype)[:, None] * values[weights.indices]
    # The rows of the weights are sorted, which lets XLA sum without scattering.
    return jax.ops.segment_sum(each, row, count, indices_are_sorted=True)


def _replaced(values: _Values, where: Any, new: Any) -> _Values:
    """An array with new values at some places."""
    if not isinstance(values, np.ndarray):
        return values.at[where].set(new)
    values = values.copy()
    values[where] = new
    return values


def _irradiation_to_pixels(view: View, values: _Values) -> _Values:
    """Radiation on fragments [s, k] to pixels [p, k] in W/m^2, see `facets`."""
    plain, facets = _means(view.weights, values), view.facets
    if facets is None:
        return plain
    xp: Any = np if isinstance(values, np.ndarray) else jnp
    own = _means(facets.own, values)
    share = xp.asarray(facets.share, values.dtype)[:, :, None]
    joined, alone = (
        (share * _means(each, values)[facets.corner]).sum(axis=1)
        for each in (facets.joined, facets.alone)
    )
    scale = xp.minimum(own / xp.where(alone > 0, alone, 1), 1)
    smooth = own + xp.where(alone > 0, scale, 1) * (joined - alone)
    return _replaced(plain, facets.point, smooth)


def draw(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    temperature: _Values,
    received: Irradiance | None,
    time: Float[Array, ""],
    load_time: Float[Array, ""] | None = None,
    band: Band | None = None,
) -> Image:
    """Draw the frame of surfaces in a view.

    Args:
        view: of a camera on the scene.
        surfaces: of the bodies.
        terms: of the scene, for sky, ground and sources.
        temperature: of the surfaces [K].
        received: radiation that reaches them; None for none.
        time: of the frame [s].
        load_time: time of the values of sky, ground and sources [s]; `time` if None.
        band: of the detector; None for all wavelengths.
    """
    load_time = time if load_time is None else load_time
    # Derivatives need JAX, which otherwise would compile a program for every view.
    traced = is_traced((temperature, received, load_time, terms, surfaces))
    xp: Any = jnp if traced else np
    columns = xp.stack(
        [xp.asarray(temperature), per_fragment(surfaces, "emissivity", xp)], axis=1
    )
    surface, emissivity = _means(view.weights, columns).T
    back: Any = xp.zeros_like(surface)
    if received is not None:
        given = Irradiance(*(xp.asarray(each) for each in received))
        reflected, lit = _reflected(surfaces, given, band, xp)
        # Of the sources alone only where the rest is hidden.
        hidden = view.open_fraction is not None
        parts = xp.stack([reflected, lit] if hidden else [reflected], axis=1)
        back, *lit_pixels = _irradiation_to_pixels(view, parts).T
        if hidden:
            # Sources have their own shadows: what is hidden is thermal radiation, and
            # what hides it is as warm as the surface, as in `Surroundings`.
            direct = sum(lit_pixels)
            seen = xp.asarray(view.open_fraction, surface.dtype)
            own = (1 - emissivity) * math.pi * _black_radiance(surface, band)
            back = direct + seen * (back - direct) + (1 - seen) * own
    radiance = _leaving_radiance(surface, emissivity, back, band)
    behind = view.background.temperature(terms, load_time)
    behind = xp.asarray(behind).reshape(-1)
    width, height = view.camera.size

    def frame(values: Any, background: Any, dtype: Any = surface.dtype) -> _Values:
        """Image of pixel values, with a background behind the bodies."""
        blank = xp.asarray(background, dtype)
        blank = xp.broadcast_to(blank, (height * width, *values.shape[1:]))
        filled = _replaced(blank, view.pixel, xp.asarray(values, dtype))
        return filled.reshape(height, width, *values.shape[1:])

    image = Image(
        time=time,
        temperature=frame(surface, behind),
        radiance=frame(radiance, _black_radiance(behind, band)),
        emissivity=frame(emissivity, 1),
        depth=frame(view.depth, np.inf),
        object_id=frame(view.body, -1, np.int32),
        normal=frame(view.normal, 0),
        band=band,
    )
    for visible in view.background.sources:
        source = terms[visible.number]
        assert isinstance(source, AbstractSource)
        strength = xp.asarray(value_at(source.strength, load_time))
        if band is not None:
            spectrum = xp.asarray(value_at(source.spectrum, load_time))
            strength = strength * _share(band, spectrum)
        image = _with_source(image, visible, strength)
    return image


def _with_source(image: Image, source: VisibleSource, strength: _Values) -> Image:
    """The frame with a source in front; without it where it is switched off."""
    xp: Any = np if isinstance(strength, np.ndarray) else jnp
    radiance = strength * xp.asarray(source.radiance, image.radiance.dtype)
    where = np.divmod(source.pixel, image.radiance.shape[1])

    def over(below: _Values, value: Any) -> _Values:
        old = below[where]
        on = (radiance > 0).reshape(-1, *(1,) * (old.ndim - 1))
        new = xp.where(on, xp.asarray(value, old.dtype), old)
        return _replaced(below, where, new)

    return Image(
        time=image.time,
        temperature=over(
            image.temperature, _apparent_temperature(radiance, image.band)
        ),
        radiance=over(image.radiance, radiance),
        emissivity=over(image.emissivity, 1),
        depth=over(image.depth, source.depth),
        object_id=over(image.object_id, -1),
        normal=over(image.normal, 0),
        band=image.band,
    )


def coarsen(image: Image, samples: int) -> Image:
    """Reduce an image by the factor `samples` along both axes."""
    # A detector integrates radiance over its pixel. The mean of depths or body numbers
    # over an edge would be meaningless: these are of one sample near the middle.
    if samples == 1:
        return image
    height, width = image.radiance.shape
    blocks = image.radiance.reshape(
        height // samples, samples, width // samples, samples
    )
    middle = slice(samples // 2, None, samples)
    picked = {
        name: getattr(image, name)[middle, middle]
        for name in ("temperature", "emissivity", "depth", "object_id", "normal")
    }
    mean = blocks.mean(axis=(1, 3))
    return Image(time=image.time, radiance=mean, band=image.band, **picked)


def render(
    solution: AbstractSolution,
    camera: AbstractCamera,
    index: int = -1,
    *,
    smooth: bool = True,
    samples: int = 1,
    occlusion: float | None = None,
    band: Band | None = None,
) -> Image:
    """Draw the thermal image of one saved time.

    Args:
        solution: from `simulate` or `steady`.
        camera: position, direction and size of the image.
        index: index of the saved time.
        smooth: interpolate temperatures smoothly over the voxels.
        samples: radiance samples per pixel along each axis.
        occlusion: distance within which surfaces in the image hide the surroundings
            from what others reflect [m], for scenes whose terms do not detect it.
        band: of the detector, such as `Band((7.5e-6, 14e-6))`; None for the radiance of
            all wavelengths, in which the sun is as bright as it heats.

    Raises:
        InputError: if the camera is inside a body or sees none.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> warm = jt.steady(jt.Scene((body,), (jt.Convection(10.0, 290.0),)))
        >>> camera = jt.Camera((0.2, -0.2, 0.1), (0.0, 0.0, 0.0), width=32, height=24)
        >>> jt.render(warm, camera).temperature.shape  # rows, columns
        (24, 32)
    """
    solutions = "a solution of simulate or steady"
    require(solution, AbstractSolution, "render(solution=)", solutions)
    cameras = "a Camera or an OrthographicCamera"
    require(camera, AbstractCamera, "render(camera=)", cameras)
    if band is not None:
        require(band, Band, "render(band=)", "a Band, such as Band((7.5e-6, 14e-6))")
    with precision(solution.receipt.dtype):
        time = float(solution.times[index])
        surfaces, terms = at_time(solution.surfaces, solution.terms, time)
        view = kept_view(surfaces, terms, camera.finer(samples), smooth, occlusion)
        image = draw(
            view,
            surfaces,
            terms,
            jnp.asarray(solution.surface_temperature[index]),
            solution.irradiance(index),
            jnp.asarray(solution.times[index]),
            solution.load_time(index),
            band,
        )
        return coarsen(image, samples)
