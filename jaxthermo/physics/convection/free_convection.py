"""Free convection in still air: upright parts as plates, others as cylinders.

q = h (T_inf - T_s) with Churchill and Chu's mean h (`churchill_chu`), the same whatever
the direction of the normal. A part of the body whose axis is within 45 degrees of the
vertical, z, is a plate of its height; any other a cylinder of its diameter.

Two polynomials in the film temperature (`film`), common to all places, and a sixth root
made of square roots and one step for a cube root stand for all powers and logarithms.
Differences under 0.01 K are rounded off under that root: q is smooth at T_s = T_inf.
Wind and free convection at once would count twice what the stronger one does alone.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Scalar
from ...errors import InputError
from ...voxels.cylinder_parts import parts_of
from ...voxels.cylinders import Cylinder, given_cylinders
from ..term import (
    AbstractFluxLaw,
    AbstractSurfaceTerm,
    Binding,
    Forcing,
    Omitted,
    Surface,
    TemperatureRange,
    binding,
)
from ..time_varying import check_value, for_jit, largest, value_at
from . import air
from .air import (
    FILM_TEMPERATURES,
    MAX_FILM_TEMPERATURE,
    MIN_FILM_TEMPERATURE,
    film_place,
    film_polynomial,
    horner,
)
from .film import MISSED, film_derivatives, film_reach


# Average Nusselt number of free convection (Churchill and Chu 1975).
#
#     Nu = (a + b Ra^(1/6))^2,    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2),
#     b = 0.387 / [1 + (c / Pr)^(9/16)]^(8/27),
#
# with a = 0.825, c = 0.492 and L the height for a vertical plate (IJHMT 18, 1323), and
# a = 0.6, c = 0.559 and L the diameter for a horizontal cylinder (IJHMT 18, 1049; Ra up
# to 1e12). Properties of air are those at the film temperature T_f.


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


ROUNDED = 0.01
"""Differences of temperature below this count as about this [K]."""

DIFFERENCES = 257
"""Samples of the difference of temperatures, for bounds."""

UPRIGHT = float(np.cos(np.pi / 4))
"""Cosine between axis and vertical."""


def _sixth_root(x: Float[Array, "*m"]) -> Float[Array, "*m"]:
    """x^(1/6) for 0.01 to 2000, to 2e-5 of itself, without a power."""
    root = jnp.sqrt(x)
    eighth = jnp.sqrt(jnp.sqrt(root))
    guess = eighth * (0.7 + 0.27 * eighth)
    cube = guess * guess * guess
    # One step of Halley's method for the cube root of sqrt(x).
    return guess * (cube + 2 * root) / (2 * cube + root)


class FreeExchange(AbstractFluxLaw):
    """Free convection, one characteristic length a place."""

    still: Float[Any, " m"]
    """a / sqrt(L) [m^(-1/2)]."""
    rising: Float[Any, " m"]
    """Beta over that of a plate."""
    root: Float[Any, " n"]
    """Film polynomial of sqrt(k)."""
    rise: Float[Any, " n"]
    """Film polynomial of a plate's beta."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Float[Any, "*#m"]

    def _at(self, time, theta) -> tuple[Array, Array, Array]:
        """T_inf - T_s, h, and d h / d T_s."""
        ambient = value_at(self.temperature, time)
        below = (ambient - self.reference) - theta
        x, per_kelvin = film_place(ambient + self.reference + theta)
        root, root_slope = horner(self.root, x)
        rise, rise_slope = horner(self.rise, x)
        square = below * below + ROUNDED**2
        sixth = _sixth_root(jnp.sqrt(square))
        whole = self.still * root + self.rising * rise * sixth
        by_film = self.still * root_slope + self.rising * rise_slope * sixth
        by_difference = self.rising * rise * sixth * below / (6 * square)
        slope = by_film * per_kelvin - by_difference
        return below, whole * whole, 2 * whole * slope

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The heat flux h (T_inf - T_s) into the surface [W/m^2]."""
        below, h, _ = self._at(time, theta)
        return h * below

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The slope h - (T_inf - T_s) dh/dT_s."""
        below, h, bend = self._at(time, theta)
        return h - below * bend

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """An upper bound, at a difference that is never exceeded.

        The slope is at most 7/3 h: with the difference h grows with a power below 1/3,
        with the film temperature below 1.
        """
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        apart = jnp.maximum(hottest, warmest) + ROUNDED
        film = jnp.linspace(
            MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE, 17, dtype=hottest.dtype
        )
        x, _ = film_place(2 * film)
        cast = lambda values: jnp.asarray(values, hottest.dtype)
        root = cast(self.still).max(initial=0.0) * horner(cast(self.root), x)[0]
        rise = cast(self.rising).max(initial=0.0) * horner(cast(self.rise), x)[0]
        h = (root + rise * _sixth_root(apart)) ** 2
        return 7 / 3 * 1.01 * h.max()

    def max_flux(self, reach: TemperatureRange) -> float:
        """The largest h (T_inf - T_s)."""
        apart, whole, _, _ = self._sampled(reach)
        return MISSED * float((apart * whole**2).max())

    def curvature(self, reach: TemperatureRange) -> float:
        """|h'' (T_inf - T_s)| + 2 |h'| of h = w^2, at most.

        A difference bends its own power without bound where it is 0, but for `ROUNDED`.
        """
        if not film_reach(self.temperature, reach).smooth:
            return np.inf
        apart, whole, once, twice = self._sampled(reach)
        bent = 2 * apart * (once**2 + whole * twice) + 4 * whole * once
        return MISSED * float(bent.max())

    def _sampled(
        self, reach: TemperatureRange
    ) -> tuple[Float[np.ndarray, "d #f"], ...]:
        """Differences [K], and the most there of w = a r + b s sigma and derivatives.

        Every part of a derivative counts with its absolute value.
        """
        air = film_reach(self.temperature, reach)
        most = lambda values: float(np.max(values, initial=0.0))
        host = lambda values: np.asarray(values, float)
        root = [
            most(self.still) * v for v in film_derivatives(host(self.root), air.film)
        ]
        rise = [
            most(self.rising) * v for v in film_derivatives(host(self.rise), air.film)
        ]
        few = ROUNDED / 100
        apart = np.geomspace(few, max(air.gap, few), DIFFERENCES)[:, None]
        square = apart**2 + ROUNDED**2
        sixth = square ** (1 / 12)
        steep = sixth * apart / (6 * square)
        bent = sixth * np.abs(1 / 6 - 11 / 36 * apart**2 / square) / square
        return (
            apart,
            np.abs(root[0]) + np.abs(rise[0]) * sixth,
            np.abs(root[1]) + np.abs(rise[1]) * sixth + np.abs(rise[0]) * steep,
            np.abs(root[2])
            + np.abs(rise[2]) * sixth
            + 2 * np.abs(rise[1]) * steep
            + np.abs(rise[0]) * bent,
        )

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    def coarsened(self, mean: Callable[[Array], Array]) -> "FreeExchange":
        """With the mean of each new place."""
        where = lambda law: (law.still, law.rising)
        return eqx.tree_at(where, self, tuple(map(mean, where(self))))


class FreeConvection(AbstractSurfaceTerm):
    """Free convection from every body, in air that stands still.

    Raises:
        InputError: for a temperature or a length that is none.
    """

    temperature: Any
    """T_inf of the air [K], a number or a function of time."""
    length: float | None = eqx.field(static=True, default=None)
    """L [m], of all parts instead of their own height or diameter."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """For the bodies that they name; those of other bodies are found."""

    def __check_init__(self):
        check_value(self.temperature, "FreeConvection(temperature [K])", 0.0)
        given = self.length
        if given is not None and not (
            isinstance(given, int | float) and 0 < given < np.inf
        ):
            raise InputError(
                f"FreeConvection(length={given!r}): give a positive length in metres"
            )

    @property
    def name(self) -> str:
        """In the ledger."""
        return "free_convection"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its temperature."""
        return (self.temperature,)

    def forcing(self, end: float | int) -> Forcing:
        """Towards its temperature [K]."""
        return Forcing(temperature=largest(self.temperature, end))

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """Every free fragment, as part of a plate or of a cylinder."""
        acts = surface.acted_on(None)
        if isinstance(acts, Omitted):
            return acts
        dtype = surface.dtype
        parts = parts_of(surface.grid, self.cylinders, surface.body)
        up = surface.pose.unturn(np.array([0.0, 0.0, 1.0]))
        still, rising = zip(*(self._part(c, up) for c in parts.cylinders), strict=True)
        with jax.ensure_compile_time_eval():
            factors = film_factors(jnp.asarray(FILM_TEMPERATURES, dtype))
            root, rise = (np.asarray(film_polynomial(each)) for each in factors)
        law = FreeExchange(
            still=np.array(still, dtype)[parts.fragment],
            rising=np.array(rising, dtype)[parts.fragment],
            root=root,
            rise=rise,
            temperature=for_jit(self.temperature, dtype),
            reference=jnp.asarray(reference, dtype),
        )
        return (binding(surface.area, law, acts),)

    def _part(
        self, cylinder: Cylinder, up: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """What `FreeExchange` holds of a part."""
        upright = abs(float(cylinder.direction @ up)) >= UPRIGHT
        own = cylinder.length if upright else cylinder.diameter
        length = self.length or own
        if length is None:
            raise InputError(
                f"FreeConvection(cylinders=): the upright one at {cylinder.axis_point} "
                "has no length: give it one, or FreeConvection a length"
            )
        kind, rising = (PLATE, 1.0) if upright else (CYLINDER, CYLINDER_RISE)
        return kind.a / length**0.5, rising
