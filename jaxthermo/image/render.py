"""Thermal images of a solution, differentiable in its temperatures.

Radiance that leaves a Lambertian surface, total over the spectrum [W/(m^2 sr)]:
L = [eps sigma T^4 + (1 - eps) sigma T_s^4 + (1 - a) E] / pi, the emission and the
reflected surroundings (T_s) and sources (E). A camera set to emissivity 1 shows
T_apparent = (pi L / sigma)^(1/4).
"""

import math
from itertools import chain
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import precision
from ..constants import STEFAN_BOLTZMANN
from ..integrate.run.solution import AbstractSolution
from ..physics.boundary import Convection
from ..physics.radiation.emission import Surroundings
from ..physics.term import AbstractTerm
from ..physics.time_varying import value_at
from ..scene.scene import SolvedSurface
from .camera import AbstractCamera
from .view import View, at_time, compute_view


# Reflected temperature [K] of a scene with neither surroundings nor air.
_DEFAULT_SURROUNDINGS = 293.15


def _black_radiance(temperature: Float[Array, "*p"]) -> Float[Array, "*p"]:
    return STEFAN_BOLTZMANN / math.pi * temperature**4


def _apparent_temperature(radiance: Float[Array, "*p"]) -> Float[Array, "*p"]:
    """Temperature of a black surface of the same radiance [K]."""
    return (radiance * (math.pi / STEFAN_BOLTZMANN)) ** 0.25


def _leaving_radiance(
    temperature: Float[Array, "*p"],
    emissivity: Float[Array, "*p"],
    surroundings: Float[Array, ""],
    reflected_irradiance: Float[Array, "*p"],
) -> Float[Array, "*p"]:
    # Of a Lambertian surface [W/(m^2 sr)]; `surroundings` is the reflected temperature
    # [K], `reflected_irradiance` (1 - a) times the sources' irradiance [W/m^2].
    emitted = emissivity * _black_radiance(temperature)
    reflected = (1 - emissivity) * _black_radiance(surroundings)
    return emitted + reflected + reflected_irradiance / math.pi


def _surroundings_at(
    terms: tuple[AbstractTerm, ...], time: Float[Array, ""]
) -> Float[Array, ""]:
    # Where no surroundings are given, objects around have the temperature of the air.
    radiating = (t.temperature for t in terms if isinstance(t, Surroundings))
    air = (t.temperature for t in terms if isinstance(t, Convection) and t.on is None)
    return value_at(next(chain(radiating, air), _DEFAULT_SURROUNDINGS), time)


class Image(eqx.Module):
    """Thermal frame; its background is black surroundings at infinite depth."""

    time: Float[Array, ""]
    """Time [s]."""
    temperature: Float[Array, "h w"]
    """True surface temperature; that of the surroundings in the background [K]."""
    radiance: Float[Array, "h w"]
    """Total radiance towards the camera, averaged over the pixel [W/(m^2 sr)]."""
    emissivity: Float[Array, "h w"]
    """Emissivity [-]; 1 in the background."""
    depth: Float[Array, "h w"]
    """Depth along the optical axis [m]; inf in the background."""
    object_id: Int[Array, "h w"]
    """Number of the body; -1 in the background."""
    normal: Float[Array, "h w 3"]
    """Outward normal in the world; 0 in the background."""

    @property
    def apparent_temperature(self) -> Float[Array, "h w"]:
        """Temperature that a camera set to emissivity 1 shows [K]."""
        return _apparent_temperature(self.radiance)


def _per_fragment(
    surfaces: tuple[SolvedSurface, ...], field: str
) -> Float[Array, " s"]:
    # A body of one material has one number for all fragments.
    shaped = ((getattr(s, field), s.geometry.fragment_area.shape) for s in surfaces)
    return jnp.concatenate([jnp.broadcast_to(*each) for each in shaped])


def _to_pixels(view: View, values: Float[Array, " s"]) -> Float[Array, " p"]:
    # The pixels of the weights are sorted, which lets XLA sum without scattering.
    weight = jnp.asarray(view.weights.weight, values.dtype)
    return jax.ops.segment_sum(
        weight * values[view.weights.fragment],
        view.weights.pixel,
        num_segments=len(view.pixel),
        indices_are_sorted=True,
    )


def _to_image(view: View, values: Array, background: Any) -> Array:
    width, height = view.camera.size
    shape = (height, width, *values.shape[1:])
    blank = jnp.full((shape[0] * shape[1], *values.shape[1:]), background, values.dtype)
    return blank.at[view.pixel].set(values).reshape(shape)


def draw(
    view: View,
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple,
    temperature: Float[Array, " s"],
    time: Float[Array, ""],
) -> Image:
    """Draw the frame of surface temperatures [K] at a time [s] in a view."""
    surface = _to_pixels(view, temperature)
    emissivity = _to_pixels(view, _per_fragment(surfaces, "emissivity"))
    absorptivity = _to_pixels(view, _per_fragment(surfaces, "absorptivity"))
    irradiance = jnp.zeros_like(surface)
    for number, exposure in view.exposure:
        strength = value_at(terms[number].strength, time)
        irradiance = irradiance + strength * jnp.asarray(exposure, surface.dtype)
    ambient = _surroundings_at(terms, time)
    radiance = _leaving_radiance(
        surface, emissivity, ambient, (1 - absorptivity) * irradiance
    )
    dtype = surface.dtype
    return Image(
        time=time,
        temperature=_to_image(view, surface, ambient),
        radiance=_to_image(view, radiance, _black_radiance(ambient)),
        emissivity=_to_image(view, emissivity, 1),
        depth=_to_image(view, jnp.asarray(view.depth, dtype), np.inf),
        object_id=_to_image(view, jnp.asarray(view.body, jnp.int32), -1),
        normal=_to_image(view, jnp.asarray(view.normal, dtype), 0),
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
    return Image(time=image.time, radiance=blocks.mean(axis=(1, 3)), **picked)


def render(
    solution: AbstractSolution,
    camera: AbstractCamera,
    index: int = -1,
    *,
    smooth: bool = True,
    samples: int = 1,
) -> Image:
    """Draw the thermal image of one saved time.

    Args:
        solution: from `simulate` or `steady`.
        camera: position, direction and size of the image.
        index: index of the saved time.
        smooth: interpolate temperatures smoothly over the voxels.
        samples: radiance samples per pixel along each axis.

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
    with precision(solution.receipt.dtype):
        time = float(solution.times[index])
        surfaces, terms = at_time(solution.surfaces, solution.terms, time)
        view = compute_view(surfaces, terms, camera.finer(samples), smooth)
        image = draw(
            view,
            surfaces,
            terms,
            jnp.asarray(solution.surface_temperature[index]),
            jnp.asarray(solution.times[index]),
        )
        return coarsen(image, samples)
