"""Temperature of a thin wall that loses heat along its whole surface.

Across its thickness d a wall is uniform: its excess theta over the air [K] obeys

    C d(theta)/dt = K (Laplacian of theta) - h theta + q

with the sheet conductance K = sum k_l d_l of its layers [W/K], the heat transfer
coefficient h of both faces together [W/(m^2 K)], the absorbed heat flux q [W/m^2] and
the capacity C = sum rho_l c_l d_l [J/(m^2 K)]. Without a time the state is steady.
Source of the equation: Carslaw and Jaeger, Conduction of Heat in Solids, 4.2.
"""

import numpy as np

from ..arrays import HostFloat, Quantity, Scalar
from .semi_infinite import host


_TERMS = 400


def sunlit_sphere(
    angle: Quantity,
    *,
    radius: Scalar,
    sheet_conductance: Scalar,
    heat_transfer_coefficient: Scalar,
    heat_flux: Scalar,
    time: Scalar = np.inf,
    area_capacity: Scalar = 1.0,
) -> HostFloat:
    """Excess of a spherical wall in parallel rays over the air [K].

    theta = sum_n q_n P_n(cos phi) (1 - exp(-g_n t / C)) / g_n,
    g_n = h + K n (n + 1) / R^2

    at the angle phi [rad] from the point that faces the rays; P_n are Legendre's
    polynomials and q_n = q (2 n + 1)/2 times the integral of x P_n(x) from 0 to 1: the
    terms of the absorbed flux q max(cos phi, 0).
    """
    order = np.arange(2 * _TERMS)
    moment = np.zeros(len(order))
    moment[0] = 1 / 2
    moment[1] = 1 / 3
    moment[2] = 1 / 8
    for n in range(2, len(order) - 2, 2):
        moment[n + 2] = -moment[n] * (n - 1) / (n + 4)
    share = (order + 0.5) * moment
    spread = float(sheet_conductance) / float(radius) ** 2 * order * (order + 1)
    loss = float(heat_transfer_coefficient) + spread
    risen = -np.expm1(-loss * float(time) / float(area_capacity))
    amplitude = float(heat_flux) * share * risen / loss
    cosine = np.cos(host(angle))
    return np.asarray(np.polynomial.legendre.legval(cosine, amplitude))
