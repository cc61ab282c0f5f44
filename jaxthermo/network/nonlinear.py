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
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import Scalar, device_array, is_traced
from ..material.material import Property
from .columns import Columns
from .increasing_root import Balance, increasing_root
from .network import (
    AbstractDerivedNetwork,
    AbstractNetwork,
    Address,
    StepStart,
    inverse,
)


class WeightedMean(NamedTuple):
    """Sum of an enthalpy and a potential, each with a weight [W/K]."""

    heat: Callable[[Array, Array], Array]
    """Mean of c / c(reference) between two temperatures above the reference [-]."""
    conduction: Callable[[Array, Array], Array]
    """Mean of k / k(reference) between two temperatures above the reference [-]."""
    heat_weight: Float[Array, "*#m"]
    conduction_weight: Float[Array, "*m"]

    def mean(self, first: Array, second: Array) -> Array:
        """Mean slope between two temperatures [W/K]."""
        heat = self.heat_weight * self.heat(first, second)
        return heat + self.conduction_weight * self.conduction(first, second)


def rise_of_potential(
    weighted: WeightedMean, theta: Float[Array, "*m"], potential: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """Rise of a temperature [K] for a change of the potential, see `moved`.

    Without a derivative, like `increasing_root`.
    """
    slope = weighted.mean(theta, theta)
    target = slope * inverse(weighted.conduction(theta, theta)) * potential

    def excess(rise: Array) -> Balance:
        end = theta + rise
        value = weighted.mean(theta, end) * rise - target
        return Balance(value, weighted.mean(end, end))

    unbounded = jnp.full_like(theta, jnp.inf)
    return increasing_root(
        excess, start=target * inverse(slope), low=-unbounded, high=unbounded
    )


def conduction_weight(
    network: AbstractNetwork, heat_weight: Float[Array, "*#m"]
) -> Float[Array, "..."]:
    """Conductances of each node; 1 W/K where nothing else has a weight."""
    diagonal = network.diagonal()
    return jnp.where(heat_weight + diagonal > 0, diagonal, 1)


class _Piece(NamedTuple):
    """Columns of a `KirchhoffTransform` for the piece of each point."""

    base: Array
    integral: Array
    value: Array
    half_slope: Array


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

    def _piece(self, knots, x):
        """The piece that contains x: its base, integral, value and half slope."""
        # Comparison with one knot after the other: for few knots faster than a search.
        pieces = (self.base, self.base_integral, self.value, self.half_slope)
        columns = [jnp.broadcast_to(column[0], x.shape) for column in pieces]
        for k in range(len(knots)):
            is_beyond = x > knots[k]
            for number, column in enumerate(pieces):
                columns[number] = jnp.where(is_beyond, column[k + 1], columns[number])
        return _Piece._make(columns)

    def __call__(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """P [K] at temperatures above the reference [K]."""
        piece = self._piece(self.knot, theta)
        gap = theta - piece.base
        return piece.integral + gap * (piece.value + piece.half_slope * gap)

    def slope(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Slope of P, p / p(0) [-], at temperatures above the reference [K]."""
        piece = self._piece(self.knot, theta)
        return piece.value + 2 * piece.half_slope * (theta - piece.base)

    def mean(
        self, first: Float[Array, "*m"], second: Float[Array, "*m"]
    ) -> Float[Array, "*m"]:
        """Mean of p / p(0) between two temperatures above the reference [-].

        It is (P(second) - P(first)) / (second - first), the exact integral of the
        table, and p / p(0) where both are equal: no difference of integrals loses the
        digits of close temperatures.
        """
        low = jnp.minimum(first, second)
        high = jnp.maximum(first, second)
        span = high - low
        is_range = span > 0
        safe_span = jnp.where(is_range, span, 1)
        ends = [-jnp.inf, *self.knot, jnp.inf]
        mean = 0 * span
        for k in range(len(self.knot) + 1):
            # On each piece p is linear: its mean is that in the middle.
            begin = jnp.clip(low, ends[k], ends[k + 1])
            end = jnp.clip(high, ends[k], ends[k + 1])
            middle = (begin - self.base[k]) + (end - self.base[k])
            share = jnp.where(is_range, (end - begin) / safe_span, 0)
            mean = mean + share * (self.value[k] + self.half_slope[k] * middle)
        return jnp.where(is_range, mean, self.slope(first))

    def inverse(self, integral: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Temperature above the reference [K] at which P has these values [K]."""
        piece = self._piece(self.knot_integral, integral)
        excess = integral - piece.integral
        # The square of p / p(0) at the solution, which must not round to zero.
        square = piece.value * piece.value + 4 * piece.half_slope * excess
        square = jnp.maximum(square, self.min() ** 2 / 4)
        return piece.base + 2 * excess / (piece.value + jnp.sqrt(square))

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
    xp: Any = np
    work_dtype = float
    if is_traced((prop, reference)):
        xp = jnp
        work_dtype = dtype
    knot = xp.asarray(prop.temperatures, work_dtype)
    knot = knot - xp.asarray(reference, work_dtype)
    values = xp.asarray(prop.values, work_dtype)
    infinite = xp.full(1, np.inf, knot.dtype)
    low = xp.concatenate([-infinite, knot])
    high = xp.concatenate([knot, infinite])
    base = xp.clip(xp.zeros_like(low), low, high)
    rise = xp.diff(values) / xp.diff(knot)
    at_reference = xp.interp(base[:1] * 0, knot, values)
    slope = xp.pad(rise, 1) / at_reference
    value = xp.interp(base, knot, values) / at_reference

    def integral(theta):
        # Sum over the sections of all pieces between 0 and theta.
        gap = xp.clip(theta[:, None], low[None], high[None]) - base[None]
        return (gap * (value[None] + slope[None] / 2 * gap)).sum(axis=1)

    return KirchhoffTransform(
        knot=device_array(knot, dtype),
        knot_integral=device_array(integral(knot), dtype),
        base=device_array(base, dtype),
        base_integral=device_array(integral(base), dtype),
        value=device_array(value, dtype),
        half_slope=device_array(slope / 2, dtype),
    )


# Rows into which a one-dimensional state is reshaped for the loop below.
_ROWS = 4


def _materialized(
    function: Callable[[tuple[Array, ...]], Array], *states: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """Values of a function of every node, computed once."""
    # The loop makes them an array in memory. Otherwise XLA recomputes the function for
    # every neighbour that reads its value.
    if states[0].ndim > 1:
        return jax.lax.map(function, states)
    count = len(states[0])
    rows = tuple(
        jnp.pad(state, (0, -count % _ROWS)).reshape(_ROWS, -1) for state in states
    )
    return jax.lax.map(function, rows).reshape(-1)[:count]


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

    @property
    @override
    def columns(self) -> Columns | None:
        columns = self.base.columns
        return columns and columns.scaled(self.max_relative_diffusivity())

    @override
    def linearized(
        self, state: Float[Array, "..."]
    ) -> tuple[AbstractNetwork, Float[Array, "..."]]:
        # In the potential, conduction is linear and symmetric.
        _, slope = jax.jvp(self.potential, (state,), (jnp.ones_like(state),))
        return self.base, slope

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
        potential = _materialized(lambda states: self.potential(*states), state)
        return self.base.heat_rate(potential)

    @override
    def stepped_change(
        self, change: Float[Array, "..."], start: StepStart, dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        def potential_rise(states):
            before, change = states
            return self.potential(before + change) - self.potential(before)

        rise = _materialized(potential_rise, start.state, change)
        return change + dt * inverse(self.capacity()) * self.base.heat_rate(rise)

    @override
    def moved(
        self,
        state: Float[Array, "..."],
        potential: Float[Array, "..."],
        rate: Float[Array, ""],
    ) -> Float[Array, "..."]:
        heat_weight = rate * self.capacity()
        weighted = WeightedMean(
            heat=_mean(self.heat),
            conduction=_mean(self.conduction),
            heat_weight=heat_weight,
            conduction_weight=conduction_weight(self.base, heat_weight),
        )
        theta = self.temperature(state)
        return self.state_of(theta + rise_of_potential(weighted, theta, potential))

    def potential(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Potential phi, whose differences drive conduction at the reference [K]."""
        theta = self.temperature(state)
        return theta if self.conduction is None else self.conduction(theta)

    @override
    def relative_conductivity(
        self, theta: Float[Array, "*m"], fractions: Float[Array, "q m"] | None = None
    ) -> Float[Array, "*#m"]:
        if self.conduction is None:
            return super().relative_conductivity(theta)
        return self.conduction.slope(theta)

    @property
    @override
    def conductivity_varies(self) -> bool:
        return self.conduction is not None

    @override
    def mean_relative_conductivity(
        self,
        first: Float[Array, "*m"],
        second: Float[Array, "*m"],
        fractions: Float[Array, "q m"] | None = None,
    ) -> Float[Array, "*#m"]:
        if self.conduction is None:
            return super().mean_relative_conductivity(first, second)
        return self.conduction.mean(first, second)

    @override
    def max_relative_conductivity(self) -> Float[Array, ""]:
        unit_ratio = super().max_relative_conductivity()
        return unit_ratio if self.conduction is None else self.conduction.max()

    @override
    def min_relative_conductivity(self) -> Float[Array, ""]:
        unit_ratio = super().min_relative_conductivity()
        return unit_ratio if self.conduction is None else self.conduction.min()

    @override
    def min_relative_capacity(self) -> Float[Array, ""]:
        unit_ratio = super().min_relative_capacity()
        return unit_ratio if self.heat is None else self.heat.min()

    def max_relative_diffusivity(self) -> Float[Array, ""]:
        """Largest ratio of k / c to its reference value at any temperature [-]."""
        # Between two knots k / c_p is the ratio of two lines, so it is largest at a
        # knot.
        transforms = [p for p in (self.heat, self.conduction) if p is not None]
        ratio = jnp.ones((), self.total_capacity().dtype)
        if not transforms:
            return ratio
        knots = jnp.concatenate([transform.knot for transform in transforms])
        if self.conduction is not None:
            ratio = self.conduction.slope(knots)
        if self.heat is not None:
            ratio = ratio / self.heat.slope(knots)
        return ratio.max()

    @override
    def max_rate(self) -> Float[Array, ""]:
        # At the temperature of the largest k / c_p.
        return self.base.max_rate() * self.max_relative_diffusivity()


def _mean(transform: KirchhoffTransform | None) -> Callable[[Array, Array], Array]:
    if transform is None:
        return lambda first, second: jnp.ones_like(second)
    return transform.mean
