"""Free convection in still air: upright parts as plates, others as cylinders.

    q = h (T_inf - T_s),    h = Nu k / L,    Nu = (a + b Ra^(1/6))^2,
    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2),
    b = 0.387 / [1 + (c / Pr)^(9/16)]^(8/27)

with a = 0.825, c = 0.492 and L the height for a vertical plate (Churchill and Chu 1975,
IJHMT 18, 1323), and a = 0.6, c = 0.559 and L the diameter for a horizontal cylinder
(IJHMT 18, 1049; Ra up to 1e12). Properties of air are taken at the film temperature
T_f. The mean h applies whatever the direction of the normal. A part of the body whose
axis is within 45 degrees of the vertical, z, is a plate of its height; any other a
cylinder of its diameter.

`Wind` and `FreeConvection` on one body would add their heat fluxes, although the
stronger of the two mechanisms determines h nearly alone.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import TimeVarying
from ...errors import InputError
from ...voxels.cylinders import Cylinder, given_cylinders, parts_of
from ...voxels.selection import AbstractSelection
from ..boundary import toward
from ..flux_law import Forcing
from ..surface import Binding, BodySurface, Omitted, Surface
from ..term import AbstractSurfaceTerm
from ..time_varying import check_value, for_jit, largest, value_at
from . import air
from .air import (
    FILM_TEMPERATURES,
    MAX_FILM_TEMPERATURE,
    MIN_FILM_TEMPERATURE,
    FilmDerivatives,
    film_argument,
    film_derivatives,
    film_polynomial,
    horner,
)
from .film import SAMPLING_MARGIN, AbstractFilmLaw, FilmState, film_range


class _Shape(NamedTuple):
    """Constants a and c of Churchill and Chu's formula."""

    a: float
    c: float


# Standard gravity [m/s^2].
_GRAVITY = 9.80665

_PLATE = _Shape(0.825, 0.492)
"""Vertical plate; L is its height."""

_CYLINDER = _Shape(0.6, 0.559)
"""Horizontal cylinder; L is its diameter."""


def _b(prandtl, c: float):
    return 0.387 / (1 + (c / prandtl) ** (9 / 16)) ** (8 / 27)


# Ratio of b of a cylinder to b of a plate, within 1e-4 for Pr 0.69 to 0.75.
_CYLINDER_OVER_PLATE = _b(0.71, _CYLINDER.c) / _b(0.71, _PLATE.c)


@jax.jit
def _film_factors(
    film: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """sqrt(k) and a plate's beta, which depend on the film temperature alone."""
    # Since Ra goes with L^3, sqrt(h) = a sqrt(k / L) + beta |T_s - T_inf|^(1/6): two
    # polynomials in the film temperature, common to all cells, replace all powers and
    # logarithms but the sixth root.
    nu = air.kinematic_viscosity(film)
    pr = air.prandtl(film)
    root = jnp.sqrt(air.conductivity(film))
    rise = (_GRAVITY * pr / (film * nu * nu)) ** (1 / 6)
    return root, root * rise * _b(pr, _PLATE.c)


# Differences |T_s - T_inf| are regularized to sqrt(d^2 + this^2) under the sixth root
# [K], so that q is smooth at T_s = T_inf.
_REGULARIZATION = 0.01

# Samples of the temperature difference for bounds.
_DIFFERENCE_SAMPLES = 257

# Smallest cosine between axis and vertical of an upright part.
_MIN_UPRIGHT_COSINE = float(np.cos(np.pi / 4))


def _sixth_root(x: Float[Array, "*m"]) -> Float[Array, "*m"]:
    """x^(1/6) for 0.01 to 2000 with a relative error of 2e-5, without a power."""
    root = jnp.sqrt(x)
    eighth = jnp.sqrt(jnp.sqrt(root))
    guess = eighth * (0.7 + 0.27 * eighth)
    cube = guess * guess * guess
    # One step of Halley's method for the cube root of sqrt(x).
    return guess * (cube + 2 * root) / (2 * cube + root)


class _Bounds(NamedTuple):
    """Bounds of w = sqrt(h) at sampled differences and film temperatures."""

    apart: Float[np.ndarray, "d 1"]
    """Differences |T_s - T_inf| [K]."""
    w: Float[np.ndarray, "d f"]
    """Bound of |w| [W^(1/2) / (m K^(1/2))]."""
    dw: Float[np.ndarray, "d f"]
    """Bound of |dw / dT_s|."""
    ddw: Float[np.ndarray, "d f"]
    """Bound of |d2w / dT_s^2|."""


class _FreeExchange(AbstractFilmLaw):
    """Heat flux h (T_inf - T_s) of free convection [W/m^2].

    sqrt(h) = still sqrt(k) + rising beta |T_s - T_inf|^(1/6)
    """

    still: Float[Any, " m"]
    """a / sqrt(L) [m^(-1/2)]."""
    rising: Float[Any, " m"]
    """Ratio of beta to beta of a plate [-]."""
    root: Float[Any, " n"]
    """Film polynomial of sqrt(k)."""
    rise: Float[Any, " n"]
    """Film polynomial of beta of a plate."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Any = 0.0

    @override
    def _at(self, time, theta) -> FilmState:
        ambient = value_at(self.temperature, time)
        below = (ambient - self.reference) - theta
        x, per_kelvin = film_argument(ambient + self.reference + theta)
        root, root_slope = horner(self.root, x)
        rise, rise_slope = horner(self.rise, x)
        square = below * below + _REGULARIZATION**2
        sixth = _sixth_root(jnp.sqrt(square))
        w = self.still * root + self.rising * rise * sixth
        by_film = self.still * root_slope + self.rising * rise_slope * sixth
        by_difference = self.rising * rise * sixth * below / (6 * square)
        slope = by_film * per_kelvin - by_difference
        return FilmState(difference=below, h=w * w, dh=2 * w * slope)

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # The slope is at most 7/3 h: h grows with the difference by a power below 1/3,
        # with the film temperature below 1. The difference is never exceeded.
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        apart = jnp.maximum(hottest, warmest) + _REGULARIZATION
        film = jnp.linspace(
            MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE, 17, dtype=hottest.dtype
        )
        x, _ = film_argument(2 * film)
        root_rows = jnp.asarray(self.root, hottest.dtype)
        rise_rows = jnp.asarray(self.rise, hottest.dtype)
        still = jnp.asarray(self.still, hottest.dtype).max(initial=0.0)
        rising = jnp.asarray(self.rising, hottest.dtype).max(initial=0.0)
        root = still * horner(root_rows, x)[0]
        rise = rising * horner(rise_rows, x)[0]
        h = (root + rise * _sixth_root(apart)) ** 2
        return 7 / 3 * 1.01 * h.max()

    @override
    def max_flux(self, within: Forcing, end: float) -> float:
        sampled = self._sampled(within, end)
        return SAMPLING_MARGIN * float((sampled.apart * sampled.w**2).max())

    @override
    def curvature(self, within: Forcing, end: float) -> float:
        # |h'' (T_inf - T_s)| + 2 |h'| with h = w^2. The second derivative of the sixth
        # root at 0 is bounded thanks to the regularization.
        if not film_range(self.temperature, within, end).smooth:
            return np.inf
        apart, w, dw, ddw = self._sampled(within, end)
        curvature = 2 * apart * (dw**2 + w * ddw) + 4 * w * dw
        return SAMPLING_MARGIN * float(curvature.max())

    def _sampled(self, within: Forcing, end: float) -> _Bounds:
        # The absolute values of all terms of a derivative are added.
        air = film_range(self.temperature, within, end)
        root = _scaled_derivatives(self.still, self.root, air.film)
        rise = _scaled_derivatives(self.rising, self.rise, air.film)
        tiny = _REGULARIZATION / 100
        apart = np.geomspace(tiny, max(air.gap, tiny), _DIFFERENCE_SAMPLES)[:, None]
        square = apart**2 + _REGULARIZATION**2
        sixth = square ** (1 / 12)
        steep = sixth * apart / (6 * square)
        second = sixth * np.abs(1 / 6 - 11 / 36 * apart**2 / square) / square
        return _Bounds(
            apart=apart,
            w=root.value + rise.value * sixth,
            dw=root.first + rise.first * sixth + rise.value * steep,
            ddw=root.second
            + rise.second * sixth
            + 2 * rise.first * steep
            + rise.value * second,
        )

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "_FreeExchange":
        return replace(self, still=mean(self.still), rising=mean(self.rising))


def _scaled_derivatives(
    factors: Float[Any, " m"], rows: Float[Any, " n"], film: Float[np.ndarray, " f"]
) -> FilmDerivatives:
    """Absolute film polynomial and derivatives, times the largest factor."""
    largest_factor = float(np.max(factors, initial=0.0))
    derivatives = film_derivatives(np.asarray(rows, float), film)
    return FilmDerivatives(*(largest_factor * np.abs(row) for row in derivatives))


class FreeConvection(AbstractSurfaceTerm):
    """Free convection from all bodies in still air.

    q = h (T_inf - T_s),    h = Nu(Ra, Pr) k / L [W/(m^2 K)]

    Upright parts count as plates of their height, others as horizontal cylinders of
    their diameter. Source: Churchill and Chu, IJHMT 18 (1975) 1049 and 1323.

    Raises:
        InputError: for a negative temperature, or a length that is not positive.
    """

    name = "free_convection"
    from_outside = True
    is_convective = True

    temperature: TimeVarying
    """T_inf of the air [K], a number or a function of time."""
    length: float | None = eqx.field(static=True, default=None)
    """L of all parts [m]; None for the height or diameter of each."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """Cylinders of the bodies that they name; those of other bodies are detected."""
    on: AbstractSelection | None = None
    """Part of the surface that it cools."""

    def __check_init__(self):
        check_value(self.temperature, "FreeConvection(temperature [K])", 0.0)
        length = self.length
        if length is not None and not (
            isinstance(length, int | float) and 0 < length < np.inf
        ):
            raise InputError(
                f"FreeConvection(length={length!r}): give a positive length in metres"
            )

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        dtype = surface.dtype
        covers = []
        factors = []
        for body in surface.bodies:
            cover = body.cover(body.area, self.on)
            covers.append(cover)
            omitted = isinstance(cover, Omitted)
            factors.append(
                np.zeros((2, len(body.area))) if omitted else self._factors(body)
            )
        still, rising = np.concatenate(factors, axis=1).astype(dtype)
        # The film polynomials are common to all bodies, whatever their temperatures.
        with jax.ensure_compile_time_eval():
            root, rise = _film_factors(jnp.asarray(FILM_TEMPERATURES, dtype))
            root_rows = np.asarray(film_polynomial(root))
            rise_rows = np.asarray(film_polynomial(rise))
        law = _FreeExchange(
            still=still,
            rising=rising,
            root=root_rows,
            rise=rise_rows,
            temperature=for_jit(self.temperature, dtype),
        )
        return surface.bind(law, covers)

    def _factors(self, body: BodySurface) -> Float[np.ndarray, "2 s"]:
        """Factors `still` and `rising` of every fragment, by its cylinder."""
        cylinder_parts = parts_of(body.grid, self.cylinders, body.body)
        up = body.pose.rotate_back(np.array([0.0, 0.0, 1.0]))
        by_cylinder = [
            self._cylinder_factors(cylinder, up)
            for cylinder in cylinder_parts.cylinders
        ]
        return np.array(by_cylinder).T[:, cylinder_parts.fragment]

    def _cylinder_factors(
        self, cylinder: Cylinder, up: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Factors `still` and `rising` of one cylinder."""
        upright = abs(float(cylinder.direction @ up)) >= _MIN_UPRIGHT_COSINE
        length = self.length or (cylinder.length if upright else cylinder.diameter)
        if length is None:
            raise InputError(
                f"FreeConvection(cylinders=): the upright one at {cylinder.axis_point} "
                "has no length: give it one, or FreeConvection a length"
            )
        shape, rising = (_PLATE, 1.0) if upright else (_CYLINDER, _CYLINDER_OVER_PLATE)
        return shape.a / float(length) ** 0.5, rising
