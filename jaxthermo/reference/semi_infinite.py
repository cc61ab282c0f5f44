"""A half-space, uniform at first: closed forms for three loads on its surface."""

import numpy as np

from ..arrays import HostFloat
from ..dimensionless import Quantity
from .special import erf, erfc, erfcx, host


def _scaled_depth(depth: Quantity, time: Quantity, diffusivity: Quantity) -> HostFloat:
    return np.asarray(host(depth) / (2.0 * np.sqrt(host(diffusivity) * host(time))))


def surface_step(
    depth: Quantity,
    time: Quantity,
    *,
    initial: Quantity,
    surface: Quantity,
    diffusivity: Quantity,
) -> HostFloat:
    """Temperature when the surface is held at a new temperature from t = 0.

    T = T_s + (T_i - T_s) erf(x / (2 sqrt(alpha t)))

    Args:
        depth: x below the surface [m].
        time: t > 0 [s].
        initial: T_i [K].
        surface: T_s [K].
        diffusivity: alpha [m^2/s].

    Returns:
        T [K].

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2.4.
    """
    z = _scaled_depth(depth, time, diffusivity)
    return np.asarray(host(surface) + (host(initial) - host(surface)) * erf(z))


def surface_flux(
    depth: Quantity,
    time: Quantity,
    *,
    initial: Quantity,
    heat_flux: Quantity,
    conductivity: Quantity,
    diffusivity: Quantity,
) -> HostFloat:
    """Temperature when a constant flux enters through the surface from t = 0.

    T = T_i + (q''/k) (2 sqrt(alpha t/pi) exp(-z^2) - x erfc(z)),
    z = x/(2 sqrt(alpha t))

    Args:
        depth: x below the surface [m].
        time: t > 0 [s].
        initial: T_i [K].
        heat_flux: q'' into the body [W/m^2].
        conductivity: k [W/(m K)].
        diffusivity: alpha [m^2/s].

    Returns:
        T [K].

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2.9.
    """
    z = _scaled_depth(depth, time, diffusivity)
    reach = 2.0 * np.sqrt(host(diffusivity) * host(time) / np.pi) * np.exp(-z * z)
    gradient = host(heat_flux) / host(conductivity)
    return np.asarray(host(initial) + gradient * (reach - host(depth) * erfc(z)))


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
    """Temperature when the surface meets a fluid from t = 0.

    (T - T_i)/(T_inf - T_i) = erfc(z) - exp(-z^2) erfcx(z + h sqrt(alpha t)/k), with
    z = x/(2 sqrt(alpha t)); the textbook's exp * erfc overflows, this does not.

    Args:
        depth: x below the surface [m].
        time: t > 0 [s].
        initial: T_i [K].
        ambient: T_inf of the fluid [K].
        heat_transfer_coefficient: h [W/(m^2 K)].
        conductivity: k [W/(m K)].
        diffusivity: alpha [m^2/s].

    Returns:
        T [K].

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2.7.
    """
    z = _scaled_depth(depth, time, diffusivity)
    reach = np.sqrt(host(diffusivity) * host(time)) / host(conductivity)
    rise = erfc(z) - np.exp(-z * z) * erfcx(z + host(heat_transfer_coefficient) * reach)
    return np.asarray(host(initial) + (host(ambient) - host(initial)) * rise)
