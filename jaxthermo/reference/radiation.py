"""Radiation between grey surfaces, of the sun, and of a lumped body."""

import numpy as np

from ..arrays import HostFloat, Quantity, Scalar
from ..constants import STEFAN_BOLTZMANN
from .semi_infinite import host


SUN_RADIUS = 6.957e8
"""Nominal radius of the sun [m]; IAU 2015 resolution B3."""

ASTRONOMICAL_UNIT = 1.495978707e11
"""Astronomical unit [m]; IAU 2012 resolution B2."""


def between_plates(
    hot: Scalar, cold: Scalar, emissivity_hot: Scalar, emissivity_cold: Scalar
) -> float:
    """Heat flux between two infinite parallel plates [W/m^2].

    q = sigma (T_1^4 - T_2^4) / (1 / eps_1 + 1 / eps_2 - 1), temperatures in K

    Source: Incropera et al., eq. 13.19.
    """
    resistance = 1 / float(emissivity_hot) + 1 / float(emissivity_cold) - 1
    gap = float(hot) ** 4 - float(cold) ** 4
    return STEFAN_BOLTZMANN * gap / resistance


def between_spheres(
    inner: Scalar,
    outer: Scalar,
    hot: Scalar,
    cold: Scalar,
    emissivity_inner: Scalar,
    emissivity_outer: Scalar,
) -> float:
    """Heat rate from a sphere to a concentric larger one [W].

    Q = sigma A_1 (T_1^4 - T_2^4) / [1 / eps_1 + (1 / eps_2 - 1) (r_1 / r_2)^2]

    Radii r_1 and r_2 are in m, temperatures in K. Source: Incropera et al., eq. 13.21.
    """
    # The outer sphere's resistance counts by the inner area: most of its radiation
    # returns to itself.
    area = 4 * np.pi * float(inner) ** 2
    narrowing = (float(inner) / float(outer)) ** 2
    resistance = 1 / float(emissivity_inner)
    resistance += (1 / float(emissivity_outer) - 1) * narrowing
    gap = float(hot) ** 4 - float(cold) ** 4
    return STEFAN_BOLTZMANN * area * gap / resistance


def solar_irradiance(temperature: Scalar) -> float:
    """Irradiance of a black sun at the earth: sigma T^4 (R / d)^2 [W/m^2]; T [K]."""
    dilution = (SUN_RADIUS / ASTRONOMICAL_UNIT) ** 2
    return STEFAN_BOLTZMANN * float(temperature) ** 4 * dilution


def sol_air_temperature(
    air: Scalar,
    absorbed: Scalar,
    heat_transfer_coefficient: Scalar,
    to_sky: Scalar = 0.0,
) -> float:
    """Sol-air temperature: air with the effect of sun, sky and air [K, or as `air`].

    T_sol-air = T_air + (a G - eps dR) / h

    a G is the absorbed solar flux and eps dR the net emission to the sky beyond that to
    surroundings at T_air [W/m^2]; h includes radiation [W/(m^2 K)].
    Source: ASHRAE Handbook, Fundamentals.
    """
    net = float(absorbed) - float(to_sky)
    return float(air) + net / float(heat_transfer_coefficient)


_BISECTIONS = 80
"""Number of bisection steps: more than float64 resolves."""


def _antiderivative(ratio: HostFloat) -> HostFloat:
    # The antiderivative of 4/(1 - r^4), r = T / T_s.
    with np.errstate(divide="ignore"):
        quotient = (1.0 + ratio) / (1.0 - ratio)
        logarithm = np.log(np.abs(quotient))
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
    """Time at which a lumped body that only radiates has a temperature T [s].

    t = C/(4 eps A sigma T_s^3) [ln|(T_s+T)/(T_s-T)| - ln|(T_s+T_i)/(T_s-T_i)|
        + 2 (atan(T/T_s) - atan(T_i/T_s))]

    T is between T_i and T_s [K], the large surroundings; C = rho c_p V [J/K], A [m^2].
    Source: Bejan and Kraus, Heat Transfer Handbook, equation 3.283.
    """
    T_s = float(surroundings)
    exchange = 4.0 * float(emissivity) * float(area) * STEFAN_BOLTZMANN * T_s**3
    scale = float(capacity) / exchange
    end = _antiderivative(host(host(temperature) / T_s))
    start = _antiderivative(host(host(initial) / T_s))
    return np.asarray(scale * (end - start))


def radiation_temperature(
    time: Quantity,
    *,
    initial: Scalar,
    surroundings: Scalar,
    capacity: Scalar,
    area: Scalar,
    emissivity: Scalar,
) -> HostFloat:
    """Temperature at a time [K]: the inverse of `radiation_time`, by bisection.

    The arguments are the same, with the time t >= 0 [s] instead of the temperature.
    """
    target = host(time)
    early = np.full(target.shape, float(initial))
    late = np.full(target.shape, float(surroundings))
    if initial == surroundings:
        return late
    # The time grows without bound towards the surroundings, where Newton's method would
    # step across the pole; bisection stays between the two temperatures.
    for _ in range(_BISECTIONS):
        middle = 0.5 * (early + late)
        passed = radiation_time(
            middle,
            initial=initial,
            surroundings=surroundings,
            capacity=capacity,
            area=area,
            emissivity=emissivity,
        )
        is_early = passed < target
        early = np.where(is_early, middle, early)
        late = np.where(is_early, late, middle)
    return np.asarray(0.5 * (early + late))
