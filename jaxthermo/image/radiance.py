"""What leaves the surface towards the camera, and what it would be taken for.

L = [eps sigma T^4 + (1 - eps) sigma T_s^4 + (1 - a) E] / pi: emission and the reflected
surroundings and sources of a Lambertian surface, total over the spectrum [W/(m^2 sr)].
A camera that knows no emissivity shows T_apparent = (pi L / sigma)^(1/4).
"""

import math
from typing import Any

from jaxtyping import Array, Float

from ..constants import STEFAN_BOLTZMANN
from ..physics.boundary import Convection
from ..physics.radiation.emission import Surroundings
from ..physics.term import AbstractTerm
from ..physics.time_varying import value_at


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
