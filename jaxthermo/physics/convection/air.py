"""Dry air at 1 atm, 200 to 1500 K, and polynomials in the film temperature.

    ln y = sum_i c_i x^i,    x = ln(T / 300 K)

fitted to CoolProp 8 (Lemmon et al. 2000; Lemmon and Jacobsen 2004). Largest relative
errors over the range: 8e-5 for nu, 7e-5 for k, 1.6e-3 for Pr (Sutherland's formulas:
up to 7 %). Outside the range the value at its end applies. The kinematic viscosity is
inversely proportional to the pressure.

A heat transfer coefficient is tabulated at five film temperatures from 200 to 1000 K
and interpolated by the polynomial through them in 1 / (T_f + 600 K).
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import polynomial

from ...arrays import product


# Range of the fits [K].
_MIN_AIR_TEMPERATURE = 200.0
_MAX_AIR_TEMPERATURE = 1500.0

_NU = (-11.0587, 1.782631, -0.08207018, 0.01119141, 0.002716612)
_K = (-3.634962, 0.8443252, -0.07134693, 0.01388592, 0.002188257)
_PR = (-0.3471677, -0.05669733, 0.04780579, 0.05825147, -0.03378019)


# One program, also where a temperature is known and single operations would run.
@functools.partial(jax.jit, static_argnums=0, inline=True)
def _fit(
    coefficients: tuple[float, ...], temperature: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    clipped = jnp.clip(temperature, _MIN_AIR_TEMPERATURE, _MAX_AIR_TEMPERATURE)
    x = jnp.log(clipped / 300.0)
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + c
    return jnp.exp(total)


def kinematic_viscosity(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Kinematic viscosity nu [m^2/s] at `temperature` [K]."""
    return _fit(_NU, temperature)


def conductivity(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Thermal conductivity k [W/(m K)] at `temperature` [K]."""
    return _fit(_K, temperature)


def prandtl(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Prandtl number Pr [-] at `temperature` [K]."""
    return _fit(_PR, temperature)


MIN_FILM_TEMPERATURE = 200.0
"""Lower end of the interpolation in the film temperature [K]."""

MAX_FILM_TEMPERATURE = 1000.0
"""Upper end of the interpolation in the film temperature [K]."""

# Logarithms and powers in every cell and step would cost more than conduction does; the
# polynomial costs one division and five products.
_NODES = 5
# Added to the film temperature [K]: this value minimizes the interpolation error.
_SHIFT = 600.0
_LOW = 1 / (MAX_FILM_TEMPERATURE + _SHIFT)
_HIGH = 1 / (MIN_FILM_TEMPERATURE + _SHIFT)
_MIDDLE = (_HIGH + _LOW) / 2
_HALF = (_HIGH - _LOW) / 2
_CHEBYSHEV = np.cos((np.arange(_NODES) + 0.5) * np.pi / _NODES)

FILM_TEMPERATURES = 1 / (_MIDDLE - _HALF * _CHEBYSHEV) - _SHIFT
"""Film temperatures at which h is tabulated [K]: the Chebyshev nodes."""


def film_polynomial(values: Float[Array, "*g n"]) -> Float[Array, "*g n"]:
    """Coefficients, lowest power first, through h at the `FILM_TEMPERATURES`."""
    to_powers = np.linalg.inv(np.vander(_CHEBYSHEV, _NODES, increasing=True))
    return product(values, jnp.asarray(to_powers.T.astype(values.dtype)))


def film_argument(double_film: Float[Array, "*m"]) -> tuple[Array, Array]:
    """Argument x of the film polynomial and dx/dT_s [1/K], from T_s + T_inf [K]."""
    inverse = 2 / (double_film + 2 * _SHIFT)
    x = (_MIDDLE - inverse) / _HALF
    slope = jnp.where(jnp.abs(x) < 1, inverse * inverse / (2 * _HALF), 0)
    return jnp.clip(x, -1, 1), slope


def sampled_arguments(dtype: Any) -> Float[Array, " n"]:
    """Arguments x of film temperatures over the whole range, for bounds."""
    film = jnp.linspace(MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE, 17, dtype=dtype)
    return film_argument(2 * film)[0]


def horner(rows, x) -> tuple[Array, Array]:
    """Value and derivative of a polynomial, coefficients along the first axis."""
    value = rows[_NODES - 1]
    slope = jnp.zeros_like(x)
    for power in range(_NODES - 2, -1, -1):
        slope = slope * x + value
        value = value * x + rows[power]
    return value, slope


class FilmDerivatives(NamedTuple):
    """Film polynomials and their derivatives by T_s at several film temperatures."""

    value: Float[np.ndarray, "*g f"]
    first: Float[np.ndarray, "*g f"]
    """First derivative [1/K times the unit of the value]."""
    second: Float[np.ndarray, "*g f"]
    """Second derivative [1/K^2 times the unit of the value]."""


def film_derivatives(
    rows: Float[np.ndarray, "n *g"], film: Float[np.ndarray, " f"]
) -> FilmDerivatives:
    """Value, first and second derivative by T_s of a film polynomial, on the host.

    The powers are along the first axis of `rows`; film temperatures T_f are in K.
    """
    inverse = 1 / (film + _SHIFT)
    x = (_MIDDLE - inverse) / _HALF
    slope = inverse**2 / (2 * _HALF)
    powers = polynomial.polyvander(x, _NODES - 1)
    # All are linear in the coefficients: one product of matrices for all cells.
    once = powers[:, :-1] @ polynomial.polyder(np.eye(_NODES))
    twice = powers[:, :-2] @ polynomial.polyder(np.eye(_NODES), 2)
    second = twice * (slope**2)[:, None] - once * (slope * inverse)[:, None]
    cells = np.moveaxis(rows, 0, -1)
    return FilmDerivatives(
        value=cells @ powers.T,
        first=cells @ (once * slope[:, None]).T,
        second=cells @ second.T,
    )
