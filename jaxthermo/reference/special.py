"""Error functions on arrays, in float64 whatever JAX is set to."""

import math

import numpy as np

from ..arrays import HostFloat
from ..dimensionless import Quantity


# From here the asymptotic series is exact to rounding; below, exp(x^2) is harmless.
_FAR = 10.0
_SERIES_TERMS = 12


def _scaled_erfc(x: float) -> float:
    if x < _FAR:
        return math.exp(x * x) * math.erfc(x)
    term = total = 1.0
    for k in range(1, _SERIES_TERMS + 1):
        term *= -(2 * k - 1) / (2.0 * x * x)
        total += term
    return total / (x * math.sqrt(math.pi))


_erf = np.vectorize(math.erf, otypes=[np.float64])
_erfc = np.vectorize(math.erfc, otypes=[np.float64])
_erfcx = np.vectorize(_scaled_erfc, otypes=[np.float64])


def host(x: Quantity) -> HostFloat:
    """The value in host memory, in float64."""
    return np.asarray(x, np.float64)


def erf(x: Quantity) -> HostFloat:
    """The error function, 2/sqrt(pi) int_0^x exp(-u^2) du [-]."""
    return np.asarray(_erf(host(x)))


def erfc(x: Quantity) -> HostFloat:
    """Its complement, 1 - erf(x) [-], without the cancellation."""
    return np.asarray(_erfc(host(x)))


def erfcx(x: Quantity) -> HostFloat:
    """The scaled complement, exp(x^2) erfc(x) [-], for x >= 0 of any size.

    For large x, sum_k (-1)^k (2k-1)!! / (2 x^2)^k / (x sqrt(pi)), because the product
    itself is infinity times zero.

    Source: NIST Digital Library of Mathematical Functions, 7.12.1.
    """
    return np.asarray(_erfcx(host(x)))
