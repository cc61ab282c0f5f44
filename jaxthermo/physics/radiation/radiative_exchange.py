"""Radiative exchange between bodies and with the surroundings, as a term.

It replaces `Surroundings` where bodies, or parts of one, see each other:

    q = eps (H - sigma T^4),

with the irradiation H of a patch from all visible patches (`radiosity`). Each step
first finds the surface temperatures for the irradiation of surfaces at node
temperature, then exchanges the radiation of surfaces at these temperatures. The
exchange conserves heat.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import TimeVarying
from ...constants import STEFAN_BOLTZMANN
from ..boundary import ImposedFlux, toward
from ..flux_law import AbstractFluxLaw, TemperatureRange
from ..term import (
    AbstractExchangeTerm,
    Binding,
    BodySurface,
    Cover,
    Forcing,
    Omitted,
    Surface,
    spread,
)
from ..time_varying import check_value, for_jit, is_zero, value_at
from .emission import equilibrium_temperature
from .radiosity import DEFAULT_MAX_PATCHES, PatchExchange, patch_exchange
from .view_factors import DEFAULT_DIRECTIONS


class Radiation(AbstractFluxLaw):
    """Heat flux H - sigma T^4 [W/m^2]; the effective area contains the emissivity."""

    is_dissipative = True

    received: Float[Array, "*#m"]
    """Irradiation minus sigma T_0^4 [W/m^2]."""
    base: Float[Array, ""]
    """T_0 [K], the same for all bodies."""
    reference: Any = 0.0
    """Temperature from which the body's state counts [K]."""

    def _emitted(self, theta: Float[Array, " m"]) -> Float[Array, " m"]:
        hot = self.reference + theta
        above = theta + (self.reference - self.base)
        sums = (hot + self.base) * (hot * hot + self.base * self.base)
        return STEFAN_BOLTZMANN * above * sums

    @override
    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        del time
        return self.received - self._emitted(theta)

    @override
    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        del time
        hot = jnp.maximum(self.reference + theta, 0)
        return 4 * STEFAN_BOLTZMANN * hot * hot * hot

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        del end
        return 4 * STEFAN_BOLTZMANN * hottest**3

    @override
    def max_flux(self, within: TemperatureRange) -> float | Float[Array, ""]:
        return STEFAN_BOLTZMANN * within.highest**4

    @override
    def curvature(self, within: TemperatureRange) -> float | Float[Array, ""]:
        return 12 * STEFAN_BOLTZMANN * within.highest**2

    @override
    def supersolution(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        del time
        brought = self.received + jnp.maximum(pushed, 0)
        return equilibrium_temperature(self.base, brought) - self.reference

    @override
    def irradiated(self, received: Float[Array, " m"], emits: bool) -> AbstractFluxLaw:
        # The net flux does not depend on the temperature of the surface any more.
        return replace(self, received=received) if emits else ImposedFlux(received)


class RadiativeExchange(AbstractExchangeTerm):
    """Radiation between grey diffuse bodies and with black surroundings.

    q = eps (H - sigma T^4) [W/m^2],    H = F J + F_s sigma T_s^4,
    J = eps sigma T^4 + (1 - eps) H

    The surface of each body is divided into patches, each with one irradiation H; the
    view factors F account for all obstacles. Source: Hottel and Sarofim, Radiative
    Transfer (1967).

    Raises:
        InputError: for a negative temperature.
    """

    name = "emission"

    temperature: TimeVarying
    """T_s of the black surroundings [K], a number or a function of time."""
    max_patches: int = eqx.field(static=True, default=DEFAULT_MAX_PATCHES)
    """Largest number of patches of a body."""
    directions: int = eqx.field(static=True, default=DEFAULT_DIRECTIONS)
    """Number of directions in which view factors are sampled."""

    def __check_init__(self):
        check_value(self.temperature, "RadiativeExchange(temperature [K])", 0.0)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        zero = jnp.zeros((), surface.dtype)
        # What the surface receives is found at every step.
        law = Radiation(zero, jnp.asarray(_base(surface), surface.dtype))
        return surface.bind(law, [self._emitting(body) for body in surface.bodies])

    def _emitting(self, body: BodySurface) -> Cover | Omitted:
        """Emitting area of a body."""
        if body.prune and is_zero(body.emissivity):
            return body.omitted("the surface has emissivity 0")
        exposed = body.exposed()
        if isinstance(exposed, Omitted):
            return exposed
        return body.emissivity * body.area, exposed

    @override
    def enclosure(self, surface: Surface) -> "Enclosure":
        base = _base(surface)
        above = [reference - base for reference in surface.references]
        return Enclosure(
            exchange=patch_exchange(surface.bodies, self.max_patches, self.directions),
            base=jnp.asarray(base, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
            above=spread(above, surface.counts, surface.dtype),
        )


def _base(surface: Surface) -> Any:
    """T_0, the mean of the bodies' references [K]."""
    return sum(surface.references) / len(surface.references)


class Enclosure(eqx.Module):
    """Radiative exchange on the surface cells of all bodies."""

    exchange: PatchExchange
    base: Float[Array, ""]
    """T_0 [K]."""
    temperature: Any
    """T_s of the surroundings [K]."""
    above: Float[Array, "*#s"]
    """Reference of each surface cell minus T_0 [K]."""

    def _around(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return value_at(self.temperature, time) - self.base

    def irradiation(
        self, time: Float[Array, ""], theta: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        """H - sigma T_0^4 on surface cells at temperatures `theta` [W/m^2]."""
        emitted = self.exchange.emitted(theta + self.above, self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self.exchange.irradiation(emitted, around)

    def net(
        self, time: Float[Array, ""], theta: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        """Irradiation minus emission of surface cells [W/m^2]."""
        emitted = self.exchange.emitted(theta + self.above, self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self.exchange.irradiation(emitted, around) - emitted

    def coarsened(
        self, cell: Int[np.ndarray, " s"], counts: tuple[int, ...]
    ) -> "Enclosure":
        """Exchange on cells that each combine fragments of one patch, -1 for none."""
        # The patches remain, and with them the matrix K; only the weights are summed.
        fine = self.exchange
        kept, cells = np.flatnonzero(cell >= 0), sum(counts)
        patch = np.zeros(cells, np.int32)
        patch[cell[kept]] = np.asarray(fine.patch)[kept]
        weight = jnp.zeros(cells, fine.weight.dtype)
        weight = weight.at[cell[kept]].add(fine.weight[kept])
        above = self.above
        if above.ndim:
            above = jnp.zeros(cells, above.dtype).at[cell[kept]].set(above[kept])
        exchange = PatchExchange(
            patch=jnp.asarray(patch),
            weight=weight,
            emissivity=jnp.ones_like(weight),
            transfer=fine.transfer,
            from_surroundings=fine.from_surroundings,
            grey_area=fine.grey_area,
            fragments=counts,
        )
        return Enclosure(exchange, self.base, self.temperature, above)
