"""The balance at the surface: what all mechanisms bring, the half cell carries on.

A surface is one distance away from its node, and its temperature T_s is where both
sides meet:

    sum_i q_i(T_s) = G (T_s - T_node),    G = k A / distance.

All mechanisms act at that one T_s, so a sun on an insulator heats its surface, which
then convects and emits accordingly; a node alone would do so too late and too little,
with an error of first order in the pitch. Newton's method solves it: in one step where
every law is linear, from the hot side of emission, where it cannot overshoot, else.
Laws that are neither, such as convection with properties that vary, bend so little that
the start may be their tangent at the node.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import is_traced
from ..network.network import inverse, precise_sum
from .boundary import ImposedFlux
from .newton_iteration_bound import ALL_STEPS
from .radiation.radiative_exchange import Radiation
from .term import BoundTerm, Values, bound


NumberedTerms = tuple[tuple[int, BoundTerm], ...]
"""Bound terms with the number of their entry in the ledger."""


class SurfaceTerms(eqx.Module):
    """What acts on the places of a surface: fragments, or several of them as one."""

    names: tuple[str, ...] = eqx.field(static=True)
    """Of the mechanisms, by the number of their entry in the ledger."""
    half_cell: Float[Values, " m"]
    """G of each place's free part [W/K]."""
    natural: NumberedTerms
    """At the surface's temperature."""
    prescribed: NumberedTerms
    """Surface held at a temperature: straight to the node."""
    steps: int = eqx.field(static=True, default=ALL_STEPS)
    """Of Newton's method; fewer than all start at the node's temperature."""

    @property
    def is_linear(self) -> bool:
        """Whether one step of Newton's method is the solution."""
        return all(term.law.is_linear for _, term in self.natural)

    def conducting(self, relative: Float[Array, "*#m"]) -> "SurfaceTerms":
        """The same above nodes whose conductivity is so many times the stated one."""
        if not relative.ndim:
            return self
        held = tuple(
            (
                n,
                BoundTerm(
                    term.effective_area * relative, term.total_effective_area, term.law
                ),
            )
            for n, term in self.prescribed
        )
        return replace(self, half_cell=self.half_cell * relative, prescribed=held)

    def above(self, base: Float[Array, ""]) -> "SurfaceTerms":
        """The same with radiation counted from `base` [K]."""
        counted = lambda law: Radiation(law.received, base, law.reference, law.emits)
        return self._with_radiation(counted)

    def _with_radiation(self, change: Callable[[Radiation], Radiation]):
        free = tuple(
            (
                n,
                BoundTerm(
                    term.effective_area, term.total_effective_area, change(term.law)
                ),
            )
            if isinstance(term.law, Radiation)
            else (n, term)
            for n, term in self.natural
        )
        return replace(self, natural=free)

    def radiating(
        self, received: Float[Array, " m"], emits: bool = True
    ) -> "SurfaceTerms":
        """The same in the radiation of what is around.

        Args:
            received: by each place, as `Radiation` takes it [W/m^2].
            emits: whether its own emission follows its temperature.
        """
        bathed = lambda law: Radiation(received, law.base, law.reference, emits)
        return self._with_radiation(bathed)

    def surface_excess(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Temperature of each place's surface above its node's [K]."""
        excess = self._solve(time, theta)[1]
        for _, term in self.prescribed:
            gap = term.law.flux(time, theta)
            excess = jnp.where(term.effective_area > 0, gap, excess)
        return excess

    def heat(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], Float[Array, " c"]]:
        """Heat rate through each place, and in all by each entry of the ledger [W].

        Args:
            time: [s].
            theta: temperature of each place's node above the reference [K].
        """
        by_entry = jnp.zeros(len(self.names), theta.dtype)
        total, rates = self.rates(time, theta)
        for number, whole in self.imposed(time, theta):
            by_entry = by_entry.at[number].add(whole)
        for number, rate in rates.items():
            by_entry = by_entry.at[number].add(precise_sum(rate))
        return total, by_entry

    def imposed(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> list[tuple[int, Float[Array, "*b"]]]:
        """What terms of one flux for all places bring in all, by their entries [W].

        Arguments as of `heat`. Known without a look at the places.
        """
        found = []
        for n, term in self.natural:
            if _is_uniform(term, time, theta):
                with jax.named_scope(self.names[n]):
                    whole = jnp.asarray(term.total_effective_area) * term.law.flux(
                        time, theta
                    )
                found.append((n, whole))
        return found

    def rates(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], dict[int, Float[Array, " m"]]]:
        """Heat rate through each place, in all and by entry, but of the `imposed` [W].

        Arguments as of `heat`. What all free terms bring is what conduction carries on.
        """
        rates, excess = self._solve(time, theta)
        total = jnp.asarray(self.half_cell) * excess
        for n, term in self.prescribed:
            rate = self._rate(n, term, time, theta)
            rates[n] = rates.get(n, 0) + rate
            total = total + rate
        return total, rates

    def _rate(self, number, term, time, theta):
        with jax.named_scope(self.names[number]):
            return term.heat_rate(time, theta)

    def _solve(self, time, theta):
        """Heat rate of each free entry, and the excess, which agree to rounding."""
        bent = [(n, term) for n, term in self.natural if not term.law.is_linear]
        linear = [(n, term) for n, term in self.natural if term.law.is_linear]
        zero = jnp.zeros_like(theta)
        brought = sum((term.heat_rate(time, zero) for _, term in linear), zero)
        slope = sum((term.slope(time, zero) for _, term in linear), zero)
        if bent:
            newton = partial(self._newton, bent, brought, slope, time, theta)
            start = zero
            if self.steps == ALL_STEPS:
                start = self._start(time, theta, brought, slope)
            if self.steps > 1:
                # A loop's short body is vectorized, where one long formula is not.
                start = jax.lax.fori_loop(
                    0, self.steps - 1, lambda _, excess: newton(excess)[0], start
                )
            # The last step alone carries the derivative of the solution, exactly.
            excess, rates = newton(jax.lax.stop_gradient(start))
        else:
            excess, rates = self._linear(theta, brought, slope), {}
        for n, term in linear:
            if not _is_uniform(term, time, theta):
                rates[n] = rates.get(n, 0) + self._rate(n, term, time, theta + excess)
        return rates, excess

    def _linear(self, theta, brought, slope):
        return _ratio(brought - slope * theta, slope + self.half_cell)

    def _newton(self, bent, brought, slope, time, theta, excess):
        """The next excess, and what the bent laws of each entry bring, as linear here.

        Those of one entry, such as sky and ground, are one: fewer arrays are written.
        """
        here, bring, slopes = theta + excess, {}, {}
        for n, term in bent:
            bring[n] = bring.get(n, 0) + self._rate(n, term, time, here)
            slopes[n] = slopes.get(n, 0) + term.slope(time, here)
        net = sum(bring.values(), brought - slope * here - self.half_cell * excess)
        change = _ratio(net, sum(slopes.values(), slope + self.half_cell))
        return excess + change, {n: bring[n] - slopes[n] * change for n in bring}

    def _start(self, time, theta, brought, slope):
        """Where Newton's method starts; laws that do not shed by their tangents."""
        bent = [term for _, term in self.natural if not term.law.is_linear]
        for term in bent:
            if not term.law.is_dissipative:
                steep = term.slope(time, theta)
                brought = brought + term.heat_rate(time, theta) + steep * theta
                slope = slope + steep
        shedding = [term for term in bent if term.law.is_dissipative]
        if not shedding:
            return self._linear(theta, brought, slope)
        return self._hot_side(shedding, time, theta, brought, slope)

    def _hot_side(self, shedding, time, theta, brought, slope):
        """An excess at or above the solution, from where Newton cannot overshoot.

        The lower of two bounds: what emission sheds alone, of all that is pushed in and
        that a hotter node sends; and what conduction carries off alone.
        """
        zero = jnp.zeros_like(theta)
        pushed = lambda here: jnp.maximum(brought - slope * here, 0)
        ambient = zero - jnp.inf
        for term in shedding:
            ambient = jnp.maximum(ambient, term.law.supersolution(time, zero))
        sent = pushed(ambient) + self.half_cell * jnp.maximum(theta - ambient, 0)
        hot = zero + jnp.inf
        for term in shedding:
            share = jnp.asarray(term.effective_area)
            shed = term.law.supersolution(time, sent * inverse(share))
            hot = jnp.where(share > 0, jnp.minimum(hot, shed), hot)
        conducts = jnp.asarray(self.half_cell)
        carried = jnp.maximum(theta, ambient) + pushed(theta) * inverse(conducts)
        hot = jnp.where(conducts > 0, jnp.minimum(hot, carried), hot)
        hot = jnp.maximum(hot, ambient)
        return jnp.where(jnp.isfinite(hot), hot - theta, 0)

    def stiffness(
        self, hottest: Float[Array, ""], end: float, relative: Float[Array, ""]
    ) -> Float[Array, " m"]:
        """Largest -d(heat rate)/dT of each place below `hottest` [K] to `end` [s].

        It adds to its node's conductances in the stable explicit step [W/K].

        Args:
            hottest: that surfaces can get [K].
            end: of the run [s].
            relative: the largest conductivity over the stated one.
        """
        conducts = relative * self.half_cell
        slope = jnp.zeros_like(conducts)
        for _, term in self.natural:
            steepest = term.law.max_slope(hottest, end).astype(conducts.dtype)
            slope = slope + jnp.asarray(term.effective_area) * steepest
        through = slope * conducts * inverse(slope + conducts)
        return sum(
            (relative * term.effective_area for _, term in self.prescribed), through
        )

    def coarsened(self, place: Int[np.ndarray, " m"], places: int) -> "SurfaceTerms":
        """Several places as one, wherever they have the same number.

        Args:
            place: number of each place's new one; -1 to drop it.
            places: how many there will be.
        """
        kept = np.flatnonzero(place >= 0)
        number = place[kept]

        def add(values):
            if is_traced(values):
                return jax.ops.segment_sum(values[..., kept].T, number, places).T
            sums = _host_sums(np.asarray(values)[..., kept], number, places)
            return sums.astype(values.dtype)

        def merge(term: BoundTerm) -> BoundTerm:
            share = add(term.effective_area)
            each = inverse(jnp.asarray(share))
            # Of arrays with a value a place on the last axis.
            along = lambda values, weight: values * weight[(None,) * (values.ndim - 1)]
            mean = lambda values: along(add(along(values, term.effective_area)), each)
            return bound(share, term.law.coarsened(mean))

        each = lambda terms: tuple((n, merge(term)) for n, term in terms)
        half_cell = add(self.half_cell)
        free, held = each(self.natural), each(self.prescribed)
        return SurfaceTerms(self.names, half_cell, free, held, self.steps)


def _ratio(above, below):
    """Above / below, and 0 where below is 0.

    A division at the end is what XLA makes an array of, instead of computing a whole
    step anew for every sum that reads it.
    """
    positive = below > 0
    return jnp.where(positive, above, 0) / jnp.where(positive, below, 1)


def _host_sums(values, number, places):
    """Sums in double precision, along the last axis."""
    rows = values.reshape(-1, values.shape[-1])
    sums = np.stack([np.bincount(number, row, places) for row in rows])
    return sums.reshape(*values.shape[:-1], places)


def _is_uniform(term: BoundTerm, time, theta) -> bool:
    """Whether one flux goes into all places; on several bodies it may differ."""
    return isinstance(term.law, ImposedFlux) and not term.law.flux(time, theta).ndim
