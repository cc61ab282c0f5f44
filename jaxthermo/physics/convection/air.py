"""Dry air at 1 atm, 200 to 1500 K, as smooth functions of its temperature.

    ln y = sum_i c_i x^i,    x = ln(T / 300 K)

fitted to CoolProp 8 (Lemmon et al. 2000; Lemmon and Jacobsen 2004). Largest errors
over the range: 8e-5 for nu, 7e-5 for k, 2e-5 for mu, 1.6e-3 for Pr and c_p; those of
Sutherland's formulas are up to 7 %. Outside the range the value at its end holds. At
other pressures the kinematic viscosity goes as 1 / p.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


LOWEST, HIGHEST = 200.0, 1500.0
"""Range of the fits [K]."""

_NU = (-11.0587, 1.782631, -0.08207018, 0.01119141, 0.002716612)
_K = (-3.634962, 0.8443252, -0.07134693, 0.01388592, 0.002188257)
_MU = (-10.89572, 0.7798227, -0.07797241, 0.008637228, 0.003315594)
_PR = (-0.3471677, -0.05669733, 0.04780579, 0.05825147, -0.03378019)
_CP = (6.913595, 0.007805186, 0.05443127, 0.06350017, -0.03490753)


def _fit(
    coefficients: tuple[float, ...], temperature: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    x = jnp.log(jnp.clip(temperature, LOWEST, HIGHEST) / 300.0)
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
