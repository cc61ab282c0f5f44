"""Laws of heat transfer at a surface: the flux as a function of its temperature.

A law bound to surface cells has an effective area of each of them.
"""

import abc
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import Time, consecutive, is_traced, namespace
from ..network.network import precise_sum
from ..network.segment_sums import sums_of_sizes


Values = Array | np.ndarray
# NumPy arrays wherever nothing is traced: they compile nothing.

PerCell = Float[Array, " m"]
# One value per surface cell.

PerCellOrOne = Float[Array, "*#m"]
# One value per surface cell, or one number for all cells.


class Forcing(NamedTuple):
    """Bounds of the temperatures that one term, or all, can cause.

    Heat that is imposed at any temperature is not in it, see `imposed_flux` of a law.
    """

    highest: Any = 0.0
    """Highest temperature towards which it heats a body [K]; 0 for none."""
    lowest: Any = math.inf
    """Lowest temperature towards which it cools a body [K]; infinity for none."""


class FluxBounds(NamedTuple):
    """Bounds of a heat flux within bounds of the temperatures; infinite for none."""

    flux: float
    """Largest |flux| [W/m^2]."""
    curvature: float
    """Largest |d2 flux / dT2| [W/(m^2 K^2)]."""


class LinearLaw(NamedTuple):
    """A heat flux w d(t) - s theta with a constant slope s."""

    weight: Any
    """w, one number or one per surface cell."""
    forcing: Any
    """d, a number or a function of time."""
    slope: Any = None
    """s [W/(m^2 K)], one number or one per surface cell; None for 0."""


class LinearSum(NamedTuple):
    """Sum of linear laws, rate - slope theta, exact at any surface temperature."""

    rate: PerCell
    """Heat rate at the reference temperature [W]."""
    slope: PerCell
    """-d heat rate / d theta [W/K]."""

    def at(self, theta: PerCell) -> PerCell:
        """Heat rate into each cell [W]."""
        return self.rate - self.slope * theta


class AbstractFluxLaw(Module):
    """Heat flux into a surface as a function of its temperature.

    Temperatures are differences `theta` from a reference. A law that needs the absolute
    temperature has a field `reference` [K], which binding fills in; T = reference +
    theta. Implement `flux`, `slope` and `max_slope`.
    """

    is_linear: ClassVar[bool] = False
    """True if the slope does not depend on the temperature."""
    is_dissipative: ClassVar[bool] = False
    """True if `supersolution` bounds the surface's temperature."""
    exchanges: ClassVar[bool] = False
    """True if it receives radiation from other surfaces, see `irradiated`."""

    @abc.abstractmethod
    def flux(self, time: Time, theta: PerCell) -> PerCellOrOne:
        """Heat flux into the surface [W/m^2] at `time` [s]."""

    @abc.abstractmethod
    def slope(self, time: Time, theta: PerCell) -> PerCellOrOne:
        """-d flux / d theta [W/(m^2 K)], never negative."""

    @abc.abstractmethod
    def max_slope(self, highest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """The largest slope below a temperature `highest` [K] up to `end` [s].

        It limits the explicit step.
        """

    @property
    def imposed_flux(self) -> Any:
        """Part of the flux that does not depend on the temperature [W/m^2].

        A number, an array per surface cell, or a function of time; None for 0. Without
        it the flux must vanish at a temperature within the `forcing` of its term.
        """
        return None

    def equilibrium(
        self, around: Float[Array, ""], imposed: PerCell, end: float
    ) -> PerCell:
        """A temperature [K] above which a surface loses at least the imposed heat flux.

        Infinite where the law has no such bound. The surroundings have `around` [K] at
        most up to `end` [s]; `imposed` counts per effective area [W/m^2].
        """
        return jnp.full_like(imposed, jnp.inf)

    def heat_transfer_coefficient(self, time: Time, theta: PerCell) -> PerCellOrOne:
        """Coefficient h = q / (T_inf - T_s) of a law of convection [W/(m^2 K)]."""
        # Equal to the slope where h does not depend on the temperature.
        return self.slope(time, theta)

    def linear(self) -> LinearLaw | None:
        """The law in linear form if its slope is constant, else None."""
        return None

    def uniform_flux(self, time: Time) -> Float[Array, ""] | None:
        """The flux where it is one number for all surface cells, else None."""
        return None

    def coarsened(self, mean: Callable[[Any], Any]) -> "AbstractFluxLaw":
        """The law on other cells, which combine several fragments or select some.

        A law with arrays of one value per fragment, on the last axis, overrides this;
        `mean` makes values per cell of them.
        """
        return self

    def above(self, reference: Any) -> "AbstractFluxLaw":
        """The law for temperatures counted from `reference` [K]."""
        # Laws of temperature differences alone, or of none, have no such field.
        if "reference" not in type(self).__dataclass_fields__:
            return self
        return replace(self, reference=reference)

    def irradiated(self, received: PerCell, emits: bool) -> "AbstractFluxLaw":
        """The law with the irradiation of each surface cell [W/m^2].

        Laws of radiation between surfaces override this.
        """
        return self

    def in_air(self, temperatures: Mapping[int, Float[Array, ""]]) -> "AbstractFluxLaw":
        """The law at the present temperatures of bodies of air, by their numbers [K].

        Laws of convection to such a body override this.
        """
        return self

    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        """A bound of |flux| within bounds of the temperatures up to `end` [W/m^2].

        With `curvature` it bounds the error of Newton's method at the surface; without
        a bound, infinity, every balance takes all iterations.
        """
        return math.inf

    def curvature(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        """A bound of |d2 flux / dT2| within these bounds [W/(m^2 K^2)]."""
        return math.inf

    def bounds(self, within: Forcing, end: float) -> FluxBounds:
        """Both bounds within bounds of the temperatures up to `end` [s]."""
        return FluxBounds(
            flux=float(self.max_flux(within, end)),
            curvature=float(self.curvature(within, end)),
        )

    def supersolution(self, time: Time, imposed: PerCell) -> PerCellOrOne:
        """A theta at which the surface loses at least the imposed heat.

        Newton's method that starts there or above cannot overshoot. Imposed is the heat
        rate of the other mechanisms per effective area [W/m^2].
        """
        return jnp.full_like(imposed, -jnp.inf)


class BoundTerm(Module):
    """A law on surface cells: fragments, or groups of fragments of one node."""

    effective_area: Float[Values, " m"]
    """Area times the absorbed fraction of the law's flux [m^2]; 0 where the law does
    not act. For a prescribed temperature, a conductance [W/K]."""
    total_effective_area: Float[Values, "*b"]
    """Sum over all cells, or over the cells of each body [m^2]."""
    law: AbstractFluxLaw

    def heat_rate(self, time: Time, theta: PerCell) -> PerCell:
        """Heat rate into each cell [W] at surface temperatures above the reference."""
        return jnp.asarray(self.effective_area) * self.law.flux(time, theta)

    def slope(self, time: Time, theta: PerCell) -> PerCell:
        """-d heat rate / d theta [W/K]."""
        return jnp.asarray(self.effective_area) * self.law.slope(time, theta)


def bound(effective_area: Float[Values, " m"], law: AbstractFluxLaw) -> BoundTerm:
    """A law on surface cells of one body."""
    return BoundTerm(effective_area, _total(effective_area), law)


def _total(values: Float[Values, " m"]) -> Float[Values, ""]:
    """Sum in double precision, or to about one rounding where the values are traced."""
    if is_traced(values):
        return precise_sum(jnp.asarray(values))
    # A float32 sum of a million cells would lose four digits.
    host = np.asarray(values)
    return np.asarray(host.sum(dtype=float), host.dtype)


def totals(values: Float[Values, " m"], counts: Sequence[int]) -> Float[Values, " b"]:
    """Sums of the cells of each body, one body after the other, as precise."""
    if is_traced(values) and counts[1:]:
        return sums_of_sizes(counts)(jnp.asarray(values))
    rows = [_total(values[of_body]) for of_body in consecutive(counts)]
    return namespace(rows).stack(rows)
