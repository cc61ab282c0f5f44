"""Surroundings of the bodies that a camera sees: sky, ground, and sources."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...arrays import HostTime, Time, is_traced
from ...physics.boundary import Convection
from ...physics.convection.free_convection import FreeConvection
from ...physics.convection.wind import Wind
from ...physics.radiation.emission import AbstractSurroundings
from ...physics.radiation.source import AbstractSource
from ...physics.term import AbstractTerm
from ...physics.time_varying import value_at
from .abstract_camera import AbstractCamera


# Temperature behind the bodies [K] of a scene with neither radiation nor air.
_DEFAULT_BACKGROUND = 293.15

# Rays this close to level look at the sky; rounding must not make them see the ground.
_LEVEL = 1e-9


class VisibleSource(NamedTuple):
    """The pixels in which a source is the nearest thing."""

    number: int
    """Number of the source among the terms."""
    pixel: Int[np.ndarray, " p"]
    """Index of each pixel, rows first."""
    depth: Float[np.ndarray, " p"]
    """Depth along the optical axis [m]; inf for the sun."""
    radiance: Float[np.ndarray, " p"]
    """Radiance towards the camera for a unit of the source's strength."""


class Background(NamedTuple):
    """Surroundings behind or before the bodies, at all times if nothing moves."""

    below: Bool[np.ndarray, " n"] | None
    """Pixels whose ray goes down, to the ground; None where it looks like the sky."""
    sources: tuple[VisibleSource, ...]

    def of(self, sky: Any, ground: Any) -> Float[Array | np.ndarray, "*n"]:
        """Values of sky and ground at the pixels; one value if they are equal."""
        if self.below is None:
            return sky
        if is_traced((sky, ground)):
            return jnp.where(jnp.asarray(self.below), ground, sky)
        # Without a program for every size of an image.
        return np.where(self.below, np.asarray(ground), np.asarray(sky))


def _number_at(value: Any, time: Time | HostTime) -> Any:
    # Numbers stay on the host, where an image is drawn without derivatives.
    plain = isinstance(value, int | float | np.generic)
    return np.asarray(value, time.dtype) if plain else value_at(value, time)


def _horizon(terms: tuple[AbstractTerm, ...]) -> tuple[Any, Any]:
    """Temperatures of sky and ground [K], each a number or a function of time."""
    for term in terms:
        if isinstance(term, AbstractSurroundings):
            sky = term.temperature
            return sky, sky if term.ground is None else term.ground
    # Without radiation in the balance nothing is reflected from there.
    for term in terms:
        if isinstance(term, Convection | Wind | FreeConvection) and term.on is None:
            return term.temperature, term.temperature
    return _DEFAULT_BACKGROUND, _DEFAULT_BACKGROUND


def horizon_at(
    terms: tuple[AbstractTerm, ...], time: Time | HostTime
) -> tuple[Any, Any]:
    """Temperatures of sky and ground behind the bodies [K]."""
    sky, ground = (_number_at(temperature, time) for temperature in _horizon(terms))
    return sky, ground


def compute_background(
    terms: tuple[AbstractTerm, ...],
    camera: AbstractCamera,
    pixel: Int[np.ndarray, " p"],
    depth: Float[np.ndarray, " p"],
) -> Background:
    """Find what is visible around the bodies, which pixels show at depths [m]."""
    sky, ground = _horizon(terms)
    sources = [(n, t) for n, t in enumerate(terms) if isinstance(t, AbstractSource)]
    if ground is sky and not sources:
        return Background(None, ())
    nearest = camera.frame_of(pixel, depth, np.inf).ravel()
    visible = []
    for number, source in sources:
        # Without a cone of directions every ray is searched.
        cone = source.cone
        cone_pixels = None if cone is None else camera.pixels_towards(*cone)
        radiance, away = source.appearance(*camera.rays(cone_pixels))
        body_depth = nearest if cone_pixels is None else nearest[cone_pixels]
        # The sun, at infinite depth, is behind all that has one.
        free = (away < body_depth) | (np.isinf(away) & np.isinf(body_depth))
        seen = np.flatnonzero((radiance > 0) & free)
        if len(seen):
            where = seen if cone_pixels is None else cone_pixels[seen]
            visible.append(
                VisibleSource(
                    number=number,
                    pixel=where,
                    depth=away[seen],
                    radiance=radiance[seen],
                )
            )
    # The nearest of several sources is drawn last.
    visible.sort(key=lambda source_pixels: -float(source_pixels.depth.min()))
    below = None if ground is sky else camera.rays()[1][:, 2] < -_LEVEL
    return Background(below, tuple(visible))
