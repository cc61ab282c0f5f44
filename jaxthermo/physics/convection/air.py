"""Dry air at 1 atm, 200 to 1500 K, as smooth functions of its temperature.

    ln y = sum_i c_i x^i,    x = ln(T / 300 K)

fitted to CoolProp 8 (Lemmon et al. 2000; Lemmon and Jacobsen 2004). Largest errors
over the range: 8e-5 for nu, 7e-5 for k, 2e-5 for mu, 1.6e-3 for Pr and c_p; those of
Sutherland's formulas are up to 7 %. Outside the range the value at its end holds. At
other pressures the kinematic viscosity goes as 1 / p.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


MIN_AIR_TEMPERATURE, MAX_AIR_TEMPERATURE = 200.0, 1500.0
"""Range of the fits [K]."""

_NU = (-11.0587, 1.782631, -0.08207018, 0.01119141, 0.002716612)
_K = (-3.634962, 0.8443252, -0.07134693, 0.01388592, 0.002188257)
_MU = (-10.89572, 0.7798227, -0.07797241, 0.008637228, 0.003315594)
_PR = (-0.3471677, -0.05669733, 0.04780579, 0.05825147, -0.03378019)
_CP = (6.913595, 0.007805186, 0.05443127, 0.06350017, -0.03490753)


def _fit(
    coefficients: tuple[float, ...], temperature: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    x = jnp.log(jnp.clip(temperature, MIN_AIR_TEMPERATURE, MAX_AIR_TEMPERATURE) / 300.0)
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + c
    return jnp.exp(total)


def kinematic_viscosity(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Nu [m^2/s] at `temperature` [K]."""
    return _fit(_NU, temperature)


def conductivity(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Conductivity k [W/(m K)] at `temperature` [K]."""
    return _fit(_K, temperature)


def prandtl(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Pr [-] at `temperature` [K]."""
    return _fit(_PR, temperature)


def dynamic_viscosity(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Mu [Pa s] at `temperature` [K]."""
    return _fit(_MU, temperature)


def specific_heat(temperature: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Specific heat c_p [J/(kg K)] at `temperature` [K]."""
    return _fit(_CP, temperature)


# Properties of air by film temperature, as polynomials known beforehand.
#
# Logarithms and powers at every place and step would cost more than conduction does. So
# a value is taken at five film temperatures between 200 and 1000 K and interpolated by
# the polynomial through them in 1 / (T_f + 600 K), a division and five products;
# outside, its values at the ends hold.


MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE = 200.0, 1000.0
"""Film temperatures between which h is interpolated [K]."""

NODES = 5

SHIFT = 600.0
"""Added to the film temperature [K]: the error has its least here."""

_NEAR, _FAR = 1 / (MAX_FILM_TEMPERATURE + SHIFT), 1 / (MIN_FILM_TEMPERATURE + SHIFT)
MIDDLE, HALF = (_FAR + _NEAR) / 2, (_FAR - _NEAR) / 2
_PLACES = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)

FILM_TEMPERATURES = 1 / (MIDDLE - HALF * _PLACES) - SHIFT
"""Where h has to be known [K]: the Chebyshev nodes."""


def film_polynomial(values: Float[Array, "*g n"]) -> Float[Array, "*g n"]:
    """Coefficients, lowest power first, through h at the `FILM_TEMPERATURES`."""
    to_powers = np.linalg.inv(np.vander(_PLACES, NODES, increasing=True))
    return values @ jnp.asarray(to_powers.T.astype(values.dtype))


def film_place(double_film: Float[Array, "*m"]) -> tuple[Array, Array]:
    """The polynomial's argument, and its derivative, by T_s + T_inf [K]."""
    inverse = 2 / (double_film + 2 * SHIFT)
    x = (MIDDLE - inverse) / HALF
    slope = jnp.where(jnp.abs(x) < 1, inverse * inverse / (2 * HALF), 0)
    return jnp.clip(x, -1, 1), slope


def horner(rows, x) -> tuple[Array, Array]:
    """A polynomial and its derivative; the coefficients' powers on the first axis."""
    value, slope = rows[NODES - 1], jnp.zeros_like(x)
    for power in range(NODES - 2, -1, -1):
        slope = slope * x + value
        value = value * x + rows[power]
    return value, slope
