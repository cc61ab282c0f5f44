"""The balance at the surface: what all mechanisms bring, the half cell carries on.

A surface is one distance away from its node, and its temperature T_s is where both
sides meet:

    sum_i q_i(T_s) = G (T_s - T_node),    G = k A / distance.

All mechanisms act at that one T_s, so a sun on an insulator heats its surface, which
then convects and emits accordingly; a node alone would do so too late and too little,
with an error of first order in the pitch. Newton's method solves it: in one step where
every law is linear, from the hot side of emission, where it cannot overshoot, else.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..network.network import inverse, precise_sum
from .boundary import ImposedFlux
from .term import BoundTerm, bound


NEWTON_STEPS = 6
"""From ten times the node's temperature in a near-insulator they leave 1e-6 of q."""

NumberedTerms = tuple[tuple[int, BoundTerm], ...]
"""Bound terms with the number of their mechanism in the program."""


class SurfaceTerms(eqx.Module):
    """What acts on the places of a surface: fragments, or several of them as one."""

    mechanisms: tuple[str, ...] = eqx.field(static=True)
    """Names, by the terms' numbers."""
    half_cell: Float[Array, " m"]
    """G of each place's free part [W/K]."""
    free: NumberedTerms
    """At the surface's temperature."""
    held: NumberedTerms
    """Surface held at a temperature: straight to the node."""

    @property
    def is_linear(self) -> bool:
        """Whether one step of Newton's method is the solution."""
        return all(term.law.is_linear for _, term in self.free)

    def surface_excess(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Temperature of each place's surface above its node's [K]."""
        excess = self._solve(time, theta)[1]
        for _, term in self.held:
            gap = term.law.flux(time, theta)
            excess = jnp.where(term.share > 0, gap, excess)
        return excess

    def heat(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], Float[Array, " c"]]:
        """Heat rate through each place, and in all by each mechanism [W].

        Args:
            time: [s].
            theta: temperature of each place's node above the reference [K].
        """
        rates, _ = self._solve(time, theta)
        total = jnp.zeros_like(theta)
        by_mechanism = jnp.zeros(len(self.mechanisms), theta.dtype)
        held = [self._rate(n, term, time, theta) for n, term in self.held]
        numbered = (*self.free, *self.held)
        for (number, term), rate in zip(numbered, (*rates, *held), strict=True):
            total = total + rate
            by_mechanism = by_mechanism.at[number].add(_in_all(term, time, rate))
        return total, by_mechanism

    def _rate(self, number, term, time, theta):
        with jax.named_scope(self.mechanisms[number]):
            return term.heat_rate(time, theta)

    def _solve(self, time, theta):
        """Heat rate of each free term, and the excess, which agree to rounding."""
        emitting = [(n, term) for n, term in self.free if not term.law.is_linear]
        others = [term for _, term in self.free if term.law.is_linear]
        zero = jnp.zeros_like(theta)
        brought = sum((term.heat_rate(time, zero) for term in others), zero)
        slope = sum((term.slope(time, zero) for term in others), zero)
        excess = (brought - slope * theta) * inverse(slope + self.half_cell)
        corrections = []
        if emitting:
            newton = partial(self._newton, emitting, brought, slope, time, theta)
            start = self._hot_side(time, theta, brought, slope)
            # A loop, whose short body is vectorized, where one long formula is not.
            excess = jax.lax.fori_loop(
                0, NEWTON_STEPS - 1, lambda _, excess: newton(excess)[0], start
            )
            # The last step alone carries the derivative of the solution, exactly.
            excess, corrections = newton(jax.lax.stop_gradient(excess))
        corrected, there = iter(corrections), theta + excess
        rates = [
            self._rate(n, t, time, there) if t.law.is_linear else next(corrected)
            for n, t in self.free
        ]
        return rates, excess

    def _newton(self, emitting, brought, slope, time, theta, excess):
        """The next excess, and what each emission brings as linear about this one."""
        here = theta + excess
        emitted = [self._rate(n, term, time, here) for n, term in emitting]
        slopes = [term.slope(time, here) for _, term in emitting]
        net = sum(emitted, brought - slope * here - self.half_cell * excess)
        change = net * inverse(sum(slopes, slope + self.half_cell))
        rates = [q - s * change for q, s in zip(emitted, slopes, strict=True)]
        return excess + change, rates

    def _hot_side(self, time, theta, brought, slope):
        """An excess at or above the solution, from where Newton cannot overshoot.

        The lower of two bounds: what emission sheds alone, of all that is pushed in and
        that a hotter node sends; and what conduction carries off alone.
        """
        emitting = [term for _, term in self.free if not term.law.is_linear]
        zero = jnp.zeros_like(theta)
        pushed = lambda here: jnp.maximum(brought - slope * here, 0)
        ambient = zero - jnp.inf
        for term in emitting:
            ambient = jnp.maximum(ambient, term.law.hot_side(time, zero))
        sent = pushed(ambient) + self.half_cell * jnp.maximum(theta - ambient, 0)
        hot = zero + jnp.inf
        for term in emitting:
            shed = term.law.hot_side(time, sent * inverse(term.share))
            hot = jnp.where(term.share > 0, jnp.minimum(hot, shed), hot)
        carried = jnp.maximum(theta, ambient) + pushed(theta) * inverse(self.half_cell)
        hot = jnp.where(self.half_cell > 0, jnp.minimum(hot, carried), hot)
        hot = jnp.maximum(hot, ambient)
        return jnp.where(jnp.isfinite(hot), hot - theta, 0)

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, " m"]:
        """Largest -d(heat rate)/dT of each place below `hottest` [K] to `end` [s].

        It adds to its node's conductances in the stable explicit step [W/K].
        """
        dtype = self.half_cell.dtype
        steepest = lambda t: t.share * t.law.steepest(hottest, end).astype(dtype)
        slope = sum((steepest(t) for _, t in self.free), jnp.zeros_like(self.half_cell))
        through = slope * self.half_cell * inverse(slope + self.half_cell)
        return sum((term.share for _, term in self.held), through)

    def merged(self, place: Int[np.ndarray, " m"], places: int) -> "SurfaceTerms":
        """Several places as one, wherever they have the same number.

        Args:
            place: number of each place's new one; -1 to drop it.
            places: how many there will be.
        """
        kept = np.flatnonzero(place >= 0)
        number = jnp.asarray(place[kept])
        add = lambda values: jax.ops.segment_sum(values[kept], number, places)
        merge = lambda terms: tuple((n, bound(add(t.share), t.law)) for n, t in terms)
        return SurfaceTerms(
            self.mechanisms, add(self.half_cell), merge(self.free), merge(self.held)
        )


def _in_all(term: BoundTerm, time, rate) -> Float[Array, ""]:
    if isinstance(term.law, ImposedFlux):
        return term.total_share * term.law.flux(time, rate)
    return precise_sum(rate)
