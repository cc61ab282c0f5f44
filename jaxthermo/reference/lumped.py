"""A body of one temperature that radiates to its surroundings."""

import numpy as np

from ..arrays import HostFloat, Scalar
from ..constants import STEFAN_BOLTZMANN
from ..dimensionless import Quantity
from .special import host


_HALVINGS = 80


def _progress(ratio: HostFloat) -> HostFloat:
    # The antiderivative of 4/(1 - r^4), r = T / T_s.
    with np.errstate(divide="ignore"):
        logarithm = np.log(np.abs((1.0 + ratio) / (1.0 - ratio)))
    return np.asarray(logarithm + 2.0 * np.arctan(ratio))


def radiation_time(
    temperature: Quantity,
    *,
    initial: Scalar,
    surroundings: Scalar,
    capacity: Scalar,
    area: Scalar,
    emissivity: Scalar,
) -> HostFloat:
    """When a body that only radiates gets to a temperature.

    t = C/(4 eps A sigma T_s^3) [ln|(T_s+T)/(T_s-T)| - ln|(T_s+T_i)/(T_s-T_i)|
        + 2 (atan(T/T_s) - atan(T_i/T_s))]

    Args:
        temperature: T between T_i and T_s [K]; at T_s the time is infinite.
        initial: T_i [K], other than T_s.
        surroundings: T_s > 0 of a large enclosure [K].
        capacity: C = rho c_p V [J/K].
        area: A of the body's surface [m^2].
        emissivity: eps [-].

    Returns:
        t [s].

    Source: Bejan and Kraus, Heat Transfer Handbook, equation 3.283.
    """
    T_s = float(surroundings)
    exchange = 4.0 * float(emissivity) * float(area) * STEFAN_BOLTZMANN * T_s**3
    scale = float(capacity) / exchange
    now, start = host(temperature) / T_s, host(initial) / T_s
    return np.asarray(scale * (_progress(host(now)) - _progress(host(start))))


def radiation_temperature(
    time: Quantity,
    *,
    initial: Scalar,
    surroundings: Scalar,
    capacity: Scalar,
    area: Scalar,
    emissivity: Scalar,
) -> HostFloat:
    """The temperature at a time: the inverse of `radiation_time`, by bisection.

    Args:
        time: t >= 0 [s].
        initial: T_i [K].
        surroundings: T_s > 0 of a large enclosure [K].
        capacity: C = rho c_p V [J/K].
        area: A of the body's surface [m^2].
        emissivity: eps [-].

    Returns:
        T [K].

    Source: Bejan and Kraus, Heat Transfer Handbook, equation 3.283.
    """
    wanted = host(time)
    early = np.full(wanted.shape, float(initial))
    late = np.full(wanted.shape, float(surroundings))
    if initial == surroundings:
        return late
    for _ in range(_HALVINGS):
        middle = 0.5 * (early + late)
        passed = radiation_time(
            middle,
            initial=initial,
            surroundings=surroundings,
            capacity=capacity,
            area=area,
            emissivity=emissivity,
        )
        before = passed < wanted
        early, late = np.where(before, middle, early), np.where(before, late, middle)
    return np.asarray(0.5 * (early + late))
