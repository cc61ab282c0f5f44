"""Conduction where k and c_p depend on temperature, on any network of one material.

Kirchhoff's transform: with phi = integral of k / k_0 dT from the reference, the flux
between two nodes is k_0 A / L (phi_j - phi_i), exactly: the linear network at the
reference, applied to phi. Enthalpy: with eta = integral of c / c_0 dT,

    C_0 d eta_i / dt = sum_j G_0 (phi_j - phi_i),

so that the stored heat is sum C_0 eta to rounding error, however steep c is: no time
step can skip a peak that represents a latent heat. The state is eta [K].

Source: Carslaw and Jaeger, Conduction of Heat in Solids, 1.6; the enthalpy method,
Eyres et al., Phil. Trans. R. Soc. A 240 (1946) 1-57.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import Scalar, device_array, is_traced
from ..material.material import Property
from ..module import Module
from .network import AbstractDerivedNetwork, AbstractNetwork, Address


class KirchhoffTransform(Module):
    """P(theta) = integral from 0 to theta of p / p(0) [K]; increasing, P(0) = 0.

    theta is the temperature above the reference, and the property p is piecewise
    linear, constant beyond the outermost knots: m knots, and m + 1 pieces between and
    beyond them, on each of which P is a parabola.
    """

    knot: Float[Array, " m"]
    """theta at the knots [K], increasing."""
    knot_integral: Float[Array, " m"]
    """P at the knots [K]."""
    base: Float[Array, " pieces"]
    """Point of each piece nearest to 0 [K]: near the reference no digits are lost."""
    base_integral: Float[Array, " pieces"]
    """P at the base [K]."""
    value: Float[Array, " pieces"]
    """p / p(0) at the base [-]."""
    half_slope: Float[Array, " pieces"]
    """Half of the slope of p / p(0) [1/K]."""

    def _piece(self, knots, x, *columns):
        """Values of each column for the piece that contains x."""
        # Comparison with one knot after the other: for few knots faster than a search.
        found = [jnp.broadcast_to(column[0], x.shape) for column in columns]
        for k in range(len(knots)):
            beyond = x > knots[k]
            found = [
                jnp.where(beyond, column[k + 1], old)
                for column, old in zip(columns, found, strict=True)
            ]
        return found

    def __call__(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """P [K] at temperatures above the reference [K]."""
        columns = (self.base, self.base_integral, self.value, self.half_slope)
        base, integral, value, half = self._piece(self.knot, theta, *columns)
        gap = theta - base
        return integral + gap * (value + half * gap)

    def slope(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Slope of P, p / p(0) [-], at temperatures above the reference [K]."""
        columns = (self.base, self.value, self.half_slope)
        base, value, half = self._piece(self.knot, theta, *columns)
        return value + 2 * half * (theta - base)

    def inverse(self, integral: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Temperature above the reference [K] at which P has these values [K]."""
        columns = (self.base, self.base_integral, self.value, self.half_slope)
        base, at, value, half = self._piece(self.knot_integral, integral, *columns)
        rest = integral - at
        # The square of p / p(0) at the solution, which must not round to zero.
        square = jnp.maximum(value * value + 4 * half * rest, self.min() ** 2 / 4)
        return base + 2 * rest / (value + jnp.sqrt(square))

    def min(self) -> Float[Array, ""]:
        """Smallest p / p(0) at any temperature [-]."""
        return self.slope(self.knot).min()

    def max(self) -> Float[Array, ""]:
        """Largest p / p(0) at any temperature [-]."""
        return self.slope(self.knot).max()


def kirchhoff_transform(
    prop: Property, reference: Scalar, dtype: Any
) -> KirchhoffTransform:
    """Transform of a property from a reference temperature [K]."""
    # In double precision where nothing is traced, for differences of temperatures.
    xp, width = (jnp, dtype) if is_traced((prop, reference)) else (np, float)
    number = lambda x: xp.asarray(x, width)
    knot = number(prop.temperatures) - number(reference)
    given = number(prop.values)
    infinite = xp.full(1, np.inf, knot.dtype)
    low = xp.concatenate([-infinite, knot])
    high = xp.concatenate([knot, infinite])
    base = xp.clip(xp.zeros_like(low), low, high)
    rise = xp.diff(given) / xp.diff(knot)
    slope = xp.pad(rise, 1)
    value = xp.interp(base, knot, given)
    value, slope = (x / xp.interp(base[:1] * 0, knot, given) for x in (value, slope))

    def integral(at):
        # Sum over the parts of all pieces between 0 and the point.
        gap = xp.clip(at[:, None], low[None], high[None]) - base[None]
        return (gap * (value[None] + slope[None] / 2 * gap)).sum(axis=1)

    columns = (knot, integral(knot), base, integral(base), value, slope / 2)
    return KirchhoffTransform(*(device_array(column, dtype) for column in columns))


# Rows into which a one-dimensional state is reshaped for the loop below.
_ROWS = 4


def _materialized(
    function: Callable[[Array], Array], state: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """Values of a function of every node, computed once."""
    # The loop makes them an array in memory. Otherwise XLA recomputes the function for
    # every neighbour that reads its value.
    if state.ndim > 1:
        return jax.lax.map(function, state)
    padded = jnp.pad(state, (0, -len(state) % _ROWS))
    return jax.lax.map(function, padded.reshape(_ROWS, -1)).reshape(-1)[: len(state)]


class NonlinearNetwork(AbstractDerivedNetwork):
    """Linear network at the reference, with the transforms of k and c_p."""

    is_linear = False

    base: AbstractNetwork
    """Network with k and c_p at the reference."""
    heat: KirchhoffTransform | None
    """Transform of c_p; None if c_p is constant and the state is the temperature."""
    conduction: KirchhoffTransform | None
    """Transform of k; None if k is constant."""

    @property
    @override
    def linear(self) -> AbstractNetwork:
        return self.base

    @property
    @override
    def is_symmetric(self) -> bool:
        return self.base.is_symmetric

    @override
    def linearized(
        self, state: Float[Array, "..."]
    ) -> tuple[AbstractNetwork, Float[Array, "..."]]:
        # For the potential conduction is linear, and symmetric.
        return self.base, jax.jvp(self.potential, (state,), (jnp.ones_like(state),))[1]

    @override
    def temperature(
        self, state: Float[Array, "*m"], address: Address | None = None
    ) -> Float[Array, "*m"]:
        return state if self.heat is None else self.heat.inverse(state)

    @override
    def state_of(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        return theta if self.heat is None else self.heat(theta)

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return self.base.heat_rate(_materialized(self.potential, state))

    def potential(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Potential phi, whose differences drive conduction at the reference [K]."""
        theta = self.temperature(state)
        return theta if self.conduction is None else self.conduction(theta)

    @override
    def relative_conductivity(
        self, theta: Float[Array, "*m"], parts: Float[Array, "q m"] | None = None
    ) -> Float[Array, "*#m"]:
        if self.conduction is None:
            return super().relative_conductivity(theta)
        return self.conduction.slope(theta)

    @override
    def max_relative_conductivity(self) -> Float[Array, ""]:
        one = super().max_relative_conductivity()
        return one if self.conduction is None else self.conduction.max()

    @override
    def min_relative_capacity(self) -> Float[Array, ""]:
        one = super().min_relative_capacity()
        return one if self.heat is None else self.heat.min()

    def max_relative_diffusivity(self) -> Float[Array, ""]:
        """Largest ratio of k / c to its reference value at any temperature [-]."""
        # Between two knots k / c_p is the ratio of two lines, so it is largest at a
        # knot.
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

    @override
    def max_rate(self) -> Float[Array, ""]:
        # At the temperature of the largest k / c_p.
        return self.base.max_rate() * self.max_relative_diffusivity()
