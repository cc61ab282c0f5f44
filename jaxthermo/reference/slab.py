"""A slab that exchanges heat with a fluid: the series of its eigenmodes."""

import numpy as np
from jaxtyping import Float

from ..arrays import HostFloat, Scalar
from ..dimensionless import Quantity
from .special import host


TERMS = 60
_HALVINGS = 60


def slab_eigenvalues(biot: Scalar, terms: int = TERMS) -> Float[np.ndarray, "m"]:
    """The first roots of z tan z = Bi [-], ascending.

    The n-th lies in ((n-1) pi, (n-1/2) pi), where z sin z - Bi cos z changes sign once:
    found by bisection, which no Biot number can upset.

    Args:
        biot: Bi = h L / k > 0 with the half-thickness L [-].
        terms: how many.
    """
    ratio = float(biot)
    low = np.arange(terms) * np.pi
    high = low + 0.5 * np.pi
    # On every second interval the sign of both sides is turned.
    turn = np.where(np.arange(terms) % 2 == 0, 1.0, -1.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        above = turn * (middle * np.sin(middle) - ratio * np.cos(middle)) > 0.0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


def _weights(z: np.ndarray) -> np.ndarray:
    return 4.0 * np.sin(z) / (2.0 * z + np.sin(2.0 * z))


def slab_convection(
    position: Quantity, fourier: Quantity, biot: Scalar, terms: int = TERMS
) -> HostFloat:
    """Excess temperature of a slab in a fluid, as a fraction of the first excess.

    theta = (T - T_inf)/(T_i - T_inf) = sum_n C_n exp(-z_n^2 Fo) cos(z_n x*),
    C_n = 4 sin z_n/(2 z_n + sin 2 z_n), z_n tan z_n = Bi

    Also a slab of thickness L with an insulated back at x* = 0.

    Args:
        position: x* = x / L from the middle, -1 to 1 [-].
        fourier: Fo = alpha t / L^2, at least about 1e-3 for 60 terms [-].
        biot: Bi = h L / k with the half-thickness L [-].
        terms: of the series.

    Returns:
        theta [-], of the shape of position and fourier together.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 3.11.
    """
    z = slab_eigenvalues(biot, terms)
    x = host(position)[..., None]
    decay = np.exp(-z * z * host(fourier)[..., None])
    return np.asarray(np.sum(_weights(z) * decay * np.cos(z * x), axis=-1))


def slab_convection_mean(
    fourier: Quantity, biot: Scalar, terms: int = TERMS
) -> HostFloat:
    """Mean over the thickness of `slab_convection`.

    theta_mean = sum_n C_n exp(-z_n^2 Fo) sin(z_n)/z_n

    Args:
        fourier: Fo = alpha t / L^2 [-].
        biot: Bi = h L / k with the half-thickness L [-].
        terms: of the series.

    Returns:
        theta_mean [-].

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 3.11.
    """
    z = slab_eigenvalues(biot, terms)
    decay = np.exp(-z * z * host(fourier)[..., None])
    return np.asarray(np.sum(_weights(z) * decay * np.sin(z) / z, axis=-1))
