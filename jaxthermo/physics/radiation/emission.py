"""Emission to the surroundings, net of what comes back (thesis eq. 1, completed).

q = F eps sigma A (T_s^4 - T^4) to surroundings at T_s that fill a share F of the view,
all of it where nothing stands in the way. The thesis drops the second half and then the
whole term; at 300 K it is worth a heat transfer coefficient of 6 W/(m^2 K), as much as
still air. Source: Stefan-Boltzmann law, Kirchhoff's law for a grey surface.
"""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Scalar, is_traced
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ..boundary import Exchange
from ..term import (
    AbstractFluxLaw,
    AbstractSurfaceTerm,
    Binding,
    Forcing,
    Omitted,
    Surface,
    TemperatureRange,
    binding,
)
from ..time_varying import check_value, for_jit, is_zero, largest, smallest, value_at
from .visibility import SkyView, check_directions, open_view, sky_view


class Emission(AbstractFluxLaw):
    """Net emission of a black surface; the share holds the emissivity."""

    temperature: Any
    """Of the surroundings [K]."""
    reference: Float[Array, "*#m"]

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Sigma (T_s - T)(T_s + T)(T_s^2 + T^2), exact for close temperatures."""
        ambient = value_at(self.temperature, time)
        hot = self.reference + theta
        difference = (ambient - self.reference) - theta
        sums = (ambient + hot) * (ambient * ambient + hot * hot)
        return STEFAN_BOLTZMANN * difference * sums

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """4 sigma T^3, of a grey surface."""
        del time
        hot = jnp.maximum(self.reference + theta, 0)
        return 4 * STEFAN_BOLTZMANN * hot * hot * hot

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """4 sigma T^3 at the hottest."""
        del end
        return 4 * STEFAN_BOLTZMANN * hottest**3

    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """Sigma T^4 of the hotter side."""
        most = jnp.maximum(largest(self.temperature, reach.end), reach.highest)
        return STEFAN_BOLTZMANN * most**4

    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """12 sigma T^2 at the hottest."""
        return 12 * STEFAN_BOLTZMANN * reach.highest**2

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    @property
    def is_dissipative(self) -> bool:
        """Yes."""
        return True

    def supersolution(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Where emission alone sheds what is pushed in, or the surroundings'."""
        ambient = value_at(self.temperature, time)
        return shedding_temperature(ambient, jnp.maximum(pushed, 0)) - self.reference


def shedding_temperature(
    around: Float[Array, "*#m"], pushed: Float[Array, "*#m"]
) -> Float[Array, "*#m"]:
    """T at which sigma T^4 = sigma T_a^4 + q'' [K]; close to 0 where that is negative.

    Args:
        around: T_a [K].
        pushed: heat flux [W/m^2].
    """
    # Scaled by T_a or 1 K, so that a fourth power stays in float32.
    scale = jnp.maximum(around, 1)
    square = (around / scale) * (around / scale)
    level = square * square + pushed / STEFAN_BOLTZMANN / scale**4
    level = jnp.maximum(level, jnp.finfo(pushed.dtype).tiny)
    # Two square roots are vectorized, and a power is not.
    return scale * jnp.sqrt(jnp.sqrt(level))


class RadiativeCoefficient(eqx.Module):
    """Of heat transfer by radiation to surroundings at T_s: 4 sigma T_s^3."""

    temperature: Any
    """T_s [K], a number or a function of time."""

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """At a time [W/(m^2 K)]."""
        there = value_at(self.temperature, time)
        return 4 * STEFAN_BOLTZMANN * there * there * there


def linear_error(temperature: Any, reach: TemperatureRange) -> float:
    """The largest relative error of 4 T_s^3 (T_s - T) for T_s^4 - T^4.

    With r = T / T_s it is |4 / ((1 + r)(1 + r^2)) - 1|, largest at an end of the range.

    Args:
        temperature: T_s [K], a number or a function of time.
        reach: the coldest and the hottest T, and the end of the run.
    """
    low = float(smallest(temperature, reach.end))
    high = float(largest(temperature, reach.end))
    if not low > 0:
        return math.inf
    ratios = reach.lowest / high, reach.highest / low
    return max(abs(4 / ((1 + r) * (1 + r * r)) - 1) for r in ratios)


class Surroundings(AbstractSurfaceTerm):
    """Net emission to the surroundings: F eps sigma (T_s^4 - T^4) [W/m^2].

    One temperature all round, or a sky and a ground, each with its view factor F: 1 in
    sum, or less where `occlusion` finds something in the way. What hides the
    surroundings is then taken to be as warm as the surface itself.
    """

    temperature: Any
    """T_s [K], a number or a function of time; of the sky, where a ground is given."""
    ground: Any = None
    """Temperature of what is below the horizon [K], likewise."""
    occlusion: int | None = eqx.field(static=True, default=None)
    """In how many directions to look for what is in the way, such as 128."""
    linear_within: float | None = eqx.field(static=True, default=None)
    """Relative error of the net emission [-] up to which the linear law
    4 eps sigma T_s^3 (T_s - T) may stand for it; never without being asked."""

    def __check_init__(self):
        within = self.linear_within
        if within is not None and not 0 < within < 1:
            raise InputError(
                f"Surroundings(linear_within={within!r}): give a fraction above 0 and "
                "below 1, such as 0.02"
            )
        check_value(self.temperature, "Surroundings(temperature [K])", 0.0)
        if self.ground is not None:
            check_value(self.ground, "Surroundings(ground [K])", 0.0)
        if self.occlusion is not None:
            check_directions(self.occlusion)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "emission"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its temperatures."""
        only = self.ground is None
        return (self.temperature,) if only else (self.temperature, self.ground)

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """Every free fragment, with the emissivity of its material."""
        if surface.prune and is_zero(surface.emissivity):
            return Omitted("the surface has emissivity 0")
        acts = surface.acted_on(None)
        if isinstance(acts, Omitted):
            return acts
        bindings = []
        for temperature, factor in self._parts(surface):
            law, notes = self._law(temperature, surface, reference)
            share = surface.emissivity * surface.area * factor.astype(surface.dtype)
            sees = acts & (factor > 0)
            if sees.any() or not surface.prune:
                bindings.append(binding(share, law, sees)._replace(notes=notes))
        return tuple(bindings) or Omitted("none of the surface sees the surroundings")

    def _law(
        self, temperature: Any, surface: Surface, reference: Scalar
    ) -> tuple[AbstractFluxLaw, tuple[str, ...]]:
        """The law of the fourth power, or the linear one where it is good enough."""
        there = for_jit(temperature, surface.dtype)
        base = jnp.asarray(reference, surface.dtype)
        law = Emission(temperature=there, reference=base)
        if self.linear_within is None:
            return law, ()
        if surface.temperature_range is None or is_traced(temperature):
            return law, ("not linear: the range of temperatures is not known",)
        error = linear_error(temperature, surface.temperature_range)
        told = f"the linear law is off by up to {100 * error:.2g} % of the net emission"
        if not error <= self.linear_within:
            return law, (f"{told}, more than allowed: not used",)
        h = RadiativeCoefficient(there)
        # A number where it is one: the balance is then known beforehand.
        h = h if callable(there) else h(jnp.zeros((), surface.dtype))
        return Exchange(h, there, base), (told,)

    def _parts(self, surface: Surface) -> list[tuple[Any, Float[np.ndarray, " s"]]]:
        """Each temperature with the view factor to it."""
        if self.ground is None and self.occlusion is None:
            return [(self.temperature, np.ones(len(surface.position)))]
        view = self._view(surface)
        if self.ground is None:
            return [(self.temperature, view.sky + view.ground)]
        return [(self.temperature, view.sky), (self.ground, view.ground)]

    def _view(self, surface: Surface) -> SkyView:
        if self.occlusion is None:
            return open_view(surface.normal)
        return sky_view(
            surface.scene_triangles,
            surface.position,
            surface.normal,
            surface.pitch,
            self.occlusion,
        )

    def forcing(self, end: float | int) -> Forcing:
        """Towards the warmest of its temperatures [K]."""
        most = [largest(value, end) for value in self.values]
        return Forcing(temperature=jnp.max(jnp.stack(most)))
