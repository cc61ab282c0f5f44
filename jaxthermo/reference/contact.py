"""Two half-spaces that touch from t = 0."""

import numpy as np

from ..arrays import HostFloat, Scalar
from ..dimensionless import Quantity
from .special import erfcx, host


def perfect_contact(
    temperature_a: Scalar,
    temperature_b: Scalar,
    effusivity_a: Scalar,
    effusivity_b: Scalar,
) -> float:
    """The temperature of the shared surface, the same at all times [K].

    T_s = (e_A T_A + e_B T_B) / (e_A + e_B)

    Args:
        temperature_a: T_A of the first body at first [K].
        temperature_b: T_B of the second [K].
        effusivity_a: e_A = sqrt(k rho c_p) [W s^0.5/(m^2 K)].
        effusivity_b: e_B [W s^0.5/(m^2 K)].

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2.15.
    """
    e_a, e_b = float(effusivity_a), float(effusivity_b)
    return (e_a * float(temperature_a) + e_b * float(temperature_b)) / (e_a + e_b)


def contact_surfaces(
    time: Quantity,
    *,
    temperature_a: Scalar,
    temperature_b: Scalar,
    effusivity_a: Scalar,
    effusivity_b: Scalar,
    contact_conductance: Scalar,
) -> tuple[HostFloat, HostFloat, HostFloat]:
    """Both surface temperatures and the flux when the contact resists.

    T_sA = T_s + (T_A - T_s) w, T_sB = T_s + (T_B - T_s) w, q'' = h_c (T_sA - T_sB),
    w = erfcx(h_c (1/e_A + 1/e_B) sqrt(t)), T_s that of perfect contact

    Args:
        time: t >= 0 [s].
        temperature_a: T_A of the first body at first [K].
        temperature_b: T_B of the second [K].
        effusivity_a: e_A = sqrt(k rho c_p) [W s^0.5/(m^2 K)].
        effusivity_b: e_B [W s^0.5/(m^2 K)].
        contact_conductance: h_c [W/(m^2 K)].

    Returns:
        T_sA [K], T_sB [K] and q'' from A to B [W/m^2].

    Source: two half-spaces with surface flux h_c (T_sA - T_sB), by Laplace transform;
    checked against a Crank-Nicolson run of 8000 cells.
    """
    h_c = float(contact_conductance)
    rate = h_c * (1.0 / float(effusivity_a) + 1.0 / float(effusivity_b))
    apart = erfcx(rate * np.sqrt(host(time)))
    shared = perfect_contact(temperature_a, temperature_b, effusivity_a, effusivity_b)
    surface_a = np.asarray(shared + (float(temperature_a) - shared) * apart)
    surface_b = np.asarray(shared + (float(temperature_b) - shared) * apart)
    return surface_a, surface_b, np.asarray(h_c * (surface_a - surface_b))
