"""Half-space, uniform at first: three surface loads, and contact of two half-spaces.

Symbols: depth x below the surface [m], time t [s], initial temperature T_i [K],
conductivity k [W/(m K)], diffusivity alpha [m^2/s]. Source: Carslaw and Jaeger,
Conduction of Heat in Solids.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import erf, erfc, erfcx

from ..arrays import HostFloat, Quantity, Scalar


def host(x: Quantity) -> HostFloat:
    """Array in host memory, in float64."""
    # The closed form that a float32 run is compared with must not have its errors.
    return np.asarray(x, np.float64)


def _scaled_depth(depth: Quantity, time: Quantity, diffusivity: Quantity) -> HostFloat:
    diffusion_length = np.sqrt(host(diffusivity) * host(time))
    return np.asarray(host(depth) / (2.0 * diffusion_length))


def surface_step(
    depth: Quantity,
    time: Quantity,
    *,
    initial: Quantity,
    surface: Quantity,
    diffusivity: Quantity,
) -> HostFloat:
    """Temperature [K] for a surface at a new constant temperature from t = 0.

    T = T_s + (T_i - T_s) erf(x / (2 sqrt(alpha t)))

    Source: Carslaw and Jaeger, 2.4.
    """
    z = _scaled_depth(depth, time, diffusivity)
    step = host(initial) - host(surface)
    return np.asarray(host(surface) + step * erf(z))


def surface_flux(
    depth: Quantity,
    time: Quantity,
    *,
    initial: Quantity,
    heat_flux: Quantity,
    conductivity: Quantity,
    diffusivity: Quantity,
) -> HostFloat:
    """Temperature [K] for a constant heat flux q'' into the surface [W/m^2] from t = 0.

    T = T_i + (q''/k) (2 sqrt(alpha t/pi) exp(-z^2) - x erfc(z)),
    z = x/(2 sqrt(alpha t))

    Source: Carslaw and Jaeger, 2.9.
    """
    z = _scaled_depth(depth, time, diffusivity)
    diffusion_length = np.sqrt(host(diffusivity) * host(time) / np.pi)
    depth_scale = 2.0 * diffusion_length * np.exp(-z * z)
    gradient = host(heat_flux) / host(conductivity)
    heated_depth = depth_scale - host(depth) * erfc(z)
    return np.asarray(host(initial) + gradient * heated_depth)


def surface_convection(
    depth: Quantity,
    time: Quantity,
    *,
    initial: Quantity,
    ambient: Quantity,
    heat_transfer_coefficient: Quantity,
    conductivity: Quantity,
    diffusivity: Quantity,
) -> HostFloat:
    """Temperature [K] for convection to a fluid of T_inf [K] from t = 0, h [W/(m^2 K)].

    (T - T_i)/(T_inf - T_i) = erfc(z) - exp(-z^2) erfcx(z + h sqrt(alpha t)/k), with
    z = x/(2 sqrt(alpha t))

    Source: Carslaw and Jaeger, 2.7.
    """
    z = _scaled_depth(depth, time, diffusivity)
    length = np.sqrt(host(diffusivity) * host(time)) / host(conductivity)
    # The textbook form, with exp(h x/k + h^2 alpha t/k^2) erfc, overflows: exp(-z^2) is
    # taken out of erfc, and the scaled function stays finite at any h.
    surface_depth = z + host(heat_transfer_coefficient) * length
    surface_lag = np.exp(-z * z) * erfcx(surface_depth)
    rise = erfc(z) - surface_lag
    excess = host(ambient) - host(initial)
    return np.asarray(host(initial) + excess * rise)


def perfect_contact(
    temperature_a: Scalar,
    temperature_b: Scalar,
    effusivity_a: Scalar,
    effusivity_b: Scalar,
) -> float:
    """Temperature of the common surface of two half-spaces, constant in time [K].

    T_s = (e_A T_A + e_B T_B) / (e_A + e_B)

    with the initial temperatures [K] and the effusivities e = sqrt(k rho c_p)
    [W s^0.5/(m^2 K)]. Source: Carslaw and Jaeger, 2.15.
    """
    e_a = float(effusivity_a)
    e_b = float(effusivity_b)
    weighted = e_a * float(temperature_a)
    weighted += e_b * float(temperature_b)
    return weighted / (e_a + e_b)


class _ContactSurfaces(NamedTuple):
    """Two half-spaces in contact through a resistance."""

    surface_a: HostFloat
    """Surface temperature T_sA [K]."""
    surface_b: HostFloat
    """Surface temperature T_sB [K]."""
    heat_flux: HostFloat
    """Heat flux q'' from A to B [W/m^2]."""


def contact_surfaces(
    time: Quantity,
    *,
    temperature_a: Scalar,
    temperature_b: Scalar,
    effusivity_a: Scalar,
    effusivity_b: Scalar,
    contact_conductance: Scalar,
) -> _ContactSurfaces:
    """Surface temperatures [K] and heat flux for a contact with a resistance.

    T_sA = T_s + (T_A - T_s) w, T_sB = T_s + (T_B - T_s) w, q'' = h_c (T_sA - T_sB),
    w = erfcx(h_c (1/e_A + 1/e_B) sqrt(t)), T_s that of perfect contact

    Arguments as for `perfect_contact`, with h_c [W/(m^2 K)].

    Source: two half-spaces with surface flux h_c (T_sA - T_sB), by Laplace transform;
    checked against a Crank-Nicolson run of 8000 cells.
    """
    h_c = float(contact_conductance)
    inverse_effusivity = 1.0 / float(effusivity_a)
    inverse_effusivity += 1.0 / float(effusivity_b)
    rate = h_c * inverse_effusivity
    # As a half-space in a fluid, with 1/e_A + 1/e_B in place of its 1/e.
    decay = erfcx(rate * np.sqrt(host(time)))
    shared = perfect_contact(
        temperature_a,
        temperature_b=temperature_b,
        effusivity_a=effusivity_a,
        effusivity_b=effusivity_b,
    )
    excess_a = float(temperature_a) - shared
    excess_b = float(temperature_b) - shared
    surface_a = np.asarray(shared + excess_a * decay)
    surface_b = np.asarray(shared + excess_b * decay)
    heat_flux = np.asarray(h_c * (surface_a - surface_b))
    return _ContactSurfaces(
        surface_a=surface_a, surface_b=surface_b, heat_flux=heat_flux
    )
