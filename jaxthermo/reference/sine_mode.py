"""One sine mode between two faces at 0: how fast it dies, exactly and discretely.

The discrete forms hold to rounding for cell-centred cells whose outer faces are held
at 0 through half a cell, conductance 2 k A / h: there too the mode is an eigenvector.
"""

import math

from ..arrays import Scalar


def sine_rate(diffusivity: Scalar, length: Scalar, mode: int = 1) -> float:
    """The decay rate of sin(m pi x / L) [1/s].

    lambda = alpha (m pi / L)^2

    Args:
        diffusivity: alpha [m^2/s].
        length: L between the faces [m].
        mode: m, half waves in L.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 3.3.
    """
    return float(diffusivity) * (mode * math.pi / float(length)) ** 2


def sine_rate_of_cells(
    diffusivity: Scalar, length: Scalar, cells: int, mode: int = 1
) -> float:
    """The decay rate of the same mode on N cells, time left exact [1/s].

    lambda_h = (4 alpha / h^2) sin^2(m pi / (2 N)), h = L / N

    Args:
        diffusivity: alpha [m^2/s].
        length: L between the faces [m].
        cells: N along L.
        mode: m, half waves in L.

    Source: the eigenvalues of the second-difference matrix with odd ghost cells.
    """
    pitch = float(length) / cells
    wave = math.sin(mode * math.pi / (2 * cells))
    return 4.0 * float(diffusivity) / pitch**2 * wave**2


def decay_exact(rate: Scalar, time: Scalar) -> float:
    """Amplitude left of 1 [-]: exp(-lambda t), rate [1/s], time [s]."""
    return math.exp(-float(rate) * float(time))


def decay_explicit_euler(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Amplitude left of 1 [-]: (1 - lambda dt)^n, rate [1/s], dt [s]."""
    return (1.0 - float(rate) * float(dt)) ** steps


def decay_implicit_euler(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Amplitude left of 1 [-]: (1 + lambda dt)^-n, rate [1/s], dt [s]."""
    return (1.0 + float(rate) * float(dt)) ** -steps


def decay_crank_nicolson(rate: Scalar, dt: Scalar, steps: int) -> float:
    """Amplitude left of 1 [-]: ((2 - lambda dt)/(2 + lambda dt))^n."""
    x = float(rate) * float(dt)
    return ((2.0 - x) / (2.0 + x)) ** steps
