"""Functions that all laws of free convection share.

    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2)

Since Ra goes with L^3, a law Nu = c Ra^p is h = c L^(3 p - 1) F_p(T_f) |T_s - T_inf|^p:
the factors F_p = k [g Pr / (T_f nu^2)]^p are polynomials in the film temperature,
common to all cells, which replace all powers and logarithms but roots of the
difference.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import array_namespace
from . import air
from .air import FILM_TEMPERATURES, film_polynomial


_GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

REGULARIZATION = 0.01
"""Differences |T_s - T_inf| are regularized to sqrt(d^2 + this^2) under roots [K], so
that q is smooth at T_s = T_inf."""


class _ChurchillChu(NamedTuple):
    """Constants a and c of Churchill and Chu's formula.

    Nu = (a + b Ra^(1/6))^2,    b = 0.387 / [1 + (c / Pr)^(9/16)]^(8/27)
    """

    a: float
    c: float

    def b(self, prandtl):
        """Factor of Ra^(1/6) [-] at a Prandtl number."""
        return 0.387 / (1 + (self.c / prandtl) ** (9 / 16)) ** (8 / 27)


PLATE = _ChurchillChu(0.825, 0.492)
"""Vertical plate; L is its height."""

CYLINDER = _ChurchillChu(0.6, 0.559)
"""Horizontal cylinder; L is its diameter."""

CYLINDER_OVER_PLATE = CYLINDER.b(0.71) / PLATE.b(0.71)
"""Ratio of b of a cylinder to b of a plate, within 1e-4 for Pr 0.69 to 0.75."""


class FilmFactors(NamedTuple):
    """Functions of the film temperature: values, or polynomials."""

    root: Any
    """sqrt(k) [W^(1/2) / (m K)^(1/2)]."""
    rise: Any
    """sqrt(F_(1/3)) b of a plate."""
    quarter: Any
    """F_(1/4)."""
    third: Any
    """F_(1/3)."""
    round: Any
    """F_(1/4) with a sphere's factor [1 + (0.469 / Pr)^(9/16)]^(-4/9)."""


@jax.jit
def _film_factors(film: Float[Array, " n"]) -> FilmFactors:
    nu = air.kinematic_viscosity(film)
    pr = air.prandtl(film)
    k = air.conductivity(film)
    root = jnp.sqrt(k)
    buoyancy = _GRAVITY * pr / (film * nu * nu)
    quarter = k * buoyancy**0.25
    return FilmFactors(
        root=root,
        rise=root * buoyancy ** (1 / 6) * PLATE.b(pr),
        quarter=quarter,
        third=k * buoyancy ** (1 / 3),
        round=quarter / (1 + (0.469 / pr) ** (9 / 16)) ** (4 / 9),
    )


def film_rows(dtype) -> FilmFactors:
    """Film polynomials of the factors, as arrays of numpy."""
    # They are known even where a scene is traced.
    with jax.ensure_compile_time_eval():
        factors = _film_factors(jnp.asarray(FILM_TEMPERATURES, dtype))
        return FilmFactors(*(np.asarray(film_polynomial(row)) for row in factors))


def sixth_root(x: Any) -> Any:
    """x^(1/6) for 0.01 to 2000 with a relative error of 2e-5, without a power."""
    xp = array_namespace(x)
    root = xp.sqrt(x)
    eighth = xp.sqrt(xp.sqrt(root))
    guess = eighth * (0.7 + 0.27 * eighth)
    cube = guess * guess * guess
    # One step of Halley's method for the cube root of sqrt(x).
    return guess * (cube + 2 * root) / (2 * cube + root)
