"""Radiative exchange between bodies and with the surroundings, as a term.

It replaces `Surroundings` where bodies, or parts of one, see each other:

    q = eps (H - sigma T^4),

with the irradiation H of a patch from all visible patches (`radiosity`). Each step
first finds the surface temperatures for the irradiation of surfaces at node
temperature, then exchanges the radiation of surfaces at these temperatures. The
exchange conserves heat.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import Scalar
from ...constants import STEFAN_BOLTZMANN
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
from ..time_varying import check_value, for_jit, is_zero, largest, value_at
from .emission import equilibrium_temperature
from .radiosity import DEFAULT_MAX_PATCHES, PatchExchange, patch_exchange
from .view_factors import DEFAULT_DIRECTIONS


class Radiation(AbstractFluxLaw):
    """Heat flux H - sigma T^4 [W/m^2]; the effective area contains the emissivity."""

    received: Float[Array, "*#m"]
    """Irradiation minus sigma T_0^4 [W/m^2]; the net flux without `emits`."""
    base: Float[Array, ""]
    """T_0 [K], the same for all bodies."""
    reference: Float[Array, "*#m"]
    """Reference temperature of this body's state [K]."""
    emits: bool = eqx.field(static=True, default=True)
    """True if the emission is computed here, False if `received` includes it."""

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
        return self.received - self._emitted(theta) if self.emits else self.received

    @override
    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        del time
        if not self.emits:
            return jnp.zeros((), theta.dtype)
        hot = jnp.maximum(self.reference + theta, 0)
        return 4 * STEFAN_BOLTZMANN * hot * hot * hot

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        del end
        return 4 * STEFAN_BOLTZMANN * hottest**3

    @override
    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        return STEFAN_BOLTZMANN * reach.highest**4

    @override
    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        return 12 * STEFAN_BOLTZMANN * reach.highest**2

    @property
    @override
    def is_linear(self) -> bool:
        return not self.emits

    @property
    @override
    def is_dissipative(self) -> bool:
        return self.emits

    @override
    def supersolution(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        del time
        brought = self.received + jnp.maximum(pushed, 0)
        return equilibrium_temperature(self.base, brought) - self.reference


class RadiativeExchange(AbstractSurfaceTerm):
    """Radiation between grey diffuse bodies and with black surroundings.

    q = eps (H - sigma T^4) [W/m^2],    H = F J + F_s sigma T_s^4,
    J = eps sigma T^4 + (1 - eps) H

    The surface of each body is divided into patches, each with one irradiation H; the
    view factors F account for all obstacles. Source: Hottel and Sarofim, Radiative
    Transfer (1967).

    Raises:
        InputError: for a negative temperature.
    """

    temperature: Any
    """T_s of the black surroundings [K], a number or a function of time."""
    max_patches: int = eqx.field(static=True, default=DEFAULT_MAX_PATCHES)
    """Largest number of patches of a body."""
    directions: int = eqx.field(static=True, default=DEFAULT_DIRECTIONS)
    """Number of directions in which view factors are sampled."""

    def __check_init__(self):
        check_value(self.temperature, "RadiativeExchange(temperature [K])", 0.0)

    @property
    @override
    def name(self) -> str:
        return "emission"

    @property
    @override
    def values(self) -> tuple[Any, ...]:
        return (self.temperature,)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return Forcing(temperature=largest(self.temperature, end))

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """Every free fragment; what it receives is found at every step."""
        if surface.prune and is_zero(surface.emissivity):
            return Omitted("the surface has emissivity 0")
        acts = surface.acted_on(None)
        if isinstance(acts, Omitted):
            return acts
        zero = jnp.zeros((), surface.dtype)
        law = Radiation(zero, zero, jnp.asarray(reference, surface.dtype))
        return (binding(surface.emissivity * surface.area, law, acts),)


class Enclosure(eqx.Module):
    """Radiative exchange on the surface cells of all bodies."""

    exchange: PatchExchange
    base: Float[Array, ""]
    """T_0 [K]."""
    temperature: Any
    """T_s of the surroundings [K]."""
    above: tuple[Float[Array, ""], ...]
    """Reference temperatures of the bodies minus T_0 [K]."""

    def _concatenated(
        self, thetas: tuple[Float[Array, " _"], ...]
    ) -> Float[Array, " s"]:
        pairs = zip(thetas, self.above, strict=True)
        return jnp.concatenate([theta + above for theta, above in pairs])

    def _split(self, values: Float[Array, " s"]) -> list[Float[Array, " _"]]:
        ends = np.cumsum(self.exchange.fragments)[:-1].tolist()
        return jnp.split(values, ends)

    def _around(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return value_at(self.temperature, time) - self.base

    def irradiation(
        self, time: Float[Array, ""], thetas: tuple[Float[Array, " _"], ...]
    ) -> list[Float[Array, " _"]]:
        """Irradiation minus sigma T_0^4 on each body at `thetas` [W/m^2]."""
        emitted = self.exchange.emitted(self._concatenated(thetas), self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self._split(self.exchange.irradiation(emitted, around))

    def net(
        self, time: Float[Array, ""], thetas: tuple[Float[Array, " _"], ...]
    ) -> list[Float[Array, " _"]]:
        """Irradiation minus emission on each body [W/m^2]."""
        emitted = self.exchange.emitted(self._concatenated(thetas), self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self._split(self.exchange.irradiation(emitted, around) - emitted)


def enclosure(
    term: RadiativeExchange,
    surfaces: tuple[Surface, ...],
    references: tuple[Scalar, ...],
) -> Enclosure:
    """Radiative exchange between the fragments of bodies in the scene."""
    dtype = surfaces[0].dtype
    number = lambda value: jnp.asarray(value, dtype)
    base = sum(references) / len(references)
    return Enclosure(
        exchange=patch_exchange(surfaces, term.max_patches, term.directions),
        base=number(base),
        temperature=for_jit(term.temperature, dtype),
        above=tuple(number(reference - base) for reference in references),
    )


def patches_of(fine: Enclosure) -> list[Int[np.ndarray, " s"]]:
    """Patch of each body's fragments."""
    ends = np.cumsum(fine.exchange.fragments)[:-1]
    return np.split(np.asarray(fine.exchange.patch), ends)


def coarsened_enclosure(
    fine: Enclosure, cell: list[Int[np.ndarray, " _"]], cells: tuple[int, ...]
) -> Enclosure:
    """Exchange on surface cells that each combine fragments of one patch.

    `cell` is that of each body's fragments, -1 without one; `cells` their number.
    """
    exchange = fine.exchange
    first = np.cumsum([0, *cells])
    number = np.concatenate(
        [
            np.where(own >= 0, own + start, -1)
            for own, start in zip(cell, first, strict=False)
        ]
    )
    kept, count = np.flatnonzero(number >= 0), sum(cells)
    patch = np.zeros(count, np.int32)
    patch[number[kept]] = np.asarray(exchange.patch)[kept]
    weight = jnp.zeros(count, exchange.weight.dtype)
    weight = weight.at[number[kept]].add(exchange.weight[kept])
    merged = PatchExchange(
        patch=jnp.asarray(patch),
        weight=weight,
        emissivity=jnp.ones_like(weight),
        transfer=exchange.transfer,
        from_surroundings=exchange.from_surroundings,
        grey_area=exchange.grey_area,
        fragments=cells,
    )
    return Enclosure(merged, fine.base, fine.temperature, fine.above)
