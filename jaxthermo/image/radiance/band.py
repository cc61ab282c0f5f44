"""Radiance within the band of a detector, and the temperature that shows a radiance.

Planck's law, weighted by the response R of a detector to each wavelength:

    L(T) = int R(l) c1 / l^5 / (exp(c2 / (l T)) - 1) dl    [W/(m^2 sr)],

c1 = 2 h c^2 and c2 = h c / k (CODATA 2018). R is 1 within a band of two ends, else
linear between the wavelengths of a table. Its inverse is the brightness temperature,
by Newton's method on ln L over 1 / T, which is nearly a straight line. A band of None
stands for all wavelengths: L = sigma T^4 / pi.
"""

import math
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Numbers, array_namespace
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from .response import BANDS, checked_response


_C1 = 1.191042972397188e-16
_C2 = 1.438776877503933e-2
"""2 h c^2 [W m^2 / sr] and h c / k [m K]."""

MIN_BRIGHTNESS_TEMPERATURE = 50.0
_MAX_BRIGHTNESS_TEMPERATURE = 10_000.0
"""Range of brightness temperatures [K]."""

# Points of Gauss in a band of two ends, and in each interval of a table.
_POINTS = 32
_POINTS_OF_TABLE = 6
# More than any exponent of interest, and no overflow in float32.
_MAX_EXPONENT = 85.0
# Smaller radiances have no logarithm in float32.
_LEAST = 1e-37
_ROWS = 2**15
_NEWTON_STEPS = 3

Values = Array | np.ndarray
"""Arrays of JAX where derivatives are taken, else of numpy."""


class Band:
    """Band of a detector: two wavelengths, or a table of its response to several.

    Example:
        >>> import jaxthermo as jt
        >>> longwave = jt.Band((7.5e-6, 14e-6))
        >>> round(float(longwave.radiance(300.0)), 4)
        59.3117
        >>> round(float(longwave.temperature(60.0)), 4)
        300.7388
    """

    def __init__(self, wavelengths: Numbers, response: Numbers | None = None):
        """Make a band of wavelengths [m] and, at each of them, the response in [0, 1].

        Raises:
            InputError: for wavelengths or responses that are none, or a band without
                energy.
        """
        edges, values = checked_response(wavelengths, response)
        self.wavelengths = tuple(edges.tolist())
        self.response = tuple(values.tolist())
        count = _POINTS if len(edges) == 2 else _POINTS_OF_TABLE
        at, weight = np.polynomial.legendre.leggauss(count)
        middle = (edges[1:] + edges[:-1]) / 2
        half = np.diff(edges) / 2
        points = middle[:, None] + half[:, None] * at
        received = np.interp(points, edges, values) * half[:, None] * weight
        self._rate = _C2 / points.ravel()
        self._weight = (_C1 * received / points**5).ravel()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Band) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return self.wavelengths, self.response

    def __repr__(self) -> str:
        low, high = (1e6 * self.wavelengths[end] for end in (0, -1))
        return f"Band({low:g} to {high:g} um)"

    def radiance(self, temperature: Any) -> Float[Values, "..."]:
        """Radiance of a black surface at temperatures [K]: L(T) [W/(m^2 sr)]."""
        if isinstance(temperature, jax.Array):
            return _radiance(self, temperature)
        return self._sums(np.asarray(temperature, float), np)[0]

    def slope(self, temperature: Any) -> Float[Values, "..."]:
        """Derivative dL/dT at temperatures [K], in W/(m^2 sr K)."""
        xp = array_namespace(temperature)
        return self._sums(xp.asarray(temperature), xp)[1]

    def temperature(self, radiance: Any) -> Float[Values, "..."]:
        """Brightness temperature of radiances [W/(m^2 sr)], in K.

        Raises:
            InputError: for a concrete radiance of less than 50 K or more than 10 000 K;
                a traced one shows the nearer of them.
        """
        if isinstance(radiance, jax.Array):
            return _temperature(self, radiance)
        radiances = np.asarray(radiance, float)
        low, high = self.radiance(np.array(_RANGE))
        inside = (radiances >= low * (1 - 1e-9)) & (radiances <= high * (1 + 1e-9))
        if not inside.all():
            raise InputError(
                f"Band.temperature: {radiances[~inside].flat[0]:g} W/(m^2 sr) is "
                f"not of a black surface between {_RANGE[0]:g} and {_RANGE[1]:g} K in "
                f"{self!r} ({low:.3g} to {high:.3g})"
            )
        return np.asarray(self._inverse(radiances, np))

    def share(self, temperature: Any) -> Any:
        """Fraction of the radiation of black bodies [K] within the band, by R."""
        total = STEFAN_BOLTZMANN / np.pi * temperature**4
        return self.radiance(temperature) / total

    @cached_property
    def table(self) -> "_BandTable":
        """Table of L(T) and its inverse for images: accurate to 1 mK, and fast."""
        low, high = np.log(_RANGE)
        log_t = np.linspace(low, high, _ROWS)
        return _BandTable(log_t, np.log(self._sums(np.exp(log_t), np)[0]))

    def _sums(self, kelvin: Any, xp: Any) -> tuple[Any, Any]:
        """L and dL/dT."""
        # As an outer product, with no array larger than it.
        kelvin = xp.asarray(kelvin)[..., None]
        rate, weight = (xp.asarray(v, kelvin.dtype) for v in (self._rate, self._weight))
        rate = rate.reshape((1,) * (kelvin.ndim - 1) + rate.shape)
        exponent = xp.minimum(rate / kelvin, _MAX_EXPONENT)
        grown = xp.expm1(exponent)
        contribution = weight.reshape(rate.shape) / grown
        # Not 1 / (1 - exp(-x)): with expm1 of both signs XLA's compiled product was
        # wrong by a factor of 60 to 180 on CPUs (jax 0.10.2), while each part was not.
        grows = contribution * (1 + 1 / grown) * exponent / kelvin
        return xp.asarray(contribution.sum(-1)), xp.asarray(grows.sum(-1))

    def _inverse(self, radiance: Any, xp: Any) -> Any:
        # Plain numbers, which leave the precision of the radiances as it is.
        low, high = np.log(self.radiance(np.array(_RANGE))).tolist()
        log_l = xp.clip(xp.log(xp.maximum(radiance, _LEAST)), low, high)
        start = (xp.asarray(column, log_l.dtype) for column in self._start)
        kelvin = 1 / xp.interp(log_l, *start)
        for _ in range(_NEWTON_STEPS):
            value, slope = self._sums(kelvin, xp)
            # In 1 / T: d ln L / d(1 / T) = -T^2 L' / L.
            step = (xp.log(value) - log_l) * value / (slope * kelvin**2)
            kelvin = 1 / (1 / kelvin + step)
        return kelvin

    @cached_property
    def _start(self) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of radiances, and 1 / T there."""
        one_over = np.linspace(1 / _RANGE[0], 1 / _RANGE[1], 2048)
        return np.log(self._sums(1 / one_over, np)[0]), one_over


LONG_WAVE = Band(BANDS["long-wave"])
"""Band of most uncooled cameras, that of images if none is given."""

_RANGE = MIN_BRIGHTNESS_TEMPERATURE, _MAX_BRIGHTNESS_TEMPERATURE


# The derivatives of Planck's law, and of its inverse, in closed form.
@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _radiance(band: Band, temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    return band._sums(temperature, jnp)[0]


@_radiance.defjvp
def _radiance_jvp(band, primals, tangents):
    value, slope = band._sums(primals[0], jnp)
    return value, slope * tangents[0]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _temperature(band: Band, radiance: Float[Array, "..."]) -> Float[Array, "..."]:
    return band._inverse(radiance, jnp)


@_temperature.defjvp
def _temperature_jvp(band, primals, tangents):
    kelvin = _temperature(band, primals[0])
    return kelvin, tangents[0] / band.slope(kelvin)


class _BandTable(NamedTuple):
    """L(T) and its inverse from a table of their logarithms, for arrays of numpy."""

    log_temperature: Float[np.ndarray, " k"]
    log_radiance: Float[np.ndarray, " k"]

    def radiance(self, kelvin: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Radiance of a black surface at temperatures [K], in W/(m^2 sr)."""
        return _looked_up(kelvin, self.log_temperature, self.log_radiance)

    def temperature(
        self, radiance: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """Brightness temperature of radiances [W/(m^2 sr)], in K."""
        return _looked_up(radiance, self.log_radiance, self.log_temperature)


def _looked_up(
    values: Float[np.ndarray, "..."],
    log_inputs: Float[np.ndarray, " k"],
    log_outputs: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "..."]:
    """Values of one logarithmic column by those of the other, in the type given."""
    numbers = np.asarray(values)
    logs = np.log(np.maximum(numbers, _LEAST), dtype=float)
    return np.asarray(np.exp(np.interp(logs, log_inputs, log_outputs)), numbers.dtype)


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
