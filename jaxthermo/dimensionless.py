"""The dimensionless numbers and scales of heat transfer."""

import numpy as np
from jaxtyping import Array, Float

from .arrays import Scalar


Quantity = Scalar | Float[Array, "..."] | Float[np.ndarray, "..."]
"""A number or an array of them, of any shape."""


def biot(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Bi = h L / k [-]: resistance inside a body over that of its surface.

    Args:
        heat_transfer_coefficient: h [W/(m^2 K)].
        length: L [m].
        conductivity: k of the solid [W/(m K)].
    """
    return heat_transfer_coefficient * length / conductivity


def fourier(diffusivity: Quantity, time: Quantity, length: Quantity) -> Quantity:
    """Fo = alpha t / L^2 [-]: time over that which heat needs through the body.

    Args:
        diffusivity: alpha [m^2/s].
        time: t [s].
        length: L [m].
    """
    return diffusivity * time / (length * length)


def cell_fourier(diffusivity: Quantity, dt: Quantity, pitch: Quantity) -> Quantity:
    """Fo_h = alpha dt / h^2 [-]; forward Euler in 3-D is stable up to 1/6.

    Args:
        diffusivity: alpha [m^2/s].
        dt: time step [s].
        pitch: h, the edge of a voxel [m].
    """
    return diffusivity * dt / (pitch * pitch)


def characteristic_length(volume: Quantity, area: Quantity) -> Quantity:
    """L_c = V / A [m]: half the thickness of a slab, a third of a sphere's radius.

    Args:
        volume: V [m^3].
        area: A of the surface that exchanges heat [m^2].
    """
    return volume / area


def time_constant(capacity: Quantity, conductance: Quantity) -> Quantity:
    """Time constant tau = C / G [s]: a lumped body's excess falls by 1/e in this time.

    Args:
        capacity: C = rho c_p V [J/K].
        conductance: G = h A [W/K].
    """
    return capacity / conductance


def diffusion_length(diffusivity: Quantity, time: Quantity) -> Quantity:
    """sqrt(alpha t) [m]: how deep heat has come.

    Args:
        diffusivity: alpha [m^2/s].
        time: t [s].
    """
    return (diffusivity * time) ** 0.5


def nusselt(
    heat_transfer_coefficient: Quantity, length: Quantity, conductivity: Quantity
) -> Quantity:
    """Nu = h L / k_f [-]: the Biot number's form with the fluid's conductivity.

    Args:
        heat_transfer_coefficient: h [W/(m^2 K)].
        length: L, for a cylinder its diameter [m].
        conductivity: k_f of the fluid [W/(m K)].
    """
    return heat_transfer_coefficient * length / conductivity


def reynolds(
    speed: Quantity, length: Quantity, kinematic_viscosity: Quantity
) -> Quantity:
    """Re = U L / nu [-]: inertia over viscosity.

    Args:
        speed: U [m/s].
        length: L [m].
        kinematic_viscosity: nu [m^2/s].
    """
    return speed * length / kinematic_viscosity


def prandtl(kinematic_viscosity: Quantity, diffusivity: Quantity) -> Quantity:
    """Pr = nu / alpha [-]: how much faster momentum diffuses than heat.

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
    """Gr = g beta dT L^3 / nu^2 [-]: buoyancy over viscosity.

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
    """Ra = Gr Pr [-].

    Args:
        grashof: Gr [-].
        prandtl: Pr [-].
    """
    return grashof * prandtl
