"""Free convection of plates and spheres in still air.

    q = h (T_inf - T_s),    h = Nu k / L,    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2)

| surface | Nusselt number | L | source |
|---|---|---|---|
| plate, warm side up | 0.54 Ra^(1/4) to 1e7, 0.15 Ra^(1/3) above | A / P | McAdams |
| plate, warm side down | 0.27 Ra^(1/4) | A / P | McAdams 1954 |
| plate, upright | (0.825 + b Ra^(1/6))^2 | mean height | Churchill and Chu 1975 |
| sphere | 2 + 0.589 Ra^(1/4) / [1 + (0.469 / Pr)^(9/16)]^(4/9) | D | Churchill 1983 |

A cold side that looks up is a warm one that looks down, and the other way round. A is
the area of a plate's silhouette along its normal and P its perimeter (Goldstein,
Sparrow and Jones 1973, IJHMT 16, 1025). Between its two ranges the number of a warm
side up passes smoothly from one line to the other, from where they cross, Ra 4.7e6, to
2.1e7. For small Ra the numbers end, as sqrt(Nu^2 + (2 / pi)^2), at conduction from a
disc.

Tilted sides have, with c the vertical component of the normal, a mean of these numbers,

    Nu = c^2 Nu_up + (1 - c^2) Nu_upright          warm side up
    Nu = c^32 Nu_down + (1 - c^32) Nu_upright      warm side down

with g sqrt(1 - c^2) in place of g in the upright number: the air flows along the plate.
Both are within 8 % of the largest of the three numbers with the components of g along
and across the plate (Raithby and Hollands 1998, Handbook of Heat Transfer, 4.3), and
differ from these by having no bend over the tilt.

The narrow sides of a plate have no length of their own: they lie in the flow along its
faces. Where that flow crosses them upright, their height counts as at least A / P.
"""

import abc
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import array_namespace, namespace, smooth_step
from ...voxels.body_shape import Plate
from ..flux_law import Forcing
from ..time_varying import largest, value_at
from .air import (
    film_argument,
    film_derivatives,
    horner,
    sampled_arguments,
)
from .buoyancy import PLATE, REGULARIZATION, FilmFactors, sixth_root
from .film import SAMPLING_MARGIN, AbstractFilmLaw, FilmState, film_range


# Type checkers know a class variable by its name in the module alone.
if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

_UP_LAMINAR = 0.54
_UP_TURBULENT = 0.15
_DOWN = 0.27
_SPHERE = 0.589

# Nusselt number of conduction from an isothermal disc with L = A / P = D / 4.
_STILL_DISC = 2 / np.pi

# Nusselt number of conduction from a sphere.
_STILL_SPHERE = 2.0

# Turbulent over laminar number of a warm side up at the end of the change between them,
# Ra 2.1e7; it begins where they are equal.
_TURBULENT_RATIO = 1.13

# Powers of the normal's vertical component: weights of faces up and down.
_UP_POWER = 2
_DOWN_POWER = 32

# Smallest 1 / L [1/m]: no body is a thousand kilometres long.
_MIN_PER_LENGTH = 1e-6

# The numbers of a warm and of a cold side pass into each other within about this
# difference [K].
_SIDE_CHANGE = 0.1

# Samples of the temperature difference for bounds.
_DIFFERENCE_SAMPLES = 129


class _AbstractShapeExchange(AbstractFilmLaw):
    """Heat flux h (T_inf - T_s) of free convection from plates or spheres [W/m^2]."""

    max_power: AbstractClassVar[float]
    """Largest power of the difference by which h grows."""
    has_sides: AbstractClassVar[bool]
    """True if h changes with the sign of the difference."""
    rows: eqx.AbstractVar[FilmFactors]
    """Film polynomials."""
    temperature: eqx.AbstractVar[Any]
    """T_inf [K], a number or a function of time."""
    reference: eqx.AbstractVar[Any]

    @abc.abstractmethod
    def _coefficient(self, film: FilmFactors, below: Any) -> Any:
        """Coefficient h [W/(m^2 K)] at values of the film and T_inf - T_s [K]."""

    @abc.abstractmethod
    def _largest_coefficient(self, film: FilmFactors, apart: Any) -> Any:
        """Bound of h on all cells where the difference is at most `apart` [K]."""

    @override
    def state(self, time, theta) -> FilmState:
        ambient = value_at(self.temperature, time)
        below = (ambient - self.reference) - theta

        def coefficient(theta):
            x, _ = film_argument(ambient + self.reference + theta)
            film = FilmFactors(*(horner(row, x)[0] for row in self.rows))
            return self._coefficient(film, (ambient - self.reference) - theta)

        h, dh = jax.jvp(coefficient, (theta,), (jnp.ones_like(theta),))
        return FilmState(difference=below, h=h, dh=dh)

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # The slope is at most h (1 + power + 1): h grows with the film temperature by a
        # power below 1.
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        apart = jnp.maximum(hottest, warmest)
        x = sampled_arguments(hottest.dtype)
        film = FilmFactors(
            *(horner(jnp.asarray(row, hottest.dtype), x)[0] for row in self.rows)
        )
        h = self._largest_coefficient(film, apart)
        return (2 + self.max_power) * 1.01 * h.max()

    @override
    def max_flux(self, within: Forcing, end: float) -> float:
        air = film_range(self.temperature, within, end)
        film = FilmFactors(
            *(film_derivatives(np.asarray(r, float), air.film).value for r in self.rows)
        )
        h = self._largest_coefficient(film, np.asarray(air.gap))
        return SAMPLING_MARGIN * float(h.max()) * air.gap

    @override
    def curvature(self, within: Forcing, end: float) -> float:
        # |h'' (T_inf - T_s)| + 2 |h'| of h = exp(l). For the difference d, |l'| is at
        # most power / D, with D^2 = d^2 + e^2 and its regularization e. For the change
        # w of warm into cold sides, |w'| = e^2 / (2 D^3) and |w''| is at most
        # 2 e^2 / D^4. For the film they are at most `first` and `second`.
        air = film_range(self.temperature, within, end)
        if not air.smooth:
            return np.inf
        derivatives = [
            film_derivatives(np.asarray(row, float), air.film) for row in self.rows
        ]
        # Twice, as the upright number is a square.
        first = 2 * max(float(np.abs(d.first / d.value).max()) for d in derivatives)
        second = 2 * max(float(np.abs(d.second / d.value).max()) for d in derivatives)
        film = FilmFactors(*(d.value for d in derivatives))
        tiny = REGULARIZATION / 100
        apart = np.geomspace(tiny, max(air.gap, tiny), _DIFFERENCE_SAMPLES)[:, None]
        regular = np.hypot(apart, REGULARIZATION)
        around = np.hypot(apart, _SIDE_CHANGE)
        change = self.has_sides * (_SIDE_CHANGE / around) ** 2 / around
        steep = self.max_power / regular + change / 2
        curved = self.max_power / regular**2 + 2 * change / around
        bend = curved + self.max_power / regular * change
        bend = bend + 2 * steep * first + second + first**2
        h = self._largest_coefficient(film, apart)
        return SAMPLING_MARGIN * float((h * (apart * bend + 2 * (steep + first))).max())


class PlateExchange(_AbstractShapeExchange):
    """Free convection from plates: h = U Nu_up + D Nu_down + S Nu_upright, times k / L.

    The weights U and D of a fragment are those of its normal, other ones where it is
    warmer than the air than where it is colder; S = 1 - U - D.
    """

    # Above 1/3, in the change between the two numbers of a warm side up.
    max_power = 0.4
    has_sides = True

    warm_up: Float[Any, " m"]
    """Weight of a warm side up where the surface is warmer than the air [-]."""
    warm_down: Float[Any, " m"]
    """Weight of a warm side down where the surface is warmer than the air [-]."""
    cold_up: Float[Any, " m"]
    """Weight of a warm side up where the surface is colder than the air [-]."""
    cold_down: Float[Any, " m"]
    """Weight of a warm side down where the surface is colder than the air [-]."""
    per_length: Float[Any, " m"]
    """1 / L of sides up and down [1/m]."""
    still: Float[Any, " m"]
    """0.825 / sqrt(L) of upright sides [m^(-1/2)]."""
    along: Float[Any, " m"]
    """(1 - c^2)^(1/12): the sixth root of the part of g along the side [-]."""
    rows: FilmFactors
    temperature: Any
    reference: Any = 0.0

    @override
    def _coefficient(self, film: FilmFactors, below: Any) -> Any:
        regular = jnp.sqrt(below * below + REGULARIZATION**2)
        warm = (1 - below / jnp.sqrt(below * below + _SIDE_CHANGE**2)) / 2
        up_weight = warm * self.warm_up + (1 - warm) * self.cold_up
        down_weight = warm * self.warm_down + (1 - warm) * self.cold_down
        lengths = _Lengths(self.per_length, still=self.still, along=self.along)
        up, down, upright = _sides(film, regular, lengths)
        weighted = up_weight * (up - upright) + down_weight * (down - upright)
        return upright + weighted

    @override
    def _largest_coefficient(self, film: FilmFactors, apart: Any) -> Any:
        xp = array_namespace((apart, film, self.per_length))
        # In the precision of JAX, which a number of the host may exceed.
        apart = xp.asarray(apart)
        regular = xp.sqrt(apart * apart + REGULARIZATION**2)
        shortest = [
            xp.asarray(values, apart.dtype).max(initial=0.0)
            for values in (self.per_length, self.still, self.along)
        ]
        sides = _sides(film, regular, _Lengths(*shortest))
        # Sides up have a larger number than sides down.
        turbulent = _UP_TURBULENT * film.third * sixth_root(regular) ** 2
        return xp.maximum(xp.maximum(sides.up, turbulent), sides.upright)

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "PlateExchange":
        # Upright parts of a cell have its lengths of upright sides, in the mean of warm
        # and cold.
        upright = (
            1 - (self.warm_up + self.warm_down + self.cold_up + self.cold_down) / 2
        )

        def upright_mean(values):
            total = mean(upright)
            xp = namespace(total)
            weighted = mean(upright * values)
            return xp.where(total > 0, weighted / xp.where(total > 0, total, 1), 0)

        return replace(
            self,
            warm_up=mean(self.warm_up),
            warm_down=mean(self.warm_down),
            cold_up=mean(self.cold_up),
            cold_down=mean(self.cold_down),
            per_length=mean(self.per_length),
            still=upright_mean(self.still),
            along=upright_mean(self.along),
        )


class _Lengths(NamedTuple):
    """Fields of `PlateExchange` of these names: arrays, or their largest values."""

    per_length: Any
    still: Any
    along: Any


class _Sides(NamedTuple):
    """Coefficients h of the sides of a plate [W/(m^2 K)]."""

    up: Any
    """Coefficient of a warm side up."""
    down: Any
    """Coefficient of a warm side down."""
    upright: Any


def _sides(film: FilmFactors, regular: Any, lengths: _Lengths) -> _Sides:
    """Coefficients of all sides at a regularized difference [K]."""
    xp = array_namespace((lengths, regular, film))
    sixth = sixth_root(regular)
    conduction = _STILL_DISC * film.root * film.root * lengths.per_length
    # Cells on which the law does not act have no length.
    per_length = xp.maximum(lengths.per_length, _MIN_PER_LENGTH)
    laminar = film.quarter * xp.sqrt(xp.sqrt(per_length * regular))
    up = xp.sqrt(conduction**2 + (_UP_LAMINAR * laminar) ** 2)
    down = xp.sqrt(conduction**2 + (_DOWN * laminar) ** 2)
    turbulent = _UP_TURBULENT * film.third * sixth * sixth
    beyond = (turbulent / (_UP_LAMINAR * laminar) - 1) / (_TURBULENT_RATIO - 1)
    t = xp.clip(beyond, 0, 1)
    upright = lengths.still * film.root + lengths.along * film.rise * sixth
    return _Sides(
        up=up + smooth_step(t) * (turbulent - up),
        down=down,
        upright=upright * upright,
    )


class SphereExchange(_AbstractShapeExchange):
    """Free convection from spheres, h = 2 k / D + 0.589 D^(-1/4) F |T_s - T_inf|^(1/4).

    Source: Churchill, Heat Exchanger Design Handbook (1983), 2.5.7; Ra up to 1e11.
    """

    max_power = 0.25
    has_sides = False

    per_length: Float[Any, " m"]
    """1 / D [1/m]."""
    rows: FilmFactors
    temperature: Any
    reference: Any = 0.0

    @override
    def _coefficient(self, film: FilmFactors, below: Any) -> Any:
        return _round(film, below, self.per_length)

    @override
    def _largest_coefficient(self, film: FilmFactors, apart: Any) -> Any:
        xp = array_namespace((apart, film, self.per_length))
        # In the precision of JAX, which a number of the host may exceed.
        apart = xp.asarray(apart)
        smallest = xp.asarray(self.per_length, apart.dtype).max(initial=0.0)
        return _round(film, apart, smallest)

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "SphereExchange":
        return replace(self, per_length=mean(self.per_length))


def _round(film: FilmFactors, below: Any, per_length: Any) -> Any:
    """Coefficient of spheres [W/(m^2 K)] of 1 / D [1/m] at T_inf - T_s [K]."""
    xp = array_namespace((per_length, below, film))
    regular = xp.sqrt(below * below + REGULARIZATION**2)
    # Cells on which the law does not act have no length.
    fourth_root = xp.sqrt(xp.sqrt(xp.maximum(per_length, _MIN_PER_LENGTH) * regular))
    still = _STILL_SPHERE * film.root * film.root * per_length
    return still + _SPHERE * film.round * fourth_root


def plate_factors(
    plate: Plate,
    normal: Float[np.ndarray, "s 3"],
    up: Float[np.ndarray, "3"],
    length: float | None,
) -> dict[str, Float[np.ndarray, " s"]]:
    """Factors of a plate's fragments, by the names of the fields of `PlateExchange`.

    Args:
        plate: in the frame of its body.
        normal: outward unit normals of the fragments in that frame.
        up: unit vector against gravity in that frame.
        length: L of all sides [m]; None for A / P and the mean height.
    """
    vertical = np.clip(normal @ up, -1, 1)
    facing_up = np.maximum(vertical, 0)
    facing_down = np.maximum(-vertical, 0)
    level_square = 1 - vertical**2
    face_length = plate.length if length is None else length
    height = np.full(len(normal), length or 1.0)
    if length is None:
        height = _heights(plate, rising=up - vertical[:, None] * normal)
    return {
        "warm_up": facing_up**_UP_POWER,
        "warm_down": facing_down**_DOWN_POWER,
        "cold_up": facing_down**_UP_POWER,
        "cold_down": facing_up**_DOWN_POWER,
        "per_length": np.full(len(normal), 1 / face_length),
        "still": PLATE.a / np.sqrt(height),
        "along": level_square ** (1 / 12),
    }


def _heights(plate: Plate, rising: Float[np.ndarray, "s 3"]) -> Float[np.ndarray, " s"]:
    """Lengths of a plate's sides along the flow, by the steepest way up them [m]."""
    size = np.linalg.norm(rising, axis=1)
    # On a horizontal side, where there is none, the upright number has no weight.
    direction = np.where(
        (size > 1e-9)[:, None],
        rising / np.maximum(size, 1e-9)[:, None],
        plate.long_axis,
    )
    across = direction @ plate.normal
    in_plane = direction - across[:, None] * plate.normal
    along = np.linalg.norm(in_plane, axis=1) * plate.mean_length(in_plane)
    return np.hypot(across * max(plate.thickness, plate.length), along)
