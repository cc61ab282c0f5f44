"""Energy balance at the surface: all mechanisms against conduction to the node.

The surface is half a cell away from its node. Its temperature T_s is where the heat of
all mechanisms equals the heat that conduction carries to the node:

    sum_i q_i(T_s) = G (T_s - T_node),    G = k A / distance.

All mechanisms act at that one T_s, so a sun on an insulator heats its surface, which
then convects and emits accordingly; a node alone would do so too late and too little,
with an error of first order in the pitch. Newton's method solves the balance: in one
iteration where every law is linear, else from a supersolution of emission, where it
cannot overshoot. Laws that are neither linear nor emission, such as convection with
variable properties, are so nearly linear that the start may be their tangent at the
node.

The number of iterations is known beforehand. From a start e_0 kelvin off each leaves at
most

    e_{n+1} = c e_n^2,    c = max |q''| / (2 G),

with the curvature q'' of the flux. A metal's half cell conducts a thousand times better
than its surface radiates: there one iteration from the node's temperature is exact to
rounding, whereas a near-insulator in the sun needs all iterations.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import Time, is_traced, stop_gradient
from ..network.increasing_root import Balance, increasing_root
from ..network.network import inverse, precise_sum
from .flux_law import (
    AbstractFluxLaw,
    BoundTerm,
    FluxBounds,
    LinearSum,
    PerCell,
    PerCellOrOne,
    Values,
    bound,
)
from .half_cells import Extremes, Linearized, Rates, Solved, VaryingHalfCells


MAX_ITERATIONS = 6
"""Newton iterations, which reduce the error in a near-insulator to 1e-6 of q, also from
ten times the node's temperature."""

_TOLERANCE = {"float32": 1e-5, "float64": 1e-12}
"""About one rounding of a difference of 100 K, by the type of the state [K]."""

_NumberedTerms = tuple[tuple[int, BoundTerm], ...]
"""Bound terms, each with the index of its mechanism's name."""


class SurfaceTerms(Module):
    """Mechanisms that act on surface cells: fragments, or several of them combined."""

    names: tuple[str, ...] = eqx.field(static=True)
    """Mechanisms, by number."""
    half_cell: Float[Values, " m"]
    """Conductance G from the natural part of each cell to its node [W/K]."""
    natural: _NumberedTerms
    """Terms that give a flux at the surface's temperature."""
    prescribed: _NumberedTerms
    """Terms that prescribe the surface's temperature: heat straight to the node."""
    radiating: _NumberedTerms = ()
    """Exchange with other surfaces where the temperature is prescribed."""
    iterations: int = eqx.field(static=True, default=MAX_ITERATIONS)
    """Newton iterations; with fewer than the maximum they start at the node's
    temperature."""
    varying: VaryingHalfCells | None = None
    """k(T) / k(reference) of the half cells; None where it is constant."""

    @property
    def is_linear(self) -> bool:
        """True if one iteration of Newton's method is the solution."""
        return all(term.law.is_linear for _, term in self.natural)

    def newton_iterations(self, bounds: Callable[[AbstractFluxLaw], FluxBounds]) -> int:
        """Number of iterations from the node's temperature that solve the balance.

        It is the maximum where a law has no bound.
        """
        if self.is_linear or is_traced((self.half_cell, self.natural)):
            return MAX_ITERATIONS
        conducts = np.asarray(self.half_cell)
        flux = np.zeros_like(conducts)
        curvature = np.zeros_like(conducts)
        for _, term in self.natural:
            of_law = bounds(term.law)
            if not np.isfinite(of_law).all():
                return MAX_ITERATIONS
            area = np.asarray(term.effective_area)
            flux += area * of_law.flux
            curvature += area * of_law.curvature
        # Terms that radiate from prescribed temperatures only have no flux here.
        if not flux.any():
            return 1
        # A half cell without conductance gives no bound; one without flux needs none.
        conducting = conducts > 0
        is_bounded = np.isfinite(flux).all() and not flux[~conducting].any()
        if not is_bounded:
            return MAX_ITERATIONS
        # The start is off by at most the flux over the conductance.
        resistance = conducting / np.where(conducting, conducts, 1)
        error = flux * resistance
        rate = curvature / 2 * resistance
        tolerance = _TOLERANCE[conducts.dtype.name]
        # Where the bound overflows it is of no use, and all iterations are taken.
        with np.errstate(over="ignore"):
            for iterations in range(1, MAX_ITERATIONS):
                error = rate * error * error
                if error.max() < tolerance:
                    return iterations
        return MAX_ITERATIONS

    def irradiated(self, received: PerCell, emits: bool = True) -> "SurfaceTerms":
        """The terms with the irradiation of each cell from other surfaces [W/m^2]."""

        # Without `emits` the cell's own emission is in what is received.
        def irradiate(term: BoundTerm) -> BoundTerm:
            return replace(term, law=term.law.irradiated(received, emits))

        return replace(
            self,
            natural=_mapped(irradiate, self.natural),
            radiating=_mapped(irradiate, self.radiating),
        )

    def in_air(self, kelvin: Mapping[int, Float[Array, ""]]) -> "SurfaceTerms":
        """The terms at the present temperatures of bodies of air, by number [K]."""
        natural = tuple(
            (n, replace(term, law=term.law.in_air(kelvin))) for n, term in self.natural
        )
        return replace(self, natural=natural)

    def surface_excess(self, time: Time, theta: PerCell) -> PerCell:
        """Temperature of each cell's surface above its node's [K]."""
        solved = self._solve(time, theta)
        return self.prescribed_excess(time, theta, solved.excess)

    def equilibrium(self, time: Time, theta: PerCell) -> PerCell:
        """Temperature at which each cell would receive no heat at all [K].

        Infinite towards heat that no loss balances; the node's where nothing acts. It
        depends on the state by other surfaces alone, so that loops over constant loads
        compute it once.
        """
        # The balance of a cell that conducts no heat, from the reference.
        zero = jnp.zeros_like(theta)
        apart = replace(self, half_cell=zero, iterations=MAX_ITERATIONS, varying=None)
        surface = apart._solve(time, zero).excess
        slope = sum((t.slope(time, surface) for _, t in self.natural), zero)
        heat = sum((t.heat_rate(time, surface) for _, t in self.natural), zero)
        endless = jnp.where(heat > 0, jnp.inf, -jnp.inf)
        unbalanced = jnp.where(heat == 0, theta, endless)
        surface = jnp.where(slope <= 0, unbalanced, surface)
        return self.prescribed_excess(time, zero, surface)

    def prescribed_excess(
        self, time: Time, theta: PerCell, elsewhere: PerCellOrOne | float = 0.0
    ) -> PerCellOrOne:
        """Excess of prescribed temperatures, and `elsewhere` on the other cells [K]."""
        # A fragment has one prescribed temperature at most.
        excess = jnp.asarray(elsewhere, theta.dtype)
        for _, term in self.prescribed:
            gap = term.law.flux(time, theta)
            excess = jnp.where(term.effective_area > 0, gap, excess)
        return excess

    def heat(self, time: Time, theta: PerCell) -> tuple[PerCell, Float[Array, " c"]]:
        """Heat rate through each cell, and the total of each mechanism [W].

        `theta` are temperatures of the cells' nodes above the reference [K].
        """
        by_name = jnp.zeros(len(self.names), theta.dtype)
        total_rate, rates = self.rates(time, theta)
        for number, rate in self.imposed(time):
            by_name = by_name.at[number].add(rate.sum())
        for number, rate in rates.items():
            by_name = by_name.at[number].add(precise_sum(rate))
        return total_rate, by_name

    def imposed(self, time: Time) -> list[tuple[int, Float[Array, "*b"]]]:
        """Heat rates of the terms with one flux for all cells, per body [W]."""
        # They follow without evaluating any cell.
        rates = []
        for n, term in self.natural:
            flux = term.law.uniform_flux(time)
            if flux is not None:
                with jax.named_scope(self.names[n]):
                    rates.append((n, jnp.asarray(term.total_effective_area) * flux))
        return rates

    def rates(self, time: Time, theta: PerCell) -> tuple[PerCell, dict[int, PerCell]]:
        """Heat rate through each cell [W], and by mechanism except `imposed` ones."""
        # The heat of all natural terms is what conduction carries to the node.
        solved = self._solve(time, theta)
        rates = solved.rates
        total_rate = solved.conducted
        for n, term in self.prescribed:
            rate = self._rate(n, term, time=time, theta=theta)
            if self.varying is not None:
                gap = term.law.flux(time, theta)
                rate = rate * self.varying.mean(theta, theta + gap)
            rates[n] = rates.get(n, 0) + rate
            total_rate = total_rate + rate
        for n, term in self.radiating:
            # The term that prescribes the temperature supplies the radiated heat.
            surface = theta + self.prescribed_excess(time, theta)
            rate = self._rate(n, term, time=time, theta=surface)
            rates[n] = rates.get(n, 0) + rate
            for fixed, supply in self.prescribed:
                on_cell = jnp.where(supply.effective_area > 0, rate, 0)
                rates[fixed] = rates[fixed] - on_cell
        return total_rate, rates

    def _rate(self, number: int, term: BoundTerm, time, theta):
        with jax.named_scope(self.names[number]):
            return term.heat_rate(time, theta)

    def _solve(self, time, theta) -> Solved:
        """Solve the balance of the natural terms with the half cell's conduction."""
        nonlinear = [(n, term) for n, term in self.natural if not term.law.is_linear]
        linear = [(n, term) for n, term in self.natural if term.law.is_linear]
        zero = jnp.zeros_like(theta)
        sums = LinearSum(
            rate=sum((term.heat_rate(time, zero) for _, term in linear), zero),
            slope=sum((term.slope(time, zero) for _, term in linear), zero),
        )
        if self.varying is not None:
            excess, rates, conducted = self._solve_varying(
                nonlinear, sums=sums, time=time, theta=theta
            )
        elif nonlinear:
            newton = partial(self._newton, nonlinear, sums, time, theta)
            start = zero
            if self.iterations == MAX_ITERATIONS:
                start = self._start(sums, time, theta)
            if self.iterations > 1:
                # A loop's short body is vectorized, where one long formula is not.
                start = jax.lax.fori_loop(
                    0, self.iterations - 1, lambda _, excess: newton(excess)[0], start
                )
            # The last step alone carries the derivative of the solution, exactly.
            excess, rates = newton(jax.lax.stop_gradient(start))
            conducted = jnp.asarray(self.half_cell) * excess
        else:
            excess = self._linear(sums, theta)
            rates = {}
            conducted = jnp.asarray(self.half_cell) * excess
        for n, term in linear:
            if term.law.uniform_flux(time) is None:
                rate = self._rate(n, term, time=time, theta=theta + excess)
                rates[n] = rates.get(n, 0) + rate
        return Solved(excess=excess, rates=rates, conducted=conducted)

    def _solve_varying(self, nonlinear, sums: LinearSum, time, theta) -> Solved:
        """Solve the balance where the conductivity of the half cells varies."""
        fixed, fixed_laws, fixed_sums, at, fixed_theta = stop_gradient(
            (self, nonlinear, sums, time, theta)
        )
        at_node = replace(fixed, half_cell=fixed._conductance(fixed_theta))

        def balance(excess: PerCell) -> Balance:
            linearized = fixed._linearized(
                fixed_laws, fixed_sums, time=at, theta=fixed_theta, excess=excess
            )
            return Balance(linearized.missing, linearized.slope)

        unbounded = jnp.full_like(theta, jnp.inf)
        root = increasing_root(
            balance,
            start=at_node._start(fixed_sums, at, fixed_theta),
            low=-unbounded,
            high=unbounded,
        )
        # A last step carries the derivative of the solution.
        linearized = self._linearized(
            nonlinear, sums, time=time, theta=theta, excess=root
        )
        change = -_ratio(linearized.missing, linearized.slope)
        return Solved(
            excess=root + change,
            rates={
                n: rate - linearized.slopes[n] * change
                for n, rate in linearized.rates.items()
            },
            conducted=linearized.conducted + linearized.conductance * change,
        )

    def _linearized(
        self, nonlinear, sums: LinearSum, time, theta, excess
    ) -> Linearized:
        """Linearize the balance at an excess where conductivities vary."""
        assert self.varying is not None
        surface = theta + excess
        rates, slopes = self._laws(nonlinear, time, surface)
        conducted = self.half_cell * self.varying.mean(theta, surface) * excess
        conductance = self._conductance(surface)
        return Linearized(
            missing=conducted - sum(rates.values(), sums.at(surface)),
            slope=sum(slopes.values(), sums.slope + conductance),
            rates=rates,
            slopes=slopes,
            conducted=conducted,
            conductance=conductance,
        )

    def _conductance(self, theta: PerCell) -> PerCell:
        """Conductance of each half cell at one temperature [W/K]."""
        assert self.varying is not None
        return jnp.asarray(self.half_cell) * self.varying.at(theta)

    def _linear(self, sums: LinearSum, theta):
        return _ratio(sums.at(theta), sums.slope + self.half_cell)

    def _newton(self, nonlinear, sums: LinearSum, time, theta, excess):
        """Next excess, and heat rates of the nonlinear laws, linearized at `excess`."""
        surface = theta + excess
        rates, slopes = self._laws(nonlinear, time, surface)
        net = sum(rates.values(), sums.at(surface) - self.half_cell * excess)
        change = _ratio(net, sum(slopes.values(), sums.slope + self.half_cell))
        return excess + change, {n: rates[n] - slopes[n] * change for n in rates}

    def _laws(self, nonlinear, time, surface) -> tuple[Rates, Rates]:
        """Heat rates [W] and slopes [W/K] of nonlinear laws, by mechanism."""
        rates: Rates = {}
        slopes: Rates = {}
        # Laws of one mechanism, such as sky and ground, are added: fewer arrays.
        for n, term in nonlinear:
            rate = self._rate(n, term, time=time, theta=surface)
            rates[n] = rates.get(n, 0) + rate
            slopes[n] = slopes.get(n, 0) + term.slope(time, surface)
        return rates, slopes

    def _start(self, sums: LinearSum, time, theta):
        """Start of Newton's method, with the tangents of laws without supersolution."""
        nonlinear = [term for _, term in self.natural if not term.law.is_linear]
        for term in nonlinear:
            if not term.law.is_dissipative:
                slope = term.slope(time, theta)
                rate = sums.rate + term.heat_rate(time, theta) + slope * theta
                sums = LinearSum(rate=rate, slope=sums.slope + slope)
        dissipative = [term for term in nonlinear if term.law.is_dissipative]
        if not dissipative:
            return self._linear(sums, theta)
        return self._supersolution(dissipative, sums, time=time, theta=theta)

    def _supersolution(self, dissipative, sums: LinearSum, time, theta):
        """Excess at or above the solution, from where Newton cannot overshoot."""
        # The lower of two bounds: emission alone loses all the heat that is imposed and
        # that a hotter node sends; or conduction alone carries it off.
        zero = jnp.zeros_like(theta)
        ambient = zero - jnp.inf
        for term in dissipative:
            ambient = jnp.maximum(ambient, term.law.supersolution(time, zero))
        imposed = jnp.maximum(sums.at(ambient), 0)
        sent = imposed + self.half_cell * jnp.maximum(theta - ambient, 0)
        hot = zero + jnp.inf
        for term in dissipative:
            area = jnp.asarray(term.effective_area)
            emitting = term.law.supersolution(time, sent * inverse(area))
            hot = jnp.where(area > 0, jnp.minimum(hot, emitting), hot)
        conducts = jnp.asarray(self.half_cell)
        imposed = jnp.maximum(sums.at(theta), 0)
        carried = jnp.maximum(theta, ambient) + imposed * inverse(conducts)
        hot = jnp.where(conducts > 0, jnp.minimum(hot, carried), hot)
        hot = jnp.maximum(hot, ambient)
        return jnp.where(jnp.isfinite(hot), hot - theta, 0)

    def stiffness(
        self, highest: Float[Array, ""], end: float, relative: Extremes
    ) -> PerCell:
        """Largest -d(heat rate)/dT of each cell below `highest` [K] up to `end` [s].

        It adds to its node's conductances in the stable explicit step [W/K]; `relative`
        are the extremes of k(T) / k(reference) [-].
        """
        conducts = relative.highest * self.half_cell
        slope = jnp.zeros_like(conducts)
        for _, term in self.natural:
            steepest = term.law.max_slope(highest, end).astype(conducts.dtype)
            slope = slope + jnp.asarray(term.effective_area) * steepest
        # The slope s and the half cell are in series: neither alone limits the step.
        # Heat G k_n s / (G k_s + s), with k at the node and at the surface.
        through = slope * conducts * inverse(slope + relative.lowest * self.half_cell)
        prescribed = (
            relative.highest * term.effective_area for _, term in self.prescribed
        )
        return sum(prescribed, through)

    def mapped(self, function: Callable[[BoundTerm], BoundTerm]) -> "SurfaceTerms":
        """The terms with a function applied to each."""
        return replace(
            self,
            natural=_mapped(function, self.natural),
            prescribed=_mapped(function, self.prescribed),
            radiating=_mapped(function, self.radiating),
        )

    def selected(
        self,
        cells: slice | np.ndarray,
        acting: set[int],
        reference: Any,
        bodies: np.ndarray | None = None,
    ) -> "SurfaceTerms":
        """The terms that act on some cells, by number, with their references [K].

        Their total areas are those of some bodies; None for one of all cells.
        """

        def select(term: BoundTerm) -> BoundTerm:
            area = term.effective_area[cells]
            law = term.law.coarsened(lambda values: values[..., cells]).above(reference)
            if bodies is None:
                return bound(area, law)
            return BoundTerm(area, term.total_effective_area[bodies], law)

        def selection(terms: _NumberedTerms) -> _NumberedTerms:
            return _mapped(select, tuple(pair for pair in terms if pair[0] in acting))

        return replace(
            self,
            half_cell=self.half_cell[cells],
            natural=selection(self.natural),
            prescribed=selection(self.prescribed),
            radiating=selection(self.radiating),
        )


def _mapped(
    function: Callable[[BoundTerm], BoundTerm], terms: _NumberedTerms
) -> _NumberedTerms:
    return tuple((n, function(term)) for n, term in terms)


def _ratio(above, below):
    """Above / below, and 0 where below is 0."""
    # XLA stores the result of a final division as an array, instead of repeating a
    # whole step for every sum that reads it.
    positive = below > 0
    return jnp.where(positive, above, 0) / jnp.where(positive, below, 1)
