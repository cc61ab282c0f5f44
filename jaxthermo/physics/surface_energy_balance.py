"""Energy balance at the surface: all mechanisms against conduction to the node.

The surface is half a cell away from its node. Its temperature T_s is where the heat of
all mechanisms equals the heat that conduction carries to the node:

    sum_i q_i(T_s) = G (T_s - T_node),    G = k A / distance.

All mechanisms act at that one T_s, so a sun on an insulator heats its surface, which
then convects and emits accordingly; a node alone would do so too late and too little,
with an error of first order in the pitch. Newton's method solves the balance: in one
iteration where every law is linear, and from a supersolution of emission, where it
cannot overshoot, else. Laws that are neither, such as convection with properties that
vary, are so nearly linear that the start may be their tangent at the node.

The number of iterations is known beforehand. From a start e_0 kelvin off each leaves at
most

    e_{n+1} = c e_n^2,    c = max |q''| / (2 G),

of a flux q with that curvature. A metal's half cell conducts a thousand times better
than its surface radiates: there one iteration from the node's temperature is exact to
rounding, where a near-insulator in the sun needs all.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ..arrays import Time, is_traced
from ..findings import found, is_finding
from ..module import Module, replaced
from ..network.network import inverse, precise_sum
from .flux_law import (
    BoundTerm,
    Forcing,
    PerCell,
    PerCellOrOne,
    Values,
    bound,
    total,
)


MAX_ITERATIONS = 6
"""From ten times the node's temperature in a near-insulator they leave 1e-6 of q."""

TOLERANCE = {"float32": 1e-5, "float64": 1e-12}
"""About one rounding of a difference of 100 K, by the type of the state [K]."""

NumberedTerms = tuple[tuple[int, BoundTerm], ...]
"""Bound terms with the index of their name."""


class SurfaceTerms(Module):
    """Mechanisms that act on surface cells: fragments, or several of them combined."""

    names: tuple[str, ...] = eqx.field(static=True)
    """Mechanisms, by number."""
    half_cell: Float[Values, " m"]
    """Conductance G from the natural part of each cell to its node [W/K]."""
    natural: NumberedTerms
    """Terms that give a flux at the surface's temperature."""
    prescribed: NumberedTerms
    """Terms that prescribe the surface's temperature: heat straight to the node."""
    radiating: NumberedTerms = ()
    """Exchange with other surfaces where the temperature is prescribed."""
    iterations: int = eqx.field(static=True, default=MAX_ITERATIONS)
    """Newton iterations; with fewer than all they start at the node's temperature."""

    @property
    def is_linear(self) -> bool:
        """True if one iteration of Newton's method is the solution."""
        return all(term.law.is_linear for _, term in self.natural)

    def newton_iterations(self, within: Forcing | None, end: float) -> int:
        """Iterations from the node's temperature that solve the balance.

        All of them where no bound is known, as for unknown temperatures up to `end`.
        """
        traced = is_traced((self.half_cell, self.natural))
        if within is None or self.is_linear or traced:
            return MAX_ITERATIONS
        conducts = np.asarray(self.half_cell, float)
        flux, curvature = np.zeros_like(conducts), np.zeros_like(conducts)
        for _, term in self.natural:
            bounds = term.law.max_flux(within, end), term.law.curvature(within, end)
            if not np.isfinite(np.asarray(bounds, float)).all():
                return MAX_ITERATIONS
            area = np.asarray(term.effective_area, float)
            flux += area * float(bounds[0])
            curvature += area * float(bounds[1])
        # Terms that radiate from prescribed temperatures only have no flux here.
        if not flux.any():
            return 1
        # A half cell without conductance gives no bound; one without flux needs none.
        acts = (flux > 0) & (conducts > 0)
        unbounded = not np.isfinite(flux).all() or (flux[conducts <= 0] > 0).any()
        if not acts.any() or unbounded:
            return MAX_ITERATIONS
        # The start is off by at most the flux over the conductance.
        error = flux[acts] / conducts[acts]
        rate = curvature[acts] / 2 / conducts[acts]
        tolerance = TOLERANCE[np.asarray(self.half_cell).dtype.name]
        # Where the bound overflows it is of no use, and all iterations are taken.
        with np.errstate(over="ignore"):
            for iterations in range(1, MAX_ITERATIONS):
                error = rate * error * error
                if error.max() < tolerance:
                    return iterations
        return MAX_ITERATIONS

    def conducting(self, relative: PerCellOrOne) -> "SurfaceTerms":
        """The terms above nodes with k(T) / k(reference) = `relative`."""
        if not relative.ndim:
            return self
        prescribed = tuple(
            (n, replaced(term, effective_area=term.effective_area * relative))
            for n, term in self.prescribed
        )
        half_cell = self.half_cell * relative
        return replaced(self, half_cell=half_cell, prescribed=prescribed)

    def irradiated(self, received: PerCell, emits: bool = True) -> "SurfaceTerms":
        """The terms with the irradiation of each cell from other surfaces [W/m^2]."""
        # Without `emits` the cell's own emission is in what is received.
        each = lambda terms: tuple(
            (n, replaced(term, law=term.law.irradiated(received, emits)))
            for n, term in terms
        )
        return replaced(
            self, natural=each(self.natural), radiating=each(self.radiating)
        )

    def surface_excess(self, time: Time, theta: PerCell) -> PerCell:
        """Temperature of each cell's surface above its node's [K]."""
        return self.prescribed_excess(time, theta, self._solve(time, theta)[1])

    def prescribed_excess(
        self, time: Time, theta: PerCell, elsewhere: PerCellOrOne | float = 0.0
    ) -> PerCellOrOne:
        """The same where a temperature is prescribed, and `elsewhere` else [K]."""
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
        whole, rates = self.rates(time, theta)
        for number, rate in self.imposed(time):
            by_name = by_name.at[number].add(rate.sum())
        for number, rate in rates.items():
            by_name = by_name.at[number].add(precise_sum(rate))
        return whole, by_name

    def imposed(self, time: Time) -> list[tuple[int, Float[Array, "*b"]]]:
        """Heat rates of the terms with one flux for all cells, per body [W]."""
        # They are known without evaluating any cell.
        found = []
        for n, term in self.natural:
            flux = term.law.uniform_flux(time)
            if flux is not None:
                with jax.named_scope(self.names[n]):
                    found.append((n, jnp.asarray(term.total_effective_area) * flux))
        return found

    def rates(self, time: Time, theta: PerCell) -> tuple[PerCell, dict[int, PerCell]]:
        """Heat rate through each cell, and its parts without those of `imposed` [W]."""
        # What all natural terms bring is what conduction carries to the node.
        rates, excess = self._solve(time, theta)
        whole = jnp.asarray(self.half_cell) * excess
        for n, term in self.prescribed:
            rate = self._rate(n, term, time, theta)
            rates[n] = rates.get(n, 0) + rate
            whole = whole + rate
        for n, term in self.radiating:
            # What keeps the temperature supplies what the surface radiates to others.
            here = theta + self.prescribed_excess(time, theta)
            rate = self._rate(n, term, time, here)
            rates[n] = rates.get(n, 0) + rate
            for fixed, own in self.prescribed:
                rates[fixed] = rates[fixed] - jnp.where(own.effective_area > 0, rate, 0)
        return whole, rates

    def _rate(self, number: int, term: BoundTerm, time, theta):
        with jax.named_scope(self.names[number]):
            return term.heat_rate(time, theta)

    def _solve(self, time, theta):
        """Heat rate of each natural term, and the excess, which agree to rounding."""
        nonlinear = [(n, term) for n, term in self.natural if not term.law.is_linear]
        linear = [(n, term) for n, term in self.natural if term.law.is_linear]
        # Linear terms together: brought - slope T_s, exact at any temperature.
        zero = jnp.zeros_like(theta)
        brought = sum((term.heat_rate(time, zero) for _, term in linear), zero)
        slope = sum((term.slope(time, zero) for _, term in linear), zero)
        if nonlinear:
            newton = partial(self._newton, nonlinear, brought, slope, time, theta)
            start = zero
            if self.iterations == MAX_ITERATIONS:
                start = self._start(time, theta, brought, slope)
            if self.iterations > 1:
                # A loop's short body is vectorized, where one long formula is not.
                start = jax.lax.fori_loop(
                    0, self.iterations - 1, lambda _, excess: newton(excess)[0], start
                )
            # The last step alone carries the derivative of the solution, exactly.
            excess, rates = newton(jax.lax.stop_gradient(start))
        else:
            excess, rates = self._linear(theta, brought, slope), {}
        for n, term in linear:
            if term.law.uniform_flux(time) is None:
                rates[n] = rates.get(n, 0) + self._rate(n, term, time, theta + excess)
        return rates, excess

    def _linear(self, theta, brought, slope):
        return _ratio(brought - slope * theta, slope + self.half_cell)

    def _newton(self, nonlinear, brought, slope, time, theta, excess):
        """The next excess, and the heat rates of the nonlinear laws linearized here."""
        here, bring, slopes = theta + excess, {}, {}
        # Laws of one entry, such as sky and ground, are added: fewer arrays to write.
        for n, term in nonlinear:
            bring[n] = bring.get(n, 0) + self._rate(n, term, time, here)
            slopes[n] = slopes.get(n, 0) + term.slope(time, here)
        net = sum(bring.values(), brought - slope * here - self.half_cell * excess)
        change = _ratio(net, sum(slopes.values(), slope + self.half_cell))
        return excess + change, {n: bring[n] - slopes[n] * change for n in bring}

    def _start(self, time, theta, brought, slope):
        """Start of Newton's method; laws that are not dissipative by their tangents."""
        nonlinear = [term for _, term in self.natural if not term.law.is_linear]
        for term in nonlinear:
            if not term.law.is_dissipative:
                steep = term.slope(time, theta)
                brought = brought + term.heat_rate(time, theta) + steep * theta
                slope = slope + steep
        dissipative = [term for term in nonlinear if term.law.is_dissipative]
        if not dissipative:
            return self._linear(theta, brought, slope)
        return self._supersolution(dissipative, time, theta, brought, slope)

    def _supersolution(self, dissipative, time, theta, brought, slope):
        """An excess at or above the solution, from where Newton cannot overshoot."""
        # The lower of two bounds: emission alone loses all the heat that is imposed and
        # that a hotter node sends; or conduction alone carries it off.
        zero = jnp.zeros_like(theta)
        imposed = lambda here: jnp.maximum(brought - slope * here, 0)
        ambient = zero - jnp.inf
        for term in dissipative:
            ambient = jnp.maximum(ambient, term.law.supersolution(time, zero))
        sent = imposed(ambient) + self.half_cell * jnp.maximum(theta - ambient, 0)
        hot = zero + jnp.inf
        for term in dissipative:
            area = jnp.asarray(term.effective_area)
            emitting = term.law.supersolution(time, sent * inverse(area))
            hot = jnp.where(area > 0, jnp.minimum(hot, emitting), hot)
        conducts = jnp.asarray(self.half_cell)
        carried = jnp.maximum(theta, ambient) + imposed(theta) * inverse(conducts)
        hot = jnp.where(conducts > 0, jnp.minimum(hot, carried), hot)
        hot = jnp.maximum(hot, ambient)
        return jnp.where(jnp.isfinite(hot), hot - theta, 0)

    def stiffness(
        self, highest: Float[Array, ""], end: float, relative: Float[Array, ""]
    ) -> PerCell:
        """Largest -d(heat rate)/dT of each cell below `highest` [K] up to `end` [s].

        It adds to its node's conductances in the stable explicit step [W/K]; `relative`
        is the largest k(T) / k(reference) [-].
        """
        conducts = relative * self.half_cell
        slope = jnp.zeros_like(conducts)
        for _, term in self.natural:
            steepest = term.law.max_slope(highest, end).astype(conducts.dtype)
            slope = slope + jnp.asarray(term.effective_area) * steepest
        # The slope and the half cell are in series: neither alone limits the step.
        through = slope * conducts * inverse(slope + conducts)
        prescribed = (relative * term.effective_area for _, term in self.prescribed)
        return sum(prescribed, through)

    def coarsened(
        self, cell: Int[np.ndarray, " m"], counts: tuple[int, ...], reference: Any
    ) -> "SurfaceTerms":
        """The terms on cells that each combine several fragments.

        `cell` is the number of each fragment's cell, or -1 to drop it, `counts` are the
        numbers of cells of the bodies, and `reference` is that of the cells [K].
        """
        # Areas and conductances add up; laws are averaged by effective area, so that
        # the heat at one temperature stays the same.
        cells = sum(counts)
        by_cell = found((cell,), ("by cell", cells), lambda: _by_cell(cell, cells))

        def add(values):
            if is_traced(values):
                kept = np.flatnonzero(cell >= 0)
                picked = values if len(kept) == len(cell) else values[..., kept]
                return jax.ops.segment_sum(picked.T, cell[kept], cells).T
            host = np.asarray(values)
            sums = lambda: (by_cell @ host.T).T.astype(host.dtype)
            # Of arrays that were found before, the sums are found once, too.
            by = ("sums of cells", cells) if is_finding(host, cell) else None
            return found((host, cell), by, sums)

        def merge(term: BoundTerm) -> BoundTerm:
            area = add(term.effective_area)
            # Arrays with a value per fragment have the fragments on the last axis.
            along = lambda values, weight: values * weight[(None,) * (values.ndim - 1)]
            own: Any = jnp if is_traced(area) else np
            # Few laws have any: their divisor is found where it is needed.
            mean = lambda values: along(
                add(along(values, term.effective_area)), inverse(jnp.asarray(area))
            )
            parts = own.split(area, np.cumsum(counts)[:-1]) if counts[1:] else [area]
            totals = own.stack([total(part) for part in parts])
            law = term.law.coarsened(mean).above(reference)
            return replaced(
                term, effective_area=area, total_effective_area=totals, law=law
            )

        each = lambda terms: tuple((n, merge(term)) for n, term in terms)
        return replaced(
            self,
            half_cell=add(self.half_cell),
            natural=each(self.natural),
            prescribed=each(self.prescribed),
            radiating=each(self.radiating),
        )

    def selected(
        self, cells: slice, acting: set[int], reference: Any
    ) -> "SurfaceTerms":
        """The terms that act on one body, by number, with its own reference [K]."""

        def select(term: BoundTerm) -> BoundTerm:
            law = term.law.coarsened(lambda values: values[..., cells])
            return bound(term.effective_area[cells], law.above(reference))

        each = lambda terms: tuple((n, select(t)) for n, t in terms if n in acting)
        return replaced(
            self,
            half_cell=self.half_cell[cells],
            natural=each(self.natural),
            prescribed=each(self.prescribed),
            radiating=each(self.radiating),
        )


def _ratio(above, below):
    """Above / below, and 0 where below is 0."""
    # A division at the end is what XLA makes an array of, instead of computing a whole
    # step again for every sum that reads it.
    positive = below > 0
    return jnp.where(positive, above, 0) / jnp.where(positive, below, 1)


def _by_cell(cell: Int[np.ndarray, " m"], cells: int) -> csr_array:
    """Matrix that sums values of fragments by cell, without those of cell -1."""
    # In double precision, whatever the values are.
    kept = np.flatnonzero(cell >= 0)
    place = cell[kept], kept
    return csr_array((np.ones(len(kept)), place), shape=(cells, len(cell)))
