"""`render`: solution and camera in, image out; differentiable in temperatures."""

import math
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
from ..scene.solved_surface import SolvedSurface
from .camera import AbstractCamera
from .view import View, look, standing


DEFAULT_SURROUNDINGS = 293.15
"""Seen in the surface where a scene names neither surroundings nor air [K]."""


def black_radiance(temperature: Float[Array, "*p"]) -> Float[Array, "*p"]:
    """Of a black surface, sigma T^4 / pi [W/(m^2 sr)]."""
    return STEFAN_BOLTZMANN / math.pi * temperature**4


def apparent_temperature(radiance: Float[Array, "*p"]) -> Float[Array, "*p"]:
    """The temperature of a black surface of the same radiance [K]."""
    return (radiance * (math.pi / STEFAN_BOLTZMANN)) ** 0.25


def leaving_radiance(
    temperature: Float[Array, "*p"],
    emissivity: Float[Array, "*p"],
    surroundings: Float[Array, ""],
    reflected_irradiance: Float[Array, "*p"],
) -> Float[Array, "*p"]:
    """Emission plus reflection of a Lambertian surface [W/(m^2 sr)].

    Args:
        temperature: of the surface [K].
        emissivity: of the surface [-].
        surroundings: temperature seen in it [K].
        reflected_irradiance: (1 - a) times the sources' irradiance there [W/m^2].
    """
    own = emissivity * black_radiance(temperature)
    mirrored = (1 - emissivity) * black_radiance(surroundings)
    return own + mirrored + reflected_irradiance / math.pi


def surroundings_temperature(terms: tuple[AbstractTerm, ...]) -> Any:
    """What the surface mirrors: surroundings, else the air all round, else 20 degC."""
    for term in terms:
        if isinstance(term, Surroundings):
            return term.temperature
    for term in terms:
        if isinstance(term, Convection) and term.on is None:
            return term.temperature
    return DEFAULT_SURROUNDINGS


def surroundings_at(
    terms: tuple[AbstractTerm, ...], time: Float[Array, ""]
) -> Float[Array, ""]:
    """The same at one time [K]."""
    return value_at(surroundings_temperature(terms), time)


class Image(eqx.Module):
    """One thermal frame. The background is black surroundings, infinitely far."""

    time: Float[Array, ""]
    """[s]"""
    temperature: Float[Array, "h w"]
    """True, of the surface; of the surroundings in the background [K]."""
    radiance: Float[Array, "h w"]
    """Total, towards the camera, averaged over the pixel [W/(m^2 sr)]."""
    emissivity: Float[Array, "h w"]
    """1 in the background."""
    depth: Float[Array, "h w"]
    """Along the optical axis [m]; inf in the background."""
    object_id: Int[Array, "h w"]
    """Body number; -1 in the background."""
    normal: Float[Array, "h w 3"]
    """World, outward; 0 in the background."""

    @property
    def apparent_temperature(self) -> Float[Array, "h w"]:
        """What a camera set to emissivity 1 shows [K]."""
        return apparent_temperature(self.radiance)


def _per_fragment(
    surfaces: tuple[SolvedSurface, ...], field: str
) -> Float[Array, " s"]:
    return jnp.concatenate(
        [
            jnp.broadcast_to(getattr(s, field), (len(s.geometry.fragment_area),))
            for s in surfaces
        ]
    )


def _spread(view: View, values: Float[Array, " s"]) -> Float[Array, " p"]:
    """Fragment values at the pixels that show a body."""
    weight = jnp.asarray(view.weights.weight, values.dtype)
    return jax.ops.segment_sum(
        weight * values[view.weights.fragment],
        view.weights.pixel,
        num_segments=len(view.pixel),
        indices_are_sorted=True,
    )


def _picture(view: View, values: Array, background: Any) -> Array:
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
    """The frame of one set of surface temperatures [K] at one time [s] in a view."""
    surface = _spread(view, temperature)
    emissivity = _spread(view, _per_fragment(surfaces, "emissivity"))
    absorptivity = _spread(view, _per_fragment(surfaces, "absorptivity"))
    irradiance = jnp.zeros_like(surface)
    for number, exposure in view.exposure:
        strength = value_at(terms[number].strength, time)
        irradiance = irradiance + strength * jnp.asarray(exposure, surface.dtype)
    ambient = surroundings_at(terms, time)
    radiance = leaving_radiance(
        surface, emissivity, ambient, (1 - absorptivity) * irradiance
    )
    dtype = surface.dtype
    return Image(
        time=time,
        temperature=_picture(view, surface, ambient),
        radiance=_picture(view, radiance, black_radiance(ambient)),
        emissivity=_picture(view, emissivity, 1),
        depth=_picture(view, jnp.asarray(view.depth, dtype), np.inf),
        object_id=_picture(view, jnp.asarray(view.body, jnp.int32), -1),
        normal=_picture(view, jnp.asarray(view.normal, dtype), 0),
    )


def coarsen(image: Image, samples: int) -> Image:
    """An image of `samples` times fewer pixels each way.

    A detector integrates radiance over its pixel; the other channels are those of one
    sample near its middle, since a mean of depths or numbers is nothing.
    """
    if samples == 1:
        return image
    height, width = image.radiance.shape
    blocks = image.radiance.reshape(
        height // samples, samples, width // samples, samples
    )
    pick = lambda a: a[samples // 2 :: samples, samples // 2 :: samples]
    return Image(
        time=image.time,
        temperature=pick(image.temperature),
        radiance=blocks.mean(axis=(1, 3)),
        emissivity=pick(image.emissivity),
        depth=pick(image.depth),
        object_id=pick(image.object_id),
        normal=pick(image.normal),
    )


def render(
    solution: AbstractSolution,
    camera: AbstractCamera,
    index: int = -1,
    *,
    smooth: bool = True,
    samples: int = 1,
) -> Image:
    """The thermal image of one saved time.

    Args:
        solution: of `simulate` or `steady`.
        camera: where from.
        index: which saved time, as in a list.
        smooth: whether temperatures are smoothed over the voxels.
        samples: radiance samples a pixel along each axis.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    with precision(solution.receipt.dtype):
        time = float(solution.times[index])
        surfaces, terms = standing(solution.surfaces, solution.terms, time)
        view = look(surfaces, terms, camera.finer(samples), smooth)
        image = draw(
            view,
            surfaces,
            terms,
            jnp.asarray(solution.surface_temperature[index]),
            jnp.asarray(solution.times[index]),
        )
        return coarsen(image, samples)
