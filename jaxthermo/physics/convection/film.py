"""Convection to air whose properties follow the film temperature.

    q = h(T_f) (T_inf - T_s),    T_f = (T_s + T_inf) / 2

in every surface cell, with h a polynomial in T_f (`air.film_polynomial`): within 0.08 %
of Churchill and Bernstein's formula, and within 2.1 % of the other two averages, which
have a sharp bend above Re 4000. Where the wind speed changes with time, the polynomial
is interpolated in a table over the speed.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import EXACT, is_traced
from ...module import Module
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

_Speeds = Float[Array, "*v"] | Float[np.ndarray, "*v"] | float


def _speed_root(speed: _Speeds) -> _Speeds:
    """Fourth root of a speed [m/s], shifted to be 0 with a finite slope at 0."""
    return (speed + _SMALL_SPEED) ** 0.25 - _SMALL_SPEED**0.25


def speed_nodes(highest: _Speeds, count: int, dtype: Any) -> Any:
    """Speeds [m/s] from 0 to `highest`, equidistant in their fourth root."""
    root = np.linspace(0, 1, count).astype(dtype) * _speed_root(highest)
    nodes = (root + _SMALL_SPEED**0.25) ** 4 - _SMALL_SPEED
    # The first may round to less than 0.
    return nodes * (nodes > 0)


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
    xp = np if isinstance(values, np.ndarray) else jnp
    below, above = 2 * values[0] - values[1], 2 * values[-1] - values[-2]
    table = xp.concatenate([below[None], values, above[None]])
    return _SpeedTable(table, highest, speed)


_FILM_SAMPLES = 33
_CELLS_AT_ONCE = 4096

SAMPLING_MARGIN = 1.05
"""Factor on bounds that are found by sampling: a maximum may lie between samples."""


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
    air = float(smallest(temperature, end)), float(largest(temperature, end))
    low, high = (air[0] + within.lowest) / 2, (air[1] + within.highest) / 2
    samples = np.linspace(low, high, _FILM_SAMPLES)
    return _FilmRange(
        air=air,
        gap=max(within.highest - air[0], air[1] - within.lowest, 0.0),
        film=np.clip(samples, MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE),
        smooth=low > MIN_FILM_TEMPERATURE and high < MAX_FILM_TEMPERATURE,
    )


class FilmExchange(AbstractFluxLaw):
    """Heat flux h(T_f) (T_inf - T_s) from air [W/m^2]."""

    coefficients: Any
    """Film polynomial of h [W/(m^2 K)], [n m], or a `_SpeedTable` of it."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Any = 0.0

    def _at(self, time, theta) -> tuple[Array, Array, Array]:
        """T_inf - T_s [K], h, and dh/dT_s."""
        air = value_at(self.temperature, time)
        x, per_kelvin = film_argument(air + self.reference + theta)
        h, slope = horner(value_at(self.coefficients, time), x)
        return (air - self.reference) - theta, h, slope * per_kelvin

    @override
    def flux(self, time, theta) -> Float[Array, "*#m"]:
        difference, h, _ = self._at(time, theta)
        return h * difference

    @override
    def heat_transfer_coefficient(self, time, theta) -> Float[Array, "*#m"]:
        return self._at(time, theta)[1]

    @override
    def slope(self, time, theta) -> Float[Array, "*#m"]:
        difference, h, dh = self._at(time, theta)
        return jnp.maximum(h - difference * dh, 0)

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
        # A loop in the program: unrolled, it took most of the compilation.
        bound, _ = jax.lax.scan(
            steepest, jnp.zeros_like(hottest), jnp.asarray(films, rows.dtype)
        )
        # The samples may miss the maximum by this much, and a table's cubic exceed it.
        return bound * (1.05 if tabulated else 1.01)

    @override
    def max_flux(self, within: Forcing, end: float) -> float:
        air = film_range(self.temperature, within, end)
        largest_h = 0.0
        for rows in _blocks(self._rows):
            h, _, _ = film_derivatives(rows, air.film)
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
        found = 0.0
        for rows in _blocks(self._rows):
            _, once, twice = film_derivatives(rows, air.film)
            for ambient in dict.fromkeys(air.air):
                bend = twice * 2 * (ambient - air.film) - 2 * once
                found = np.abs(bend, out=bend).max(initial=found)
        return SAMPLING_MARGIN * self._overshoot * float(found)

    @property
    def _rows(self) -> Any:
        """Coefficients with the powers along the first axis, [n ...]."""
        tabulated = isinstance(self.coefficients, _SpeedTable)
        rows = self.coefficients.table if tabulated else self.coefficients
        return (jnp if is_traced(rows) else np).moveaxis(rows, -2, 0)

    @property
    def _overshoot(self) -> float:
        return _SPLINE_OVERSHOOT if isinstance(self.coefficients, _SpeedTable) else 1.0

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "FilmExchange":
        where = lambda law: (
            law.coefficients.table
            if isinstance(law.coefficients, _SpeedTable)
            else law.coefficients
        )
        return eqx.tree_at(where, self, _each_row(mean, where(self)))


def _blocks(rows: Any) -> Iterator[Float[np.ndarray, "n k"]]:
    """Columns of coefficients, few enough for the processor's cache at a time."""
    flat = np.asarray(rows).reshape(len(rows), -1)
    for first in range(0, flat.shape[1], _CELLS_AT_ONCE):
        yield flat[:, first : first + _CELLS_AT_ONCE].astype(float)


def _each_row(mean: Callable[[Array], Array], values: Float[Any, "*r s"]) -> Any:
    """Means of the rows of an array, which `mean` takes one at a time."""
    rows = [mean(row) for row in values.reshape(-1, values.shape[-1])]
    stacked = (jnp if is_traced(rows) else np).stack(rows)
    return stacked.reshape(*values.shape[:-1], -1)
