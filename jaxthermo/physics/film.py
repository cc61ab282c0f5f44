"""Heat exchanged with air whose properties follow the film temperature.

q = h(T_f) (T_inf - T_s) with T_f = (T_s + T_inf) / 2 at every place. Logarithms and
powers at every place and step would cost more than conduction does. So h is taken at
five film temperatures between 200 and 1000 K beforehand and interpolated by the
polynomial through them in 1 / (T_f + 600 K), a division and five products; outside, its
values at the ends hold. It is within 0.08 % of Churchill and Bernstein's formula, and
within 2.1 % of the other two averages, which bend sharply above Re 4000.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..tracing import is_traced
from .speed_table import SpeedTable
from .term import AbstractLaw
from .values import largest, value_at


LOWEST, HIGHEST = 200.0, 1000.0
"""Film temperatures between which h is interpolated [K]."""

NODES = 5

SHIFT = 600.0
"""Added to the film temperature [K]: the error has its least here."""

_NEAR, _FAR = 1 / (HIGHEST + SHIFT), 1 / (LOWEST + SHIFT)
_MIDDLE, _HALF = (_FAR + _NEAR) / 2, (_FAR - _NEAR) / 2
_PLACES = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)

FILM_TEMPERATURES = 1 / (_MIDDLE - _HALF * _PLACES) - SHIFT
"""Where h has to be known [K]: the Chebyshev nodes."""


def film_polynomial(values: Float[Array, "*g n"]) -> Float[Array, "*g n"]:
    """Coefficients, lowest power first, through h at the `FILM_TEMPERATURES`."""
    to_powers = np.linalg.inv(np.vander(_PLACES, NODES, increasing=True))
    return values @ jnp.asarray(to_powers.T.astype(values.dtype))


def film_place(double_film: Float[Array, "*m"]) -> tuple[Array, Array]:
    """The polynomial's argument, and its derivative, by T_s + T_inf [K]."""
    inverse = 2 / (double_film + 2 * SHIFT)
    x = (_MIDDLE - inverse) / _HALF
    slope = jnp.where(jnp.abs(x) < 1, inverse * inverse / (2 * _HALF), 0)
    return jnp.clip(x, -1, 1), slope


def horner(rows, x) -> tuple[Array, Array]:
    """A polynomial and its derivative; the coefficients' powers on the first axis."""
    value, slope = rows[NODES - 1], jnp.zeros_like(x)
    for power in range(NODES - 2, -1, -1):
        slope = slope * x + value
        value = value * x + rows[power]
    return value, slope


class FilmExchange(AbstractLaw):
    """Exchange with air through a coefficient that follows the film temperature."""

    coefficients: Any
    """Of the polynomial for h [W/(m^2 K)], [n m], or a `SpeedTable`."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Float[Any, ""]

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

    def steepest(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """An upper bound at any film temperature that is interpolated.

        With T_s - T_inf = 2 (T_f - T_inf) the slope is h + dh/dT_f (T_f - T_inf),
        linear in T_inf: the larger of its values at 0 K and at the warmest air.
        """
        tabulated = isinstance(self.coefficients, SpeedTable)
        rows = self.coefficients.table if tabulated else self.coefficients
        rows = jnp.moveaxis(jnp.asarray(rows, hottest.dtype), -2, 0)
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        bound = jnp.zeros_like(hottest)
        for film in np.linspace(LOWEST, HIGHEST, 17):
            x, per_kelvin = film_place(jnp.asarray(2 * film * (1 - 1e-6), rows.dtype))
            h, slope = horner(rows, jnp.broadcast_to(x, rows.shape[1:]))
            # Per kelvin of T_s, which is half of one of T_f.
            bend = 2 * slope * per_kelvin
            steep = h + jnp.maximum(bend * film, bend * (film - warmest))
            bound = jnp.maximum(bound, steep.max(initial=0.0))
        # The samples may miss the top by this much, and a table's cubic exceed it.
        return bound * (1.05 if tabulated else 1.01)

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    def merged(self, mean: Callable[[Array], Array]) -> "FilmExchange":
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
