"""Radiance of black bodies, and of surfaces that emit and reflect.

Radiance that leaves a surface, total over the spectrum [W/(m^2 sr)]:

    L = [eps sigma T^4 + (1 - eps) H + (1 - a) E] / pi,

the emission and the reflected irradiation: H thermal, E of sources, which are those of
the heat balance. A camera set to emissivity 1 shows T_apparent = (pi L / sigma)^(1/4).

Within the band of a detector L_b(T) is the radiance of a black surface, and

    L = eps L_b(T) + (1 - eps) [L_b((H / sigma)^(1/4)) + f E / pi],

f the fraction of a source's spectrum within the band: surfaces reflect there as much as
they do not emit, and surroundings of several temperatures count as their mean. A camera
shows the T at which L_b(T) = L.
"""

import math
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ...constants import STEFAN_BOLTZMANN
from ...physics.radiation.irradiation import Irradiance
from .band import Band


Values = Array | np.ndarray
"""Arrays of JAX where derivatives are taken, else of numpy."""


def black_radiance(
    temperature: Float[Values, "*p"], band: Band | None
) -> Float[Values, "*p"]:
    """Radiance of a black surface [W/(m^2 sr)], total for a band of None."""
    if band is None:
        radiance = STEFAN_BOLTZMANN / math.pi * temperature**4
        on_device = isinstance(radiance, jax.Array)
        return radiance if on_device else np.asarray(radiance)
    if isinstance(temperature, jax.Array):
        return band.radiance(temperature)
    # Of tables, where no derivatives are taken.
    return band.table.radiance(temperature)


def radiance_slope(kelvin: float, band: Band | None) -> float:
    """Derivative of the radiance of a black surface [W/(m^2 sr K)]."""
    if band is None:
        return 4 * STEFAN_BOLTZMANN / math.pi * kelvin**3
    return float(band.slope(kelvin))


def apparent_temperature(
    radiance: Float[Values, "*p"], band: Band | None = None
) -> Float[Values, "*p"]:
    """Temperature of a black surface of the same radiance [K]."""
    if band is None:
        return (radiance * (math.pi / STEFAN_BOLTZMANN)) ** 0.25
    if isinstance(radiance, jax.Array):
        return band.temperature(radiance)
    return band.table.temperature(radiance)


def leaving_radiance(
    temperature: Float[Values, "*p"],
    emissivity: Float[Values, "*p"],
    reflected: Float[Values, "*p"],
    band: Band | None = None,
) -> Float[Values, "*p"]:
    """Radiance of a surface that reflects radiation [W/m^2] in all directions."""
    return emissivity * black_radiance(temperature, band) + reflected / math.pi


def within_band(received: Irradiance, band: Band | None, xp: Any) -> Irradiance:
    """Return the part of the irradiance [W/m^2] within the band."""
    if band is None:
        return received
    # A black body at the mean of what surrounds a surface.
    smallest = np.asarray(1e-12, received.thermal.dtype)
    mean = apparent_temperature(xp.maximum(received.thermal, smallest) / math.pi)
    shares = share(band, received.spectrum)
    return Irradiance(
        math.pi * black_radiance(mean, band),
        received.sources * shares[:, None],
        received.spectrum,
    )


def share(band: Band, spectrum: Any) -> Any:
    """Fractions of the radiation of sources within the band."""
    exact = band.share(spectrum)
    # The laws of a band are in double precision on the host.
    return exact if isinstance(exact, jax.Array) else exact.astype(spectrum.dtype)


class PixelRadiation(NamedTuple):
    """Radiation at the surface points of p pixels, with q sources."""

    black: Float[Values, " p"]
    """Radiance of a black surface of their temperature [W/(m^2 sr)]."""
    emissivity: Float[Values, " p"]
    """Emissivity towards the camera [-]."""
    absorptivity: Float[Values, " p"]
    """Absorptivity of radiation of sources, as seen from the camera [-]."""
    thermal: Float[Values, " p"]
    """Thermal irradiance H [W/m^2]."""
    sources: Float[Values, "q p"]
    """Irradiance E of sources [W/m^2]."""
    diffuse: float = 1.0
    """Fraction of the reflected radiation that leaves in all directions alike [-]."""
    mirrored: Any = 0.0
    """Radiance by reflection around the mirror direction [W/(m^2 sr)]."""

    @property
    def radiance(self) -> Float[Values, " p"]:
        """Radiance towards the camera [W/(m^2 sr)]."""
        reflected = (1 - self.emissivity) * self.thermal
        reflected = reflected + (1 - self.absorptivity) * self.sources.sum(0)
        return (
            self.emissivity * self.black
            + reflected * (self.diffuse / math.pi)
            + self.mirrored
        )
