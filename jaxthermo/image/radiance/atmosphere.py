"""Air between a surface and the camera: it absorbs radiation and emits its own."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ...arrays import array_namespace
from ..surface.view import View
from .band import Band, Values, apparent_temperature, black_radiance
from .effect import AbstractPathEffect, check_range


_WATER = 1.5587, 0.06939, -2.7816e-4, 6.8455e-7


@dataclass(frozen=True)
class AirConstants:
    """Constants of FLIR's law of air, see `transmissivity` and `Atmosphere`.

    The defaults are those of most long-wave cameras (gtatters/Thermimage); each file
    of a camera has its own.
    """

    x: float = 1.9
    """Weight of the first exponential [-]."""
    alpha1: float = 0.006569
    """Attenuation of dry air in the first exponential [m^-1/2]."""
    alpha2: float = 0.01262
    """Attenuation of dry air in the second exponential [m^-1/2]."""
    beta1: float = -0.002276
    """Attenuation by the square root of the water content, in the first exponential."""
    beta2: float = -0.00667
    """Attenuation by the square root of the water content, in the second one."""
    b: float = 1501.0
    """Constant B of the counts that air mixes, see `FlirCalibration` [K]."""


LONG_WAVE_AIR = AirConstants()
"""Constants of most long-wave cameras."""


def transmissivity(
    distance: Any,
    temperature: Any,
    relative_humidity: Any,
    xp: Any,
    constants: AirConstants = LONG_WAVE_AIR,
):
    """Transmissivity of air for long-wave cameras, FLIR's empirical formula [-].

        tau = X exp(-sqrt(d) (a1 + b1 sqrt(w)))
            + (1 - X) exp(-sqrt(d) (a2 + b2 sqrt(w)))

    with the water content w by the temperature [K] and the relative humidity.

    Args:
        distance: path length [m].
        temperature: of the air [K].
        relative_humidity: of the air, 0 to 1.
        xp: numpy, or its twin in JAX.
        constants: X, a1, a2, b1 and b2.
    """
    celsius = temperature - 273.15
    a, b, c, d = _WATER
    exponent = a + celsius * (b + celsius * (c + celsius * d))
    root = xp.sqrt(relative_humidity * xp.exp(exponent))
    far = xp.sqrt(distance)
    first = xp.exp(-far * (constants.alpha1 + constants.beta1 * root))
    second = xp.exp(-far * (constants.alpha2 + constants.beta2 * root))
    return constants.x * first + (1 - constants.x) * second


def half_path_transmissivity(
    distance: Any,
    temperature: Any,
    relative_humidity: Any,
    xp: Any,
    constants: AirConstants = LONG_WAVE_AIR,
):
    """Transmissivity of half of the air between an object and a camera [-].

        tau_half = tau(d / 2),    tau_path = tau_half^2

    A camera's window stands half way, and its software squares the value of half the
    distance also without one. The formula is not that of an exponential law: for 20 m
    tau(d / 2)^2 is 0.02 less than tau(d). The arguments are those of `transmissivity`,
    with the distance of the object.

    Source: gtatters/Thermimage, raw2temp.
    """
    return transmissivity(
        distance / 2,
        temperature=temperature,
        relative_humidity=relative_humidity,
        xp=xp,
        constants=constants,
    )


class Atmosphere(AbstractPathEffect):
    """Air that dims a surface and adds its own radiation.

        S = tau S(T_surface) + (1 - tau) S(T_air),    S(T) = 1 / (exp(B / T) - 1)

    with tau by the distance, that of `half_path_transmissivity` squared, and apparent
    temperatures: the law of FLIR's cameras, in their counts, so that
    `FlirCalibration.object_temperature` finds the temperatures again. It is one of
    long-wave cameras. A transmissivity that is given holds in the band of the image,

        L = tau L_surface + (1 - tau) L_b(T_air).

    Sky and ground behind the bodies are as they are given: temperatures that a camera
    shows there.

    Raises:
        InputError: for values beyond their range.
    """

    rank = 10

    temperature: Any
    """Temperature of the air [K]."""
    relative_humidity: Any = 0.5
    """Relative humidity, 0 to 1."""
    transmissivity: Any = None
    """Transmissivity of the whole path [-], instead of that by the distance."""
    constants: AirConstants = eqx.field(static=True, default=LONG_WAVE_AIR)
    """Constants of the camera's formula."""

    def __check_init__(self):
        check_range(self, "temperature", 150, 400, ", K")
        for name in ("relative_humidity", "transmissivity"):
            check_range(self, name, 0, 1, ", a fraction")

    @override
    def prepared(self, view: View, xp: Any) -> Any:
        if self.transmissivity is not None:
            return xp.asarray(self.transmissivity)
        half = half_path_transmissivity(
            xp.asarray(view.sight.distance),
            temperature=self.temperature,
            relative_humidity=self.relative_humidity,
            xp=xp,
            constants=self.constants,
        )
        return half**2

    @override
    def apply(
        self, radiance: Float[Values, " p"], prepared: Any, band: Band | None
    ) -> Float[Values, " p"]:
        plain = isinstance(self.temperature, int | float)
        xp: Any = np if plain else jnp
        air_temperature = xp.asarray(self.temperature, radiance.dtype)
        if self.transmissivity is not None:
            air = black_radiance(air_temperature, band)
            return prepared * radiance + (1 - prepared) * air
        xp = array_namespace((radiance, air_temperature))
        b = self.constants.b
        surface_signal = 1 / (xp.exp(b / apparent_temperature(radiance, band)) - 1)
        air_signal = 1 / (xp.exp(b / air_temperature) - 1)
        signal = prepared * surface_signal + (1 - prepared) * air_signal
        return black_radiance(b / xp.log(1 + 1 / signal), band)
