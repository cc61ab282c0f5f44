"""Dimensionless numbers and scales of heat transfer."""

import numpy as np
from jaxtyping import Array, Float

from .arrays import Scalar


Quantity = Scalar | Float[Array, "..."] | Float[np.ndarray, "..."]
"""A number or an array of them, of any shape."""


def biot(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Biot number Bi = h L / k [-]: internal over surface resistance.

    Args:
        heat_transfer_coefficient: h [W/(m^2 K)].
        length: L [m].
        conductivity: k of the solid [W/(m K)].
    """
    return heat_transfer_coefficient * length / conductivity


def fourier(diffusivity: Quantity, time: Quantity, length: Quantity) -> Quantity:
    """Fourier number Fo = alpha t / L^2 [-]: time over the time of diffusion.

    Args:
        diffusivity: alpha [m^2/s].
        time: t [s].
        length: L [m].
    """
    return diffusivity * time / (length * length)


def cell_fourier(diffusivity: Quantity, dt: Quantity, pitch: Quantity) -> Quantity:
    """Cell Fourier number Fo_h = alpha dt / h^2 [-]; Euler is stable up to 1/6 in 3-D.

    Args:
        diffusivity: alpha [m^2/s].
        dt: time step [s].
        pitch: h, the edge of a voxel [m].
    """
    return diffusivity * dt / (pitch * pitch)


def characteristic_length(volume: Quantity, area: Quantity) -> Quantity:
    """Characteristic length L_c = V / A [m]: a third of the radius of a sphere.

    Args:
        volume: V [m^3].
        area: A of the surface that exchanges heat [m^2].
    """
    return volume / area


def time_constant(capacity: Quantity, conductance: Quantity) -> Quantity:
    """Time constant tau = C / G [s] of a lumped body: its excess falls to 1/e.

    Args:
        capacity: C = rho c_p V [J/K].
        conductance: G = h A [W/K].
    """
    return capacity / conductance


def diffusion_length(diffusivity: Quantity, time: Quantity) -> Quantity:
    """Diffusion length sqrt(alpha t) [m]: depth to which heat has penetrated.

    Args:
        diffusivity: alpha [m^2/s].
        time: t [s].
    """
    return (diffusivity * time) ** 0.5


def nusselt(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Nusselt number Nu = h L / k_f [-] with the conductivity of the fluid.

    Args:
        heat_transfer_coefficient: h [W/(m^2 K)].
        length: L, for a cylinder its diameter [m].
        conductivity: k_f of the fluid [W/(m K)].
    """
    return heat_transfer_coefficient * length / conductivity


def reynolds(
    speed: Quantity, length: Quantity, kinematic_viscosity: Quantity
) -> Quantity:
    """Reynolds number Re = U L / nu [-]: inertia over viscosity.

    Args:
        speed: U [m/s].
        length: L [m].
        kinematic_viscosity: nu [m^2/s].
    """
    return speed * length / kinematic_viscosity


def prandtl(kinematic_viscosity: Quantity, diffusivity: Quantity) -> Quantity:
    """Prandtl number Pr = nu / alpha [-]: diffusivity of momentum over that of heat.

    Args:
        kinematic_viscosity: nu [m^2/s].
        diffusivity: alpha of the fluid [m^2/s].
    """
    return kinematic_viscosity / diffusivity


def grashof(
    gravity: Quantity,
    expansion: Quantity,
    excess: Quantity,
    length: Quantity,
    kinematic_viscosity: Quantity,
) -> Quantity:
    """Grashof number Gr = g beta dT L^3 / nu^2 [-]: buoyancy over viscosity.

    Args:
        gravity: g [m/s^2].
        expansion: beta, 1/T for a gas [1/K].
        excess: dT of the surface over the fluid [K].
        length: L [m].
        kinematic_viscosity: nu [m^2/s].
    """
    viscous = kinematic_viscosity * kinematic_viscosity
    return gravity * expansion * excess * (length * length * length) / viscous


def rayleigh(grashof: Quantity, prandtl: Quantity) -> Quantity:
    """Rayleigh number Ra = Gr Pr [-]."""
    return grashof * prandtl
