"""Slabs: eigenmode series for convection, and decay of single sine modes.

The discrete decay rate is exact for cell-centred cells whose outer faces have
temperature 0 through half a cell, conductance 2 k A / h: the sine is an eigenvector.
"""

import math

import numpy as np
from jaxtyping import Float

from ..arrays import HostFloat, Quantity, Scalar
from .semi_infinite import host


_TERMS = 60
_HALVINGS = 60


def _eigenvalues(biot: Scalar, terms: int = _TERMS) -> Float[np.ndarray, "m"]:
    """First roots of z tan z = Bi [-], ascending; Bi = h L / k > 0."""
    # Root n is in ((n-1) pi, (n-1/2) pi), where z sin z - Bi cos z changes sign once:
    # bisection is robust for every Biot number.
    ratio = float(biot)
    low = np.arange(terms) * np.pi
    high = low + 0.5 * np.pi
    # On every second interval both sides have the opposite sign.
    turn = np.where(np.arange(terms) % 2 == 0, 1.0, -1.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        excess = middle * np.sin(middle) - ratio * np.cos(middle)
        above = turn * excess > 0.0
        low = np.where(above, low, middle)
        high = np.where(above, middle, high)
    return 0.5 * (low + high)


def _weights(z: np.ndarray) -> np.ndarray:
    return 4.0 * np.sin(z) / (2.0 * z + np.sin(2.0 * z))


def slab_convection(position: Quantity, fourier: Quantity, biot: Scalar) -> HostFloat:
    """Excess temperature of a slab in a fluid over the initial excess [-].

    theta = (T - T_inf)/(T_i - T_inf) = sum_n C_n exp(-z_n^2 Fo) cos(z_n x*),
    C_n = 4 sin z_n/(2 z_n + sin 2 z_n), z_n tan z_n = Bi

    with x* = x / L from the middle (-1 to 1), Fo = alpha t / L^2, not below about 1e-3
    for 60 terms, Bi = h L / k and the half-thickness L. Also valid for a slab of
    thickness L with an insulated back at x* = 0. Source: Carslaw and Jaeger, 3.11.
    """
    z = _eigenvalues(biot)
    x = host(position)[..., None]
    decay = np.exp(-z * z * host(fourier)[..., None])
    terms_of_series = _weights(z) * decay * np.cos(z * x)
    return np.asarray(np.sum(terms_of_series, axis=-1))


def slab_convection_mean(fourier: Quantity, biot: Scalar) -> HostFloat:
    """Mean of `slab_convection` over the thickness [-].

    theta_mean = sum_n C_n exp(-z_n^2 Fo) sin(z_n)/z_n

    Arguments and source are the same.
    """
    z = _eigenvalues(biot)
    decay = np.exp(-z * z * host(fourier)[..., None])
    terms_of_series = _weights(z) * decay * np.sin(z) / z
    return np.asarray(np.sum(terms_of_series, axis=-1))


def sine_rate(diffusivity: Scalar, length: Scalar, mode: int = 1) -> float:
    """Decay rate of sin(m pi x / L) between faces at 0 [1/s].

    lambda = alpha (m pi / L)^2, alpha [m^2/s], L [m]. Source: Carslaw and Jaeger, 3.3.
    """
    wave_number = mode * math.pi / float(length)
    return float(diffusivity) * wave_number**2


def sine_rate_of_cells(
    diffusivity: Scalar, length: Scalar, cells: int, mode: int = 1
) -> float:
    """Decay rate of the same mode on N cells, exact in time [1/s].

    lambda_h = (4 alpha / h^2) sin^2(m pi / (2 N)), h = L / N

    Source: the eigenvalues of the second-difference matrix with odd ghost cells.
    """
    pitch = float(length) / cells
    wave = math.sin(mode * math.pi / (2 * cells))
    return 4.0 * float(diffusivity) / pitch**2 * wave**2


def decay_exact(rate: Scalar, time: Scalar) -> float:
    """Remaining amplitude exp(-lambda t) [-], rate [1/s], time [s]."""
    return math.exp(-float(rate) * float(time))


def decay_explicit_euler(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Remaining amplitude (1 - lambda dt)^n [-], rate [1/s], dt [s]."""
    return (1.0 - float(rate) * float(dt)) ** steps


def decay_implicit_euler(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Remaining amplitude (1 + lambda dt)^-n [-], rate [1/s], dt [s]."""
    return (1.0 + float(rate) * float(dt)) ** -steps


def decay_crank_nicolson(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Remaining amplitude ((2 - lambda dt)/(2 + lambda dt))^n [-]."""
    x = float(rate) * float(dt)
    return ((2.0 - x) / (2.0 + x)) ** steps
