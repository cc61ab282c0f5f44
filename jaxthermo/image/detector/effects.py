"""Effects behind the lens: spots of the optics, noise, and counts that are read out."""

import math
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array
from typing_extensions import override

from ...arrays import array_namespace, plain_numbers, product, static_numbers
from ...errors import InputError
from ...temperatures import check_numbers_of_kelvin
from ..radiance.band import Band, Values, black_radiance, radiance_slope
from ..radiance.effect import AbstractBlur, AbstractDetectorEffect
from ..radiance.image import block_means


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

    f_number: float = static_numbers(1.0)
    """N, focal length over aperture [-]."""
    pixel_pitch: float = static_numbers(12e-6)
    """Distance of the detector's pixels [m]."""
    wavelength: float = static_numbers(10e-6)
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


# No radiance is lower, so that noise on a cold sky has a temperature still.
_LEAST_RADIANCE = 1e-6


def _allow_extreme_temperatures() -> Any:
    return eqx.field(static=True, default=False, kw_only=True, repr=False)


def _non_negative(name: str, values: dict[str, float]) -> None:
    for field, value in values.items():
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"{name}({field}={value!r}): give 0 or more")


def _added(radiance: Values, noise: Float[np.ndarray, "h w"]) -> Values:
    xp = array_namespace(radiance)
    return xp.maximum(radiance + noise.astype(radiance.dtype), _LEAST_RADIANCE)


class DetectorNoise(AbstractDetectorEffect):
    """Noise that differs from frame to frame, normal and independent for each pixel.

        sigma_L = NETD dL/dT(T_ref)

    in radiance, so that a cold surface is noisier in kelvin than a warm one.
    """

    rank = 40

    netd: float = static_numbers(0.05)
    """Noise equivalent temperature difference [K]: 0.03 to 0.06 of uncooled cameras."""
    reference_temperature: float = static_numbers(300.0)
    """Temperature of the black surface for which `netd` holds [K]."""
    seed: int = eqx.field(static=True, default=0)
    """Seed; frames of one time and seed have the same noise."""
    allow_extreme_temperatures: bool = _allow_extreme_temperatures()
    """Accept a reference below 150 K, mostly mistaken Celsius, or above 6000 K."""

    def __check_init__(self):
        _non_negative("DetectorNoise", {"netd": self.netd, "seed": self.seed})
        check_numbers_of_kelvin(
            "DetectorNoise",
            self.allow_extreme_temperatures,
            reference_temperature=self.reference_temperature,
        )

    @override
    def apply(
        self, radiance: Float[Values, "h w"], time: float, band: Band | None
    ) -> Float[Values, "h w"]:
        moment = int(np.float64(time).view(np.uint64))
        generator = np.random.Generator(np.random.SFC64([self.seed, moment]))
        sigma = self.netd * radiance_slope(self.reference_temperature, band)
        drawn = generator.standard_normal(radiance.shape, np.float32)
        return _added(radiance, drawn * np.float32(sigma))


class FixedPatternNoise(AbstractDetectorEffect):
    """Offsets of pixels, and of whole columns, which all frames of a camera share."""

    rank = 41

    netd: float = static_numbers(0.02)
    """Standard deviation over the pixels [K]."""
    columns: float = static_numbers(0.0)
    """Standard deviation over the columns [K]."""
    reference_temperature: float = static_numbers(300.0)
    """Temperature of the black surface for which both deviations hold [K]."""
    seed: int = eqx.field(static=True, default=0)
    """Seed: one for each camera."""
    allow_extreme_temperatures: bool = _allow_extreme_temperatures()
    """Accept a reference below 150 K, mostly mistaken Celsius, or above 6000 K."""

    def __check_init__(self):
        numbers = {"netd": self.netd, "columns": self.columns, "seed": self.seed}
        _non_negative("FixedPatternNoise", numbers)
        check_numbers_of_kelvin(
            "FixedPatternNoise",
            self.allow_extreme_temperatures,
            reference_temperature=self.reference_temperature,
        )

    @override
    def apply(
        self, radiance: Float[Values, "h w"], time: float, band: Band | None
    ) -> Float[Values, "h w"]:
        slope = radiance_slope(self.reference_temperature, band)
        pattern = _pattern(
            radiance.shape,
            pixels=self.netd * slope,
            columns=self.columns * slope,
            seed=self.seed,
        )
        return _added(radiance, pattern)


@lru_cache(maxsize=4)
def _pattern(
    shape: tuple[int, int], pixels: float, columns: float, seed: int
) -> Float[np.ndarray, "h w"]:
    """Offsets of pixels and columns of these standard deviations."""
    # Another stream than that of the noise with the same seed.
    generator = np.random.Generator(np.random.SFC64([seed, 0, 1]))
    offsets = generator.standard_normal(shape, np.float32) * np.float32(pixels)
    return offsets + generator.standard_normal(shape[1], np.float32) * np.float32(
        columns
    )


class Counts(AbstractDetectorEffect):
    """Whole counts of radiance between those of two temperatures, as read out.

    What is beyond the range shows its end, as in a camera.

    Raises:
        InputError: for a range that is not increasing, extreme temperatures, or other
            than 8 to 16 bits.
    """

    rank = 50

    low: float = eqx.field(static=True, converter=plain_numbers)
    """Temperature of a black surface at count 0 [K]."""
    high: float = eqx.field(static=True, converter=plain_numbers)
    """Temperature of a black surface at the last count [K]."""
    bits: int = eqx.field(static=True, default=14)
    allow_extreme_temperatures: bool = _allow_extreme_temperatures()
    """Accept ends below 150 K, mostly mistaken Celsius, or above 6000 K."""

    def __check_init__(self):
        check_numbers_of_kelvin(
            "Counts", self.allow_extreme_temperatures, low=self.low, high=self.high
        )
        if not self.low < self.high:
            raise InputError(
                f"Counts(low={self.low!r}, high={self.high!r}): give two increasing "
                "temperatures [K]"
            )
        if not 8 <= self.bits <= 16:
            raise InputError(f"Counts(bits={self.bits!r}): give 8 to 16")

    @override
    def apply(
        self, radiance: Float[Values, "h w"], time: float, band: Band | None
    ) -> Float[Values, "h w"]:
        xp = array_namespace(radiance)
        kelvin = np.array([self.low, self.high])
        ends = black_radiance(kelvin, None) if band is None else band.radiance(kelvin)
        low, high = (np.asarray(end, radiance.dtype) for end in ends)
        step = (high - low) / (2**self.bits - 1)
        return low + xp.round((xp.clip(radiance, low, high) - low) / step) * step
