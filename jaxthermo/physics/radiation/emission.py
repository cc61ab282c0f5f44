"""Net emission to the surroundings (thesis eq. 1, completed).

    q = F eps sigma A (T_s^4 - T^4)

with the view factor F to surroundings at T_s, 1 without obstacles. The thesis drops the
irradiation and then the whole term; at 300 K it equals a heat transfer coefficient of
6 W/(m^2 K), as much as still air. Source: Stefan-Boltzmann law, Kirchhoff's law for a
grey surface.
"""

import abc
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import TimeVarying, is_traced, namespace
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ...voxels.selection import AbstractSelection
from ..boundary import Exchange, either, toward
from ..flux_law import AbstractFluxLaw, Forcing
from ..surface import BodySurface, Surface
from ..term import OperatingPoint, Scale
from ..time_varying import check_value, for_jit, largest, smallest, value_at
from .irradiation import AbstractRadiativeTerm, Irradiation
from .visibility import check_directions, sky_view_of


class AbstractEmission(AbstractFluxLaw):
    """Laws with the emission sigma T^4; the effective area contains the emissivity."""

    is_dissipative = True

    @property
    @abc.abstractmethod
    def reference(self) -> Any:
        """Temperature from which theta counts [K]."""

    @override
    def slope(self, time, theta) -> Float[Array, "*#m"]:
        del time
        return _radiative_coefficient(jnp.maximum(self.reference + theta, 0))

    @override
    def equilibrium(
        self, around: Float[Array, ""], imposed: Float[Array, " m"], end: float
    ) -> Float[Array, " m"]:
        del end
        return equilibrium_temperature(around, imposed)

    @override
    def max_slope(self, highest: Float[Array, ""], end: float) -> Float[Array, ""]:
        del end
        return 4 * STEFAN_BOLTZMANN * highest**3

    @override
    def curvature(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return 12 * STEFAN_BOLTZMANN * within.highest**2


def _radiative_coefficient(kelvin: Float[Array, "*#m"]) -> Float[Array, "*#m"]:
    # 4 sigma T^3 [W/(m^2 K)].
    return 4 * STEFAN_BOLTZMANN * kelvin * kelvin * kelvin


def net_emission(
    a: Float[Array, "*#m"], b: Float[Array, "*#m"], difference: Float[Array, "*#m"]
) -> Float[Array, "*#m"]:
    """Net emission sigma (T_a^4 - T_b^4) [W/m^2], with the difference T_a - T_b [K]."""
    # Factored, (T_a - T_b)(T_a + T_b)(T_a^2 + T_b^2): close temperatures keep their
    # digits in float32.
    return STEFAN_BOLTZMANN * difference * ((a + b) * (a * a + b * b))


class _Emission(AbstractEmission):
    """Heat flux sigma (T_s^4 - T^4) from surroundings at T_s."""

    temperature: Any
    reference: Any = 0.0

    @override
    def flux(self, time, theta) -> Float[Array, "*#m"]:
        ambient = value_at(self.temperature, time)
        difference = (ambient - self.reference) - theta
        return net_emission(ambient, self.reference + theta, difference)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        highest = largest(self.temperature, end)
        highest = namespace(highest).maximum(highest, within.highest)
        return STEFAN_BOLTZMANN * highest**4

    @override
    def supersolution(self, time, imposed) -> Float[Array, "*#m"]:
        ambient = value_at(self.temperature, time)
        kelvin = equilibrium_temperature(ambient, jnp.maximum(imposed, 0))
        return kelvin - self.reference


def equilibrium_temperature(
    around: Float[Array, "*#m"], imposed: Float[Array, "*#m"]
) -> Float[Array, "*#m"]:
    """Temperature T [K] with sigma (T^4 - T_a^4) = q''; close to 0 without a solution.

    T_a is `around` [K], q'' the imposed heat flux [W/m^2].
    """
    # Scaled by T_a or 1 K, so that a fourth power stays in float32.
    scale = jnp.maximum(around, 1)
    square = (around / scale) * (around / scale)
    level = square * square + imposed / STEFAN_BOLTZMANN / scale**4
    level = jnp.maximum(level, jnp.finfo(imposed.dtype).tiny)
    # The CPU compiler vectorizes two square roots, but not a power.
    return scale * jnp.sqrt(jnp.sqrt(level))


class _RadiativeCoefficient(Module):
    # h of the linear law as a function of time, at T_s [K].
    temperature: Any

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return _radiative_coefficient(value_at(self.temperature, time))


def _linear_error(temperature: Any, within: Forcing, end: float) -> float:
    """Largest relative error of 4 T_s^3 (T_s - T) for T_s^4 - T^4 [-].

    It is |4 / ((1 + r)(1 + r^2)) - 1| with r = T / T_s, largest at an end of the range.
    """
    low = float(smallest(temperature, end))
    high = float(largest(temperature, end))
    if not low > 0:
        return math.inf
    ratios = within.lowest / high, within.highest / low
    return max(abs(4 / ((1 + r) * (1 + r * r)) - 1) for r in ratios)


class AbstractSurroundings(AbstractRadiativeTerm):
    """Black surroundings of one temperature, or a sky and a ground."""

    temperature: eqx.AbstractVar[TimeVarying]
    ground: eqx.AbstractVar[TimeVarying | None]

    def __check_init__(self):
        name = type(self).__name__
        check_value(self.temperature, f"{name}(temperature [K])", 0.0)
        if self.ground is not None:
            check_value(self.ground, f"{name}(ground [K])", 0.0)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return either([toward(value, end) for value in self.values])


class Surroundings(AbstractSurroundings):
    """Net emission to the surroundings.

    q = F eps sigma (T_s^4 - T^4) [W/m^2]

    The surroundings have one temperature, or a sky and a ground, each with its view
    factor F. Their sum is 1, or less where `occlusion` detects obstacles, which then
    count as being as warm as the surface itself.

    Raises:
        InputError: for a negative temperature, or options out of range.
    """

    name = "emission"
    unseen = "none of the surface sees the surroundings"
    from_outside = True

    temperature: TimeVarying
    """T_s [K], a number or a function of time; with `ground`, that of the sky."""
    ground: TimeVarying | None = None
    """Temperature below the horizon [K], a number or a function of time."""
    occlusion: int | None = eqx.field(static=True, default=None)
    """Number of directions in which obstacles are detected, such as 128."""
    linear_within: float | None = eqx.field(static=True, default=None)
    """Largest relative error of the net emission [-] for which the linear law
    4 eps sigma T_s^3 (T_s - T) replaces it; None for never."""
    on: AbstractSelection | None = None
    """Part of the surface; several `Surroundings` may be on parts without overlap."""

    def __check_init__(self):
        within = self.linear_within
        if within is not None and not 0 < within < 1:
            raise InputError(
                f"Surroundings(linear_within={within!r}): give a fraction above 0 and "
                "below 1, such as 0.02"
            )
        if self.occlusion is not None:
            check_directions(self.occlusion)

    @property
    @override
    def chooses_law(self) -> bool:
        return self.linear_within is not None

    @override
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        factors = [self._view_factors(body) for body in surface.bodies]
        irradiation = []
        for n, temperature in enumerate(self.values):
            law, notes = self._law(temperature, surface)
            by_body = [view[n] for view in factors]
            irradiation.append(self._on_all(surface, by_body, law=law, notes=notes))
        return tuple(irradiation)

    def _law(
        self, temperature: Any, surface: Surface
    ) -> tuple[AbstractFluxLaw, tuple[str, ...]]:
        """Law of the fourth power, or the linear one if accurate enough, and notes."""
        ambient = for_jit(temperature, surface.dtype)
        law = _Emission(temperature=ambient)
        if self.linear_within is None:
            return law, ()
        if surface.temperatures is None or is_traced(temperature):
            return law, ("not linear: the range of temperatures is not known",)
        error = _linear_error(temperature, surface.temperatures, surface.end)
        note = f"the linear law is off by up to {100 * error:.2g} % of the net emission"
        if not error <= self.linear_within:
            return law, (f"{note}, more than allowed: not used",)
        h = _RadiativeCoefficient(ambient)
        # A constant coefficient lets the surface balance be solved before the run.
        h = h if callable(ambient) else h(jnp.zeros((), surface.dtype))
        return Exchange(h, ambient), (note,)

    def _view_factors(self, body: BodySurface) -> list[Float[np.ndarray, " s"]]:
        """View factors to the surroundings at each temperature."""
        if self.ground is None and self.occlusion is None:
            return [np.ones(len(body.position))]
        view = sky_view_of(body, self.occlusion)
        return [view.sky + view.ground] if self.ground is None else list(view)

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        slope = 4 * STEFAN_BOLTZMANN * point.kelvin**3
        return Scale(heat_transfer_coefficient=float(point.material.emissivity) * slope)
