"""Air between a surface and the camera: it absorbs radiation and emits its own."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..surface.view import View
from .band import Band, Values, black_radiance
from .effect import AbstractPathEffect, check_range


# FLIR's model of long-wave transmission (the constants of gtatters/Thermimage).
_X = 1.9
_ALPHA = 0.006569, 0.01262
_BETA = -0.002276, -0.00667
_WATER = 1.5587, 0.06939, -2.7816e-4, 6.8455e-7


def transmissivity(distance: Any, temperature: Any, relative_humidity: Any, xp: Any):
    """Transmissivity of air for long-wave cameras, FLIR's empirical formula [-].

        tau = X exp(-sqrt(d) (a1 + b1 sqrt(w)))
            + (1 - X) exp(-sqrt(d) (a2 + b2 sqrt(w)))

    with the water content w by the temperature [K] and the relative humidity.

    Args:
        distance: path length [m].
        temperature: of the air [K].
        relative_humidity: of the air, 0 to 1.
        xp: numpy, or its twin in JAX.
    """
    celsius = temperature - 273.15
    a, b, c, d = _WATER
    exponent = a + celsius * (b + celsius * (c + celsius * d))
    root = xp.sqrt(relative_humidity * xp.exp(exponent))
    far = xp.sqrt(distance)
    (a1, a2) = _ALPHA
    (b1, b2) = _BETA
    near = xp.exp(-far * (a1 + b1 * root))
    return _X * near + (1 - _X) * xp.exp(-far * (a2 + b2 * root))


class Atmosphere(AbstractPathEffect):
    """Air that dims a surface and adds its own radiation.

        L = tau L_surface + (1 - tau) L_b(T_air)

    Sky and ground behind the bodies are as they are given: temperatures that a camera
    shows there. The formula for tau is one of long-wave cameras; give a transmissivity
    for others.

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

    def __check_init__(self):
        check_range(self, "temperature", 150, 400, ", K")
        for name in ("relative_humidity", "transmissivity"):
            check_range(self, name, 0, 1, ", a fraction")

    @override
    def prepared(self, view: View, xp: Any) -> Any:
        if self.transmissivity is not None:
            return xp.asarray(self.transmissivity)
        distance = view.sight.distance
        return transmissivity(
            xp.asarray(distance),
            temperature=self.temperature,
            relative_humidity=self.relative_humidity,
            xp=xp,
        )

    @override
    def apply(
        self, radiance: Float[Values, " p"], prepared: Any, band: Band | None
    ) -> Float[Values, " p"]:
        plain = isinstance(self.temperature, int | float)
        xp: Any = np if plain else jnp
        air = black_radiance(xp.asarray(self.temperature, radiance.dtype), band)
        return prepared * radiance + (1 - prepared) * air
