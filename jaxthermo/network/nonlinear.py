"""Conduction where k and c_p depend on temperature, on any network of one material.

Kirchhoff's transform: with phi = integral of k / k_0 dT from the reference, the flux
between two nodes is k_0 A / L (phi_j - phi_i), exactly: the linear network at the
reference, applied to phi. Enthalpy: with eta = integral of c / c_0 dT,

    C_0 d eta_i / dt = sum_j G_0 (phi_j - phi_i),

so that the heat stored is sum C_0 eta to rounding, however steep c is: a peak that
stands for a latent heat cannot be stepped over. The state is eta [K].

Source: Carslaw and Jaeger, Conduction of Heat in Solids, 1.6; the enthalpy method,
Eyres et al., Phil. Trans. R. Soc. A 240 (1946) 1-57.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Scalar, is_traced
from ..material.property import Property
from .network import AbstractNetwork, inverse


# The integral of a piecewise linear property over temperature, and its inverse.
#
# On each piece it is a parabola. All are written about the point of the piece that is
# nearest to the reference, so that near it no digits are lost, and chosen by comparing
# with the knots in turn: for the few knots of a material faster than a search.


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


ROWS = 4
"""That a state without rows of its own is taken in."""


def _apart(
    function: Callable[[Array], Array], state: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """A function of every node, in a loop that makes it an array.

    Written out, XLA would compute it anew for every neighbour that reads it.
    """
    if state.ndim > 1:
        return jax.lax.map(function, state)
    padded = jnp.pad(state, (0, -len(state) % ROWS))
    return jax.lax.map(function, padded.reshape(ROWS, -1)).reshape(-1)[: len(state)]


class NonlinearNetwork(AbstractNetwork):
    """A linear network at the reference, with the integrals of what varies."""

    base: AbstractNetwork
    """With k and c_p as they are at the reference."""
    heat: Primitive | None
    """Of c_p; None where it does not vary, and the state is the temperature."""
    conduction: Primitive | None
    """Of k; None where it does not vary."""

    @property
    def linear(self) -> AbstractNetwork:
        """The network at the reference, which conducts phi."""
        return self.base

    @property
    def symmetric(self) -> bool:
        """As the network at the reference is."""
        return self.base.symmetric

    def temperature(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Above the reference [K], of a state or of any part of one."""
        return state if self.heat is None else self.heat.inverse(state)

    def state_of(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """The state of nodes at temperatures above the reference [K]."""
        return theta if self.heat is None else self.heat(theta)

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        return self.base.heat_rate(_apart(self.potential, state))

    def potential(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Phi, what drives conduction at the reference [K]."""
        theta = self.temperature(state)
        return theta if self.conduction is None else self.conduction(theta)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """Eta + dt / C_0 * (conduction into each node)."""
        return state + dt * inverse(self.base.capacity()) * self.heat_rate(state)

    def relative_conductivity(self, theta: Float[Array, "*m"]) -> Float[Array, "*#m"]:
        """k(T) / k_0 at temperatures above the reference [-]."""
        if self.conduction is None:
            return jnp.ones((), theta.dtype)
        return self.conduction.slope(theta)

    def largest_relative_conductivity(self) -> Float[Array, ""]:
        """At any temperature [-]."""
        one = jnp.ones((), self.total_capacity().dtype)
        return one if self.conduction is None else self.conduction.largest()

    def least_relative_capacity(self) -> Float[Array, ""]:
        """At any temperature [-]."""
        one = jnp.ones((), self.total_capacity().dtype)
        return one if self.heat is None else self.heat.least()

    def largest_relative_diffusivity(self) -> Float[Array, ""]:
        """The largest k / c_p of its table over that at the reference [-].

        Between two knots it is the ratio of two lines, so it is largest at a knot.
        """
        parts = [p for p in (self.heat, self.conduction) if p is not None]
        ratio = jnp.ones((), self.total_capacity().dtype)
        if not parts:
            return ratio
        knots = jnp.concatenate([part.knot for part in parts])
        if self.conduction is not None:
            ratio = self.conduction.slope(knots)
        if self.heat is not None:
            ratio = ratio / self.heat.slope(knots)
        return ratio.max()

    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the conductances of each node at the reference [W/K]."""
        return self.base.diagonal()

    def capacity(self) -> Float[Array, "..."]:
        """Of each node at the reference, C_0 [J/K]."""
        return self.base.capacity()

    def largest_rate(self) -> Float[Array, ""]:
        """Over all nodes, at the temperature of the largest k / c_p [1/s]."""
        return self.base.largest_rate() * self.largest_relative_diffusivity()

    def total_capacity(self) -> Float[Array, ""]:
        """Of the body at the reference [J/K]."""
        return self.base.total_capacity()

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature, sum of C_0 eta [J]."""
        return self.base.stored(state)
