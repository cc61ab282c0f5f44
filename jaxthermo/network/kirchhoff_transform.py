"""The integral of a piecewise linear property over temperature, and its inverse.

On each piece it is a parabola. All are written about the point of the piece that is
nearest to the reference, so that near it no digits are lost, and chosen by comparing
with the knots in turn: for the few knots of a material faster than a search.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Scalar, is_traced
from ..material.property import Property


class Primitive(eqx.Module):
    """P(theta) = integral from 0 to theta of p / p(0) [K]; increasing, P(0) = 0.

    theta counts from the reference, and p is constant beyond the outermost knots. There
    are m knots, and m + 1 pieces between and beyond them.
    """

    knot: Float[Array, " m"]
    """Of theta [K], increasing."""
    knot_integral: Float[Array, " m"]
    """P there [K]."""
    base: Float[Array, " pieces"]
    """The point of each piece nearest to 0 [K]."""
    base_integral: Float[Array, " pieces"]
    """P there [K]."""
    value: Float[Array, " pieces"]
    """p / p(0) there [-]."""
    half_slope: Float[Array, " pieces"]
    """Half of what p / p(0) rises by a kelvin [1/K]."""

    def _piece(self, knots, x, *columns):
        """For each x the entries of its piece: knots in turn, each may move it on."""
        found = [jnp.broadcast_to(column[0], x.shape) for column in columns]
        for k in range(len(knots)):
            beyond = x > knots[k]
            found = [
                jnp.where(beyond, column[k + 1], old)
                for column, old in zip(columns, found, strict=True)
            ]
        return found

    def __call__(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """P at temperatures above the reference [K]."""
        columns = (self.base, self.base_integral, self.value, self.half_slope)
        base, integral, value, half = self._piece(self.knot, theta, *columns)
        gap = theta - base
        return integral + gap * (value + half * gap)

    def slope(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Of P there, p / p(0) [-]."""
        columns = (self.base, self.value, self.half_slope)
        base, value, half = self._piece(self.knot, theta, *columns)
        return value + 2 * half * (theta - base)

    def inverse(self, integral: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """The temperature above the reference at which P has these values [K]."""
        columns = (self.base, self.base_integral, self.value, self.half_slope)
        base, at, value, half = self._piece(self.knot_integral, integral, *columns)
        rest = integral - at
        # The square of p / p(0) at the end, which rounding must not take to zero.
        square = jnp.maximum(value * value + 4 * half * rest, self.least() ** 2 / 4)
        return base + 2 * rest / (value + jnp.sqrt(square))

    def least(self) -> Float[Array, ""]:
        """The smallest p / p(0) at any temperature [-]."""
        return self.slope(self.knot).min()

    def largest(self) -> Float[Array, ""]:
        """The largest [-]."""
        return self.slope(self.knot).max()


def primitive(prop: Property, reference: Scalar, dtype: Any) -> Primitive:
    """The integral of a property from a reference temperature [K]."""
    # In double precision where nothing is traced: differences of two temperatures.
    own, width = (jnp, dtype) if is_traced((prop, reference)) else (np, float)
    number = lambda x: own.asarray(x, width)
    knot = number(prop.temperatures) - number(reference)
    given = number(prop.values)
    infinite = own.full(1, np.inf, knot.dtype)
    low = own.concatenate([-infinite, knot])
    high = own.concatenate([knot, infinite])
    base = own.clip(own.zeros_like(low), low, high)
    rise = own.diff(given) / own.diff(knot)
    slope = own.pad(rise, 1)
    value = own.interp(base, knot, given)
    value, slope = (x / own.interp(base[:1] * 0, knot, given) for x in (value, slope))

    def integral(at):
        # Of the part of each piece that lies between 0 and the point, summed.
        gap = own.clip(at[:, None], low[None], high[None]) - base[None]
        return (gap * (value[None] + slope[None] / 2 * gap)).sum(axis=1)

    columns = (knot, integral(knot), base, integral(base), value, slope / 2)
    return Primitive(*(jnp.asarray(column, dtype) for column in columns))
