"""Heat exchanged with air whose properties follow the film temperature.

q = h(T_f) (T_inf - T_s) with T_f = (T_s + T_inf) / 2 at every place, and h a polynomial
of it (`film_polynomial`), within 0.08 % of Churchill and Bernstein's formula, and
within 2.1 % of the other two averages, which bend sharply above Re 4000.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import polynomial

from ...arrays import is_traced
from ..term import AbstractFluxLaw, TemperatureRange
from ..time_varying import largest, smallest, value_at
from .air import (
    HALF,
    MAX_FILM_TEMPERATURE,
    MIDDLE,
    MIN_FILM_TEMPERATURE,
    SHIFT,
    film_place,
    horner,
)


# Coefficients of every place by a speed that changes with time.


SMALL_SPEED = 1e-6
"""Added under the root [m/s], for its slope at 0."""

Speeds = Float[Array, "*v"] | Float[np.ndarray, "*v"] | float


def speed_root(speed: Speeds) -> Speeds:
    """The fourth root of a speed [m/s], lifted off 0 and less what that adds."""
    return (speed + SMALL_SPEED) ** 0.25 - SMALL_SPEED**0.25


def speed_nodes(highest: Speeds, count: int, dtype: Any) -> Any:
    """Speeds [m/s] from 0 to the highest, even in their fourth root."""
    root = np.linspace(0, 1, count).astype(dtype) * speed_root(highest)
    nodes = (root + SMALL_SPEED**0.25) ** 4 - SMALL_SPEED
    # The first may round to less than 0.
    return nodes * (nodes > 0)


OVERSHOOT = 1.25
"""Most that the cubic between nodes makes of their largest absolute value."""


class SpeedTable(eqx.Module):
    """Values by speed, with a smooth cubic (Catmull and Rom) between the nodes.

    The nodes are even in the fourth root of the speed: a heat transfer coefficient goes
    with its square or more, without a bend at 0.
    """

    table: Float[Any, "v n m"]
    """The nodes', with one more on each side for the slopes at the ends."""
    highest: Any
    """[m/s]; above, the last value holds."""
    speed: Callable
    """Of time [s], [m/s]; below 0 it counts as 0."""

    def __call__(self, time: Float[Array, ""]) -> Float[Array, "n m"]:
        """The values at `time` [s]."""
        inner = self.table.shape[0] - 2
        speed = value_at(self.speed, time)
        speed = jnp.where(speed > 0, speed, 0)
        share = speed_root(speed) / speed_root(jnp.asarray(self.highest, time.dtype))
        place = jnp.clip(share, 0, 1) * (inner - 1)
        first = jnp.clip(jnp.floor(place), 0, inner - 2)
        t = place - first
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
        return jnp.tensordot(jnp.stack(weights) / 2, rows, 1)


def speed_table(
    values: Float[Any, "v n m"], highest: Any, speed: Callable
) -> SpeedTable:
    """From the values at the `speed_nodes`."""
    own = np if isinstance(values, np.ndarray) else jnp
    below, above = 2 * values[0] - values[1], 2 * values[-1] - values[-2]
    table = own.concatenate([below[None], values, above[None]])
    return SpeedTable(table, highest, speed)


# How large and how bent a film polynomial gets, for the balance at the surface.
#
# Between `MIN_FILM_TEMPERATURE` and `MAX_FILM_TEMPERATURE` it is smooth; at those film
# temperatures it has a kink, whose curvature has no bound.


FILM_SAMPLES = 33
MISSED = 1.05
"""The samples may miss the top by this much."""


class FilmReach(NamedTuple):
    """Temperatures of air and of film that a run can get to."""

    air: tuple[float, float]
    """The coldest and the warmest [K]."""
    gap: float
    """The largest difference to a surface [K]."""
    film: Float[np.ndarray, " f"]
    """Samples of the film temperature [K]."""
    smooth: bool
    """Whether all of them are inside the interpolation."""


def film_reach(temperature: Any, reach: TemperatureRange) -> FilmReach:
    """Of air at a temperature [K], which may change with time."""
    air = (
        float(smallest(temperature, reach.end)),
        float(largest(temperature, reach.end)),
    )
    low, high = (air[0] + reach.lowest) / 2, (air[1] + reach.highest) / 2
    return FilmReach(
        air=air,
        gap=max(reach.highest - air[0], air[1] - reach.lowest, 0.0),
        film=np.clip(
            np.linspace(low, high, FILM_SAMPLES),
            MIN_FILM_TEMPERATURE,
            MAX_FILM_TEMPERATURE,
        ),
        smooth=low > MIN_FILM_TEMPERATURE and high < MAX_FILM_TEMPERATURE,
    )


def film_derivatives(
    rows: Float[np.ndarray, "n *g"], film: Float[np.ndarray, " f"]
) -> tuple[Float[np.ndarray, "*g f"], ...]:
    """A film polynomial and its first and second derivative by T_s.

    Args:
        rows: its coefficients, the powers on the first axis.
        film: temperatures T_f [K].
    """
    inverse = 1 / (film + SHIFT)
    x, slope = (MIDDLE - inverse) / HALF, inverse**2 / (2 * HALF)
    bend = -slope * inverse
    once, twice = polynomial.polyder(rows), polynomial.polyder(rows, 2)
    by_x = polynomial.polyval(x, once)
    return (
        polynomial.polyval(x, rows),
        by_x * slope,
        polynomial.polyval(x, twice) * slope**2 + by_x * bend,
    )


class FilmExchange(AbstractFluxLaw):
    """Exchange with air through a coefficient that follows the film temperature."""

    coefficients: Any
    """Of the polynomial for h [W/(m^2 K)], [n m], or a `SpeedTable`."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Float[Any, "*#m"]

    def _at(self, time, theta) -> tuple[Array, Array, Array]:
        """T_inf - T_s, h, and d h / d T_s."""
        air = value_at(self.temperature, time)
        x, per_kelvin = film_place(air + self.reference + theta)
        h, slope = horner(value_at(self.coefficients, time), x)
        return (air - self.reference) - theta, h, slope * per_kelvin

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
        return jnp.maximum(h - below * bend, 0)

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """An upper bound at any film temperature that is interpolated.

        With T_s - T_inf = 2 (T_f - T_inf) the slope is h + dh/dT_f (T_f - T_inf),
        linear in T_inf: the larger of its values at 0 K and at the warmest air.
        """
        tabulated = isinstance(self.coefficients, SpeedTable)
        rows = jnp.asarray(self._rows, hottest.dtype)
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        bound = jnp.zeros_like(hottest)
        for film in np.linspace(MIN_FILM_TEMPERATURE, MAX_FILM_TEMPERATURE, 17):
            x, per_kelvin = film_place(jnp.asarray(2 * film * (1 - 1e-6), rows.dtype))
            h, slope = horner(rows, jnp.broadcast_to(x, rows.shape[1:]))
            # Per kelvin of T_s, which is half of one of T_f.
            bend = 2 * slope * per_kelvin
            steep = h + jnp.maximum(bend * film, bend * (film - warmest))
            bound = jnp.maximum(bound, steep.max(initial=0.0))
        # The samples may miss the top by this much, and a table's cubic exceed it.
        return bound * (1.05 if tabulated else 1.01)

    def max_flux(self, reach: TemperatureRange) -> float:
        """The largest h times the largest difference."""
        air = film_reach(self.temperature, reach)
        h, _, _ = film_derivatives(np.asarray(self._rows, float), air.film)
        return MISSED * self._overshoot * float(h.max(initial=0.0)) * air.gap

    def curvature(self, reach: TemperatureRange) -> float:
        """|d2h/dT_s2 (T_inf - T_s) - 2 dh/dT_s|, largest at an end of the air's range.

        There T_inf - T_s = 2 (T_inf - T_f). At the ends of the interpolation h has a
        kink.
        """
        air = film_reach(self.temperature, reach)
        if not air.smooth:
            return np.inf
        _, once, twice = film_derivatives(np.asarray(self._rows, float), air.film)
        bends = [
            np.abs(twice * 2 * (end - air.film) - 2 * once).max(initial=0.0)
            for end in air.air
        ]
        return MISSED * self._overshoot * float(max(bends))

    @property
    def _rows(self) -> Any:
        """Coefficients with the powers on the first axis, [n ...]."""
        tabulated = isinstance(self.coefficients, SpeedTable)
        rows = self.coefficients.table if tabulated else self.coefficients
        return (jnp if is_traced(rows) else np).moveaxis(rows, -2, 0)

    @property
    def _overshoot(self) -> float:
        return OVERSHOOT if isinstance(self.coefficients, SpeedTable) else 1.0

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    def coarsened(self, mean: Callable[[Array], Array]) -> "FilmExchange":
        """With the mean coefficient of each new place."""
        where = lambda law: (
            law.coefficients.table
            if isinstance(law.coefficients, SpeedTable)
            else law.coefficients
        )
        return eqx.tree_at(where, self, _each_row(mean, where(self)))


def _each_row(mean: Callable[[Array], Array], values: Float[Any, "*r s"]) -> Any:
    """Means of the rows of an array, which `mean` takes one at a time."""
    rows = [mean(row) for row in values.reshape(-1, values.shape[-1])]
    stacked = (jnp if is_traced(rows) else np).stack(rows)
    return stacked.reshape(*values.shape[:-1], -1)
