"""Average Nusselt number of free convection (Churchill and Chu 1975).

    Nu = (a + b Ra^(1/6))^2,    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2),
    b = 0.387 / [1 + (c / Pr)^(9/16)]^(8/27),

with a = 0.825, c = 0.492 and L the height for a vertical plate (IJHMT 18, 1323), and
a = 0.6, c = 0.559 and L the diameter for a horizontal cylinder (IJHMT 18, 1049; Ra up
to 1e12). Properties of air are those at the film temperature T_f.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import air


class Kind(NamedTuple):
    """The constants of a shape."""

    a: float
    c: float


GRAVITY = 9.80665
"""[m/s^2]"""

PLATE, CYLINDER = Kind(0.825, 0.492), Kind(0.6, 0.559)
"""Vertical, by its height; horizontal, by its diameter."""


def _b(prandtl, c: float):
    return 0.387 / (1 + (c / prandtl) ** (9 / 16)) ** (8 / 27)


CYLINDER_RISE = _b(0.71, CYLINDER.c) / _b(0.71, PLATE.c)
"""The b of a cylinder over that of a plate: within 1e-4 for Pr 0.69 to 0.75."""


def churchill_chu(
    rayleigh: Float[Array, "*n"], prandtl: Float[Array, "*n"], kind: Kind
) -> Float[Array, "*n"]:
    """The average Nusselt number of a `PLATE` or a `CYLINDER`."""
    return (kind.a + _b(prandtl, kind.c) * rayleigh ** (1 / 6)) ** 2


def free_coefficient(
    surface: Float[Array, "*n"],
    ambient: Float[Array, "*n"],
    length: Float[Array, "*n"],
    kind: Kind,
) -> Float[Array, "*n"]:
    """The mean h by the formula as it stands [W/(m^2 K)].

    Args:
        surface: T_s [K].
        ambient: T_inf [K].
        length: L [m].
        kind: a `PLATE` or a `CYLINDER`.
    """
    film = (surface + ambient) / 2
    nu, pr = air.kinematic_viscosity(film), air.prandtl(film)
    buoyancy = GRAVITY * jnp.abs(surface - ambient) / film
    rayleigh = buoyancy * length**3 * pr / nu**2
    return churchill_chu(rayleigh, pr, kind) * air.conductivity(film) / length


@jax.jit
def film_factors(
    film: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """What of h follows from the film temperature alone: sqrt(k), and beta.

    Since Ra goes with L^3, sqrt(h) = a sqrt(k / L) + beta |T_s - T_inf|^(1/6); beta is
    that of a plate.
    """
    nu, pr = air.kinematic_viscosity(film), air.prandtl(film)
    root = jnp.sqrt(air.conductivity(film))
    rise = (GRAVITY * pr / (film * nu * nu)) ** (1 / 6)
    return root, root * rise * _b(pr, PLATE.c)
