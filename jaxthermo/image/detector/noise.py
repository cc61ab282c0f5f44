"""Noise of a detector, and the counts that it reads out."""

import math
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ...arrays import plain_numbers
from ...errors import InputError
from ..radiance.band import Band
from ..radiance.effect import AbstractDetectorEffect
from ..radiance.radiometry import Values, black_radiance, radiance_slope


# No radiance is lower, so that noise on a cold sky has a temperature still.
_LEAST_RADIANCE = 1e-6


def _non_negative(name: str, values: dict[str, float]) -> None:
    for field, value in values.items():
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"{name}({field}={value!r}): give 0 or more")


def _added(radiance: Values, noise: Float[np.ndarray, "h w"]) -> Values:
    xp: Any = np if isinstance(radiance, np.ndarray) else jnp
    return xp.maximum(radiance + noise.astype(radiance.dtype), _LEAST_RADIANCE)


class DetectorNoise(AbstractDetectorEffect):
    """Noise that differs from frame to frame, normal and independent for each pixel.

        sigma_L = NETD dL/dT(T_ref)

    in radiance, so that a cold surface is noisier in kelvin than a warm one.
    """

    rank = 40

    netd: float = eqx.field(static=True, converter=plain_numbers, default=0.05)
    """Noise equivalent temperature difference [K]: 0.03 to 0.06 of uncooled cameras."""
    reference_temperature: float = eqx.field(
        static=True, converter=plain_numbers, default=300.0
    )
    """Temperature of the black surface for which `netd` holds [K]."""
    seed: int = eqx.field(static=True, default=0)
    """Seed; frames of one time and seed have the same noise."""

    def __check_init__(self):
        _non_negative("DetectorNoise", {"netd": self.netd, "seed": self.seed})
        _check_reference("DetectorNoise", self.reference_temperature)

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

    netd: float = eqx.field(static=True, converter=plain_numbers, default=0.02)
    """Standard deviation over the pixels [K]."""
    columns: float = eqx.field(static=True, converter=plain_numbers, default=0.0)
    """Standard deviation over the columns [K]."""
    reference_temperature: float = eqx.field(
        static=True, converter=plain_numbers, default=300.0
    )
    """Temperature of the black surface for which both deviations hold [K]."""
    seed: int = eqx.field(static=True, default=0)
    """Seed: one for each camera."""

    def __check_init__(self):
        numbers = {"netd": self.netd, "columns": self.columns, "seed": self.seed}
        _non_negative("FixedPatternNoise", numbers)
        _check_reference("FixedPatternNoise", self.reference_temperature)

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
        InputError: for a range that is not increasing, or other than 8 to 16 bits.
    """

    rank = 50

    low: float = eqx.field(static=True, converter=plain_numbers)
    """Temperature of a black surface at count 0 [K]."""
    high: float = eqx.field(static=True, converter=plain_numbers)
    """Temperature of a black surface at the last count [K]."""
    bits: int = eqx.field(static=True, default=14)

    def __check_init__(self):
        if not 50 <= self.low < self.high <= 10_000:
            raise InputError(
                f"Counts(low={self.low!r}, high={self.high!r}): give two increasing "
                "temperatures, 50 to 10000 K"
            )
        if not 8 <= self.bits <= 16:
            raise InputError(f"Counts(bits={self.bits!r}): give 8 to 16")

    @override
    def apply(
        self, radiance: Float[Values, "h w"], time: float, band: Band | None
    ) -> Float[Values, "h w"]:
        xp: Any = np if isinstance(radiance, np.ndarray) else jnp
        kelvin = np.array([self.low, self.high])
        ends = black_radiance(kelvin, None) if band is None else band.radiance(kelvin)
        low, high = (np.asarray(end, radiance.dtype) for end in ends)
        step = (high - low) / (2**self.bits - 1)
        return low + xp.round((xp.clip(radiance, low, high) - low) / step) * step


def _check_reference(name: str, kelvin: float) -> None:
    if not 50 <= kelvin <= 10_000:
        raise InputError(
            f"{name}(reference_temperature={kelvin!r}): give kelvin, 50 to 10000"
        )
