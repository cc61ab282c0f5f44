"""Radiation of bodies among each other and with the surroundings, as a term.

Takes the place of `Surroundings` where bodies, or parts of one, see each other:

    q = eps (H - sigma T^4),

with the irradiation H from all that a patch of surface sees (`exchange`). A step first
finds every surface's temperature with what the nodes radiate, then exchanges what
surfaces of that temperature do. That exchange is exact: nothing is lost between bodies.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

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
from .emission import shedding_temperature
from .radiosity import MOST_PATCHES, PatchExchange, patch_exchange
from .view_factors import DIRECTIONS


class Radiation(AbstractFluxLaw):
    """What a grey surface receives, less what it emits; the share holds eps."""

    received: Float[Array, "*#m"]
    """Irradiation of each place less sigma T_0^4; without `emits`, net [W/m^2]."""
    base: Float[Array, ""]
    """T_0 [K], the same for all bodies."""
    reference: Float[Array, "*#m"]
    """What this body's temperatures count from [K]."""
    emits: bool = eqx.field(static=True, default=True)
    """Whether emission follows the temperature, or is in what is received."""

    def _emitted(self, theta: Float[Array, " m"]) -> Float[Array, " m"]:
        hot = self.reference + theta
        above = theta + (self.reference - self.base)
        sums = (hot + self.base) * (hot * hot + self.base * self.base)
        return STEFAN_BOLTZMANN * above * sums

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """H - sigma T^4."""
        del time
        return self.received - self._emitted(theta) if self.emits else self.received

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """4 sigma T^3, or none."""
        del time
        if not self.emits:
            return jnp.zeros((), theta.dtype)
        hot = jnp.maximum(self.reference + theta, 0)
        return 4 * STEFAN_BOLTZMANN * hot * hot * hot

    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """4 sigma T^3 at the hottest."""
        del end
        return 4 * STEFAN_BOLTZMANN * hottest**3

    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """Sigma T^4: nothing that is seen is hotter."""
        return STEFAN_BOLTZMANN * reach.highest**4

    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """12 sigma T^2 at the hottest."""
        return 12 * STEFAN_BOLTZMANN * reach.highest**2

    @property
    def is_linear(self) -> bool:
        """Only where it does not emit."""
        return not self.emits

    @property
    def is_dissipative(self) -> bool:
        """Where it emits."""
        return self.emits

    def supersolution(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Where emission alone sheds what is received and pushed in."""
        del time
        brought = self.received + jnp.maximum(pushed, 0)
        return shedding_temperature(self.base, brought) - self.reference


class RadiativeExchange(AbstractSurfaceTerm):
    """Net emission of all bodies, to what they see of each other and around them."""

    temperature: Any
    """Of black surroundings [K], a number or a function of time."""
    max_patches: int = eqx.field(static=True, default=MOST_PATCHES)
    """Of a body's surface, of one irradiation each."""
    directions: int = eqx.field(static=True, default=DIRECTIONS)
    """Along which it is looked at for what sees what."""

    def __check_init__(self):
        check_value(self.temperature, "RadiativeExchange(temperature [K])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger, as for `Surroundings`."""
        return "emission"

    @property
    def values(self) -> tuple[Any, ...]:
        """The temperature of the surroundings."""
        return (self.temperature,)

    def forcing(self, end: float | int) -> Forcing:
        """Towards that temperature [K]."""
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
    """The exchange on the places of all bodies' surfaces."""

    exchange: PatchExchange
    base: Float[Array, ""]
    """T_0 [K]."""
    temperature: Any
    """Of the surroundings [K]."""
    above: tuple[Float[Array, ""], ...]
    """The bodies' references less T_0 [K]."""

    def _joined(self, thetas: tuple[Float[Array, " _"], ...]) -> Float[Array, " s"]:
        pairs = zip(thetas, self.above, strict=True)
        return jnp.concatenate([theta + above for theta, above in pairs])

    def _apart(self, values: Float[Array, " s"]) -> list[Float[Array, " _"]]:
        ends = np.cumsum(self.exchange.fragments)[:-1].tolist()
        return jnp.split(values, ends)

    def _around(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return value_at(self.temperature, time) - self.base

    def irradiation(
        self, time: Float[Array, ""], thetas: tuple[Float[Array, " _"], ...]
    ) -> list[Float[Array, " _"]]:
        """Of each body's places, less sigma T_0^4 [W/m^2], at surfaces of `thetas`."""
        emitted = self.exchange.emitted(self._joined(thetas), self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self._apart(self.exchange.irradiation(emitted, around))

    def net(
        self, time: Float[Array, ""], thetas: tuple[Float[Array, " _"], ...]
    ) -> list[Float[Array, " _"]]:
        """Irradiation less emission of each body's places [W/m^2]."""
        emitted = self.exchange.emitted(self._joined(thetas), self.base)
        around = self.exchange.emitted(self._around(time), self.base)
        return self._apart(self.exchange.irradiation(emitted, around) - emitted)


def enclosure(
    term: RadiativeExchange,
    surfaces: tuple[Surface, ...],
    references: tuple[Scalar, ...],
) -> Enclosure:
    """The exchange of fragments of bodies where they stand."""
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
    """The patch of each body's fragments."""
    ends = np.cumsum(fine.exchange.fragments)[:-1]
    return np.split(np.asarray(fine.exchange.patch), ends)


def merged_enclosure(
    fine: Enclosure, place: list[Int[np.ndarray, " _"]], places: tuple[int, ...]
) -> Enclosure:
    """The same on places that several fragments of one patch make up.

    Args:
        fine: on fragments.
        place: of the fragments of each body; -1 where no place is.
        places: how many each body has; one without fragments exchanges nothing.
    """
    exchange = fine.exchange
    first = np.cumsum([0, *places])
    number = np.concatenate(
        [
            np.where(own >= 0, own + start, -1)
            for own, start in zip(place, first, strict=False)
        ]
    )
    kept, count = np.flatnonzero(number >= 0), sum(places)
    patch = np.zeros(count, np.int32)
    patch[number[kept]] = np.asarray(exchange.patch)[kept]
    weight = jnp.zeros(count, exchange.weight.dtype)
    weight = weight.at[number[kept]].add(exchange.weight[kept])
    merged = PatchExchange(
        patch=jnp.asarray(patch),
        weight=weight,
        emissivity=jnp.ones_like(weight),
        spread=exchange.spread,
        from_surroundings=exchange.from_surroundings,
        grey_area=exchange.grey_area,
        fragments=places,
    )
    return Enclosure(merged, fine.base, fine.temperature, fine.above)
