"""Convection to air whose properties follow the film temperature.

    q = h(T_f) (T_inf - T_s),    T_f = (T_s + T_inf) / 2

in every surface cell, with h a polynomial in T_f (`air.film_polynomial`): within 0.08 %
of Churchill and Bernstein's formula, and within 2.1 % of the other two averages, which
have a sharp bend above Re 4000. Where the wind speed changes with time, the polynomial
is interpolated in a table over the speed.
"""

import abc
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import EXACT, array_namespace, is_traced, namespace
from ..flux_law import AbstractFluxLaw, Forcing
from ..time_varying import largest, smallest, value_at
from .air import (
    MAX_FILM_TEMPERATURE,
    MIN_FILM_TEMPERATURE,
    film_argument,
    film_derivatives,
    horner,
)


# Added under the fourth root [m/s], so that its slope at 0 is finite.
_SMALL_SPEED = 1e-6

# The cubic between nodes exceeds their largest absolute value by at most this factor.
_SPLINE_OVERSHOOT = 1.25

# Numpy turns an array without axes into a scalar.
_Speeds = Float[Array, "*v"] | Float[np.ndarray, "*v"] | np.floating | float


def _speed_root(speed: _Speeds) -> _Speeds:
    """Fourth root of a speed [m/s], shifted to be 0 with a finite slope at 0."""
    return (speed + _SMALL_SPEED) ** 0.25 - _SMALL_SPEED**0.25


def speed_nodes(highest: _Speeds, count: int, dtype: Any) -> Any:
    """Speeds [m/s] from 0 to `highest`, equidistant in their fourth root."""
    limit = namespace(highest).asarray(highest, dtype)
    root = np.linspace(0, 1, count).astype(dtype) * _speed_root(limit)
    nodes = (root + _SMALL_SPEED**0.25) ** 4 - _SMALL_SPEED
    # The first node may round to less than 0.
    return namespace(nodes).maximum(nodes, 0)


class _SpeedTable(Module):
    """Values by speed, with a smooth cubic (Catmull and Rom) between the nodes.

    The nodes are equidistant in the fourth root of the speed: a heat transfer
    coefficient goes with the square of that root or more, without a kink at 0.
    """

    table: Float[Any, "v n m"]
    """Values at the nodes, with one more row on each side for the slopes there."""
    highest: Any
    """Largest tabulated speed [m/s]; the last value applies above it."""
    speed: Callable
    """Speed [m/s] as a function of time [s]; negative values count as 0."""

    def __call__(self, time: Float[Array, ""]) -> Float[Array, "n m"]:
        """Interpolated values at `time` [s]."""
        inner = self.table.shape[0] - 2
        speed = value_at(self.speed, time)
        speed = jnp.where(speed > 0, speed, 0)
        relative = _speed_root(speed) / _speed_root(
            jnp.asarray(self.highest, time.dtype)
        )
        position = jnp.clip(relative, 0, 1) * (inner - 1)
        first = jnp.clip(jnp.floor(position), 0, inner - 2)
        t = position - first
        weights = [
            t * (t * (2 - t) - 1),
            t * t * (3 * t - 5) + 2,
            t * (t * (4 - 3 * t) + 1),
            t * t * (t - 1),
        ]
        # Row 0 is the node below zero.
        rows = jax.lax.dynamic_slice_in_dim(
            jnp.asarray(self.table), first.astype(jnp.int32), 4
        )
        return jnp.tensordot(jnp.stack(weights) / 2, rows, 1, precision=EXACT)


def speed_table(
    values: Float[Any, "v n m"], highest: Any, speed: Callable
) -> _SpeedTable:
    """Table from the values at the `speed_nodes`."""
    xp = array_namespace(values)
    below = 2 * values[0] - values[1]
    above = 2 * values[-1] - values[-2]
    table = xp.concatenate([below[None], values, above[None]])
    return _SpeedTable(table, highest, speed)


_FILM_SAMPLES = 33
_CELLS_AT_ONCE = 4096

SAMPLING_MARGIN = 1.05
"""Factor on bounds from samples: a maximum may lie between them."""


class _FilmRange(NamedTuple):
    """Temperatures of air and film that can occur during a run."""

    air: tuple[float, float]
    """Lowest and highest temperature of the air [K]."""
    gap: float
    """Largest difference between air and a surface [K]."""
    film: Float[np.ndarray, " f"]
    """Samples of the film temperature [K]."""
    smooth: bool
    """True if all film temperatures are inside the range of interpolation."""


def film_range(temperature: Any, within: Forcing, end: float) -> _FilmRange:
    """Range up to `end` [s] for air of a temperature [K], which may change."""
    coldest = float(smallest(temperature, end))
    warmest = float(largest(temperature, end))
    low = (coldest + within.lowest) / 2
    high = (warmest + within.highest) / 2
    samples = np.linspace(low, high, _FILM_SAMPLES)
    return _FilmRange(
        air=(coldest, warmest),
        gap=max(within.highest - coldest, warmest - within.lowest, 0.0),
        film=np.clip(samples, MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE),
        smooth=low > MIN_FILM_TEMPERATURE and high < MAX_FILM_TEMPERATURE,
    )


class FilmState(NamedTuple):
    """Difference and heat transfer coefficient between air and surface cells."""

    difference: Float[Array, "*#m"]
    """T_inf - T_s [K]."""
    h: Float[Array, "*#m"]
    """Heat transfer coefficient [W/(m^2 K)]."""
    dh: Float[Array, "*#m"]
    """dh / dT_s [W/(m^2 K^2)]."""


class AbstractFilmLaw(AbstractFluxLaw):
    """Heat flux h (T_inf - T_s) with an h that depends on the surface's temperature."""

    @abc.abstractmethod
    def state(self, time, theta) -> FilmState:
        """Difference and coefficient at surface temperatures above the reference."""

    @override
    @abc.abstractmethod
    def coarsened(self, mean: Callable[[Array], Array]) -> "AbstractFilmLaw": ...

    @override
    def flux(self, time, theta) -> Float[Array, "*#m"]:
        state = self.state(time, theta)
        return state.h * state.difference

    @override
    def heat_transfer_coefficient(self, time, theta) -> Float[Array, "*#m"]:
        return self.state(time, theta).h

    @override
    def slope(self, time, theta) -> Float[Array, "*#m"]:
        state = self.state(time, theta)
        return state.h - state.difference * state.dh


class FilmExchange(AbstractFilmLaw):
    """Heat flux h(T_f) (T_inf - T_s) from air [W/m^2]."""

    coefficients: Any
    """Film polynomial of h [W/(m^2 K)], [n m], or a `_SpeedTable` of it."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Any = 0.0

    @override
    def state(self, time, theta) -> FilmState:
        air = value_at(self.temperature, time)
        x, per_kelvin = film_argument(air + self.reference + theta)
        h, slope = horner(value_at(self.coefficients, time), x)
        return FilmState(
            difference=(air - self.reference) - theta, h=h, dh=slope * per_kelvin
        )

    @override
    def slope(self, time, theta) -> Float[Array, "*#m"]:
        return jnp.maximum(super().slope(time, theta), 0)

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # With T_s - T_inf = 2 (T_f - T_inf) the slope is h + dh/dT_f (T_f - T_inf),
        # linear in T_inf: the larger of its values at 0 K and at the warmest air bounds
        # it at every interpolated film temperature.
        tabulated = isinstance(self.coefficients, _SpeedTable)
        rows = jnp.asarray(self._rows, hottest.dtype)
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)

        def steepest(bound: Array, film: Array) -> tuple[Array, None]:
            x, per_kelvin = film_argument(2 * film * (1 - 1e-6))
            h, slope = horner(rows, jnp.broadcast_to(x, rows.shape[1:]))
            # Per kelvin of T_s, which is half of one of T_f.
            dh = 2 * slope * per_kelvin
            steep = h + jnp.maximum(dh * film, dh * (film - warmest))
            return jnp.maximum(bound, steep.max(initial=0.0)), None

        films = np.linspace(MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE, 17)
        # A loop in the program, since an unrolled one takes long to compile.
        bound, _ = jax.lax.scan(
            steepest, jnp.zeros_like(hottest), jnp.asarray(films, rows.dtype)
        )
        # The samples may miss the maximum, and the cubic of a table may exceed it.
        return bound * (1.05 if tabulated else 1.01)

    @override
    def max_flux(self, within: Forcing, end: float) -> float:
        air = film_range(self.temperature, within, end)
        largest_h = 0.0
        for rows in _blocks(self._rows):
            h = film_derivatives(rows, air.film).value
            largest_h = h.max(initial=largest_h)
        return SAMPLING_MARGIN * self._overshoot * float(largest_h) * air.gap

    @override
    def curvature(self, within: Forcing, end: float) -> float:
        # |h'' (T_inf - T_s) - 2 h'| with derivatives by T_s and T_inf - T_s =
        # 2 (T_inf - T_f): largest at an end of the air's range.
        air = film_range(self.temperature, within, end)
        if not air.smooth:
            # h has a kink at the ends of the interpolation: no finite bound there.
            return np.inf
        largest_bend = 0.0
        for rows in _blocks(self._rows):
            h = film_derivatives(rows, air.film)
            for ambient in dict.fromkeys(air.air):
                bend = h.second * 2 * (ambient - air.film) - 2 * h.first
                largest_bend = np.abs(bend, out=bend).max(initial=largest_bend)
        return SAMPLING_MARGIN * self._overshoot * float(largest_bend)

    @property
    def _rows(self) -> Any:
        """Coefficients with the powers along the first axis, [n ...]."""
        tabulated = isinstance(self.coefficients, _SpeedTable)
        rows = self.coefficients.table if tabulated else self.coefficients
        return namespace(rows).moveaxis(rows, -2, 0)

    @property
    def _overshoot(self) -> float:
        return _SPLINE_OVERSHOOT if isinstance(self.coefficients, _SpeedTable) else 1.0

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "FilmExchange":
        rows = self.coefficients
        if isinstance(rows, _SpeedTable):
            averaged = replace(rows, table=_row_means(mean, rows.table))
        else:
            averaged = _row_means(mean, rows)
        return replace(self, coefficients=averaged)


def _blocks(rows: Any) -> Iterator[Float[np.ndarray, "n k"]]:
    """Columns of coefficients, few enough for the processor's cache at a time."""
    flat = np.asarray(rows).reshape(len(rows), -1)
    for first in range(0, flat.shape[1], _CELLS_AT_ONCE):
        yield flat[:, first : first + _CELLS_AT_ONCE].astype(float)


def _row_means(mean: Callable[[Array], Array], values: Float[Any, "*r s"]) -> Any:
    """Means of an array's rows."""
    rows = values.reshape(-1, values.shape[-1])
    if is_traced(values):
        # Row by row a program of several bodies takes minutes to compile.
        means = mean(rows)
    else:
        # All at once they take several times the memory of the table.
        row_means = [mean(row) for row in rows]
        means = namespace(row_means).stack(row_means)
    return means.reshape(*values.shape[:-1], -1)
