"""Optics and pixels: a point becomes a spot, and a pixel integrates over its area."""

import math
from functools import lru_cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array
from typing_extensions import override

from ...arrays import plain_numbers, product
from ...errors import InputError
from ..radiance.effect import AbstractBlur
from ..radiance.image import block_means
from ..radiance.radiometry import Values


# Half width of the spot that is computed [standard deviations].
_HALF_WIDTH = 4.0
# Airy's disc, as a Gaussian of the same core [lambda N].
_AIRY = 0.42


class Blur(AbstractBlur):
    """Gaussian blur of the lens, for instance when it is out of focus.

    Raises:
        InputError: for a standard deviation that is not positive.
    """

    sigma: float = eqx.field(static=True, converter=plain_numbers)
    """Standard deviation [pixels]."""

    def __check_init__(self):
        if not 0 < self.sigma <= 100:
            raise InputError(f"Blur(sigma={self.sigma!r}): give 0 to 100 pixels")

    @property
    @override
    def spread(self) -> float:
        return self.sigma


class DiffractionBlur(AbstractBlur):
    """Blur by the aperture: Airy's disc as a Gaussian, sigma = 0.42 lambda N / pitch.

    Raises:
        InputError: for values that are not positive.
    """

    f_number: float = eqx.field(static=True, converter=plain_numbers, default=1.0)
    """N, focal length over aperture [-]."""
    pixel_pitch: float = eqx.field(static=True, converter=plain_numbers, default=12e-6)
    """Distance of the detector's pixels [m]."""
    wavelength: float = eqx.field(static=True, converter=plain_numbers, default=10e-6)
    """[m]"""

    def __check_init__(self):
        for name in ("f_number", "pixel_pitch", "wavelength"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"DiffractionBlur({name}={value!r}): give more than 0")

    @property
    @override
    def spread(self) -> float:
        return _AIRY * self.wavelength * self.f_number / self.pixel_pitch


def integrate_pixels(
    radiance: Float[Values, "_ _"], samples: int, spread: float
) -> Float[Values, "h w"]:
    """Radiance of pixels: samples of a blurred image, averaged over each pixel.

    Args:
        radiance: of `samples` points along each axis of every pixel.
        samples: along each axis.
        spread: standard deviation of the spot [pixels]; 0 for a sharp image.
    """
    if spread == 0:
        return block_means(radiance, samples)
    rows, columns = (
        _response(count // samples, samples, spread) for count in radiance.shape
    )
    if isinstance(radiance, np.ndarray):
        rows, columns = (
            response.astype(radiance.dtype) for response in (rows, columns)
        )
        return (columns @ np.ascontiguousarray((rows @ radiance).T)).T
    left = jnp.asarray(rows.toarray(), radiance.dtype)
    right = jnp.asarray(columns.toarray(), radiance.dtype)
    return product(product(left, radiance), right.T)


@lru_cache(maxsize=8)
def _response(count: int, samples: int, spread: float) -> csr_array:
    """Weights [pixel, sample] along one axis; what is beyond an edge is as the edge."""
    sigma = spread * samples
    reach = max(1, int(_HALF_WIDTH * sigma + 0.5))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    pixel = np.convolve(kernel / kernel.sum(), np.ones(samples) / samples)
    first = np.arange(count)[:, None] * samples - reach
    column = (first + np.arange(len(pixel))).clip(0, count * samples - 1)
    row = np.repeat(np.arange(count), len(pixel))
    weight = np.broadcast_to(pixel, column.shape)
    entries = weight.ravel(), (row, column.ravel())
    return csr_array(entries, shape=(count, count * samples))
