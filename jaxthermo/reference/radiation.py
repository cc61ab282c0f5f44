"""Radiation between two grey surfaces, from the sun, and onto a wall."""

import numpy as np

from ..arrays import Scalar
from ..constants import STEFAN_BOLTZMANN


SUN_RADIUS = 6.957e8
"""Nominal [m]; IAU 2015 resolution B3."""

ASTRONOMICAL_UNIT = 1.495978707e11
"""[m]; IAU 2012 resolution B2."""


def between_plates(
    hot: Scalar, cold: Scalar, emissivity_hot: Scalar, emissivity_cold: Scalar
) -> float:
    """Heat flux between two endless plates [W/m^2].

    q = sigma (T_1^4 - T_2^4) / (1 / eps_1 + 1 / eps_2 - 1)

    Args:
        hot: T_1 [K].
        cold: T_2 [K].
        emissivity_hot: eps_1.
        emissivity_cold: eps_2.

    Source: Incropera et al., eq. 13.19.
    """
    resistance = 1 / float(emissivity_hot) + 1 / float(emissivity_cold) - 1
    return STEFAN_BOLTZMANN * (float(hot) ** 4 - float(cold) ** 4) / resistance


def between_spheres(
    inner: Scalar,
    outer: Scalar,
    hot: Scalar,
    cold: Scalar,
    emissivity_inner: Scalar,
    emissivity_outer: Scalar,
) -> float:
    """Heat from a sphere to a larger one around it [W].

    Q = sigma A_1 (T_1^4 - T_2^4) / [1 / eps_1 + (1 / eps_2 - 1) (r_1 / r_2)^2]

    Args:
        inner: r_1 [m].
        outer: r_2 of the hollow [m].
        hot: T_1 of the inner one [K].
        cold: T_2 [K].
        emissivity_inner: eps_1.
        emissivity_outer: eps_2.

    Source: Incropera et al., eq. 13.21.
    """
    area = 4 * np.pi * float(inner) ** 2
    narrowing = (float(inner) / float(outer)) ** 2
    resistance = 1 / float(emissivity_inner)
    resistance += (1 / float(emissivity_outer) - 1) * narrowing
    gap = float(hot) ** 4 - float(cold) ** 4
    return STEFAN_BOLTZMANN * area * gap / resistance


def solar_irradiance(
    temperature: Scalar, distance: Scalar = ASTRONOMICAL_UNIT
) -> float:
    """Of a black sun, facing it: sigma T^4 (R / d)^2 [W/m^2].

    Args:
        temperature: of the sun's surface [K].
        distance: d from its centre [m].
    """
    share = (SUN_RADIUS / float(distance)) ** 2
    return STEFAN_BOLTZMANN * float(temperature) ** 4 * share


def sol_air_temperature(
    air: Scalar,
    absorbed: Scalar,
    heat_transfer_coefficient: Scalar,
    to_sky: Scalar = 0.0,
) -> float:
    """The air that would heat a wall as sun, sky and air together do [K, or as `air`].

    T_sol-air = T_air + (a G - eps dR) / h

    Args:
        air: T_air, in kelvin or degrees Celsius.
        absorbed: a G, of the sun [W/m^2].
        heat_transfer_coefficient: h, with radiation [W/(m^2 K)].
        to_sky: eps dR, emitted beyond what surroundings at T_air send [W/m^2].

    Source: ASHRAE Handbook, Fundamentals.
    """
    net = float(absorbed) - float(to_sky)
    return float(air) + net / float(heat_transfer_coefficient)
