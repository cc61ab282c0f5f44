"""Heat exchanged with air whose properties follow the film temperature.

q = h(T_f) (T_inf - T_s) with T_f = (T_s + T_inf) / 2 at every place, and h a polynomial
of it (`film_polynomial`), within 0.08 % of Churchill and Bernstein's formula, and
within 2.1 % of the other two averages, which bend sharply above Re 4000.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced
from ..term import AbstractLaw, Reach
from ..time_varying import largest, value_at
from .film_bounds import MISSED, film_derivatives, film_reach
from .film_polynomial import HIGHEST, LOWEST, film_place, horner
from .speed_table import OVERSHOOT, SpeedTable


class FilmExchange(AbstractLaw):
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

    def steepest(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """An upper bound at any film temperature that is interpolated.

        With T_s - T_inf = 2 (T_f - T_inf) the slope is h + dh/dT_f (T_f - T_inf),
        linear in T_inf: the larger of its values at 0 K and at the warmest air.
        """
        tabulated = isinstance(self.coefficients, SpeedTable)
        rows = jnp.asarray(self._rows, hottest.dtype)
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

    def largest_flux(self, reach: Reach) -> float:
        """The largest h times the largest difference."""
        air = film_reach(self.temperature, reach)
        h, _, _ = film_derivatives(np.asarray(self._rows, float), air.film)
        return MISSED * self._overshoot * float(h.max(initial=0.0)) * air.gap

    def curvature(self, reach: Reach) -> float:
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
