"""Dimensionless numbers and scales of heat transfer."""

import numpy as np
from jaxtyping import Array, Float

from .arrays import Scalar


Quantity = Scalar | Float[Array, "..."] | Float[np.ndarray, "..."]
"""A number or an array of them, of any shape."""


def biot(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Biot number Bi = h L / k [-] of a solid: h [W/(m^2 K)], L [m], k [W/(m K)]."""
    return heat_transfer_coefficient * length / conductivity


def fourier(diffusivity: Quantity, time: Quantity, length: Quantity) -> Quantity:
    """Fourier number Fo = alpha t / L^2 [-]: alpha [m^2/s], t [s], L [m]."""
    return diffusivity * time / (length * length)


def cell_fourier(diffusivity: Quantity, dt: Quantity, pitch: Quantity) -> Quantity:
    """Cell Fourier number Fo_h = alpha dt / h^2 [-], with h = `pitch` [m].

    Explicit Euler in 3-D is stable up to 1/6.
    """
    return diffusivity * dt / (pitch * pitch)


def characteristic_length(volume: Quantity, area: Quantity) -> Quantity:
    """Characteristic length V / A [m]: a third of the radius of a sphere."""
    return volume / area


def time_constant(capacity: Quantity, conductance: Quantity) -> Quantity:
    """Time constant tau = C / G [s]: C [J/K], G [W/K]; the excess falls to 1/e."""
    return capacity / conductance


def diffusion_length(diffusivity: Quantity, time: Quantity) -> Quantity:
    """Diffusion length sqrt(alpha t) [m]: alpha [m^2/s], t [s]."""
    return (diffusivity * time) ** 0.5


def nusselt(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Nusselt number Nu = h L / k_f [-], with the fluid's conductivity [W/(m K)]."""
    return heat_transfer_coefficient * length / conductivity


def reynolds(
    speed: Quantity, length: Quantity, kinematic_viscosity: Quantity
) -> Quantity:
    """Reynolds number Re = U L / nu [-]: U [m/s], L [m], nu [m^2/s]."""
    return speed * length / kinematic_viscosity


def prandtl(kinematic_viscosity: Quantity, diffusivity: Quantity) -> Quantity:
    """Prandtl number Pr = nu / alpha [-], both of the fluid [m^2/s]."""
    return kinematic_viscosity / diffusivity


def grashof(
    gravity: Quantity,
    expansion: Quantity,
    excess: Quantity,
    length: Quantity,
    kinematic_viscosity: Quantity,
) -> Quantity:
    """Grashof number Gr = g beta dT L^3 / nu^2 [-].

    g [m/s^2]; `expansion` beta [1/K], 1/T for a gas; `excess` dT [K]; L [m];
    nu [m^2/s].
    """
    viscous = kinematic_viscosity * kinematic_viscosity
    return gravity * expansion * excess * (length * length * length) / viscous


def rayleigh(grashof: Quantity, prandtl: Quantity) -> Quantity:
    """Rayleigh number Ra = Gr Pr [-]."""
    return grashof * prandtl
