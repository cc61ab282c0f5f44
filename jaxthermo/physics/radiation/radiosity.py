"""Radiation between grey surfaces that see each other: the radiosity method.

J = eps E + (1 - eps) H,    H = F J + F_s E_s,    q = eps (H - E),    E = sigma T^4,

solved for the irradiation H once and for all: H = K E + k_s E_s, rows that add up to 1.
Every fragment of a patch gets the patch's irradiation and emits at its own temperature.
The patch emits what its fragments do, so that no heat is lost between the two.
Source: Hottel and Sarofim, Radiative Transfer (1967); Gebhart, Heat Transfer (1961).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import is_traced
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ..term import Surface, Values
from .patches import group
from .view_factors import ACROSS, DIRECTIONS, PatchedBody, ViewFactors, view_factors


LEAST_EMISSIVITY = 1e-6
"""Of a patch: an enclosure of perfect mirrors would have no temperature inside."""

MOST_PATCHES = 128
"""A body, by default."""


def net_exchange(
    factor: Float[np.ndarray, "p p"],
    area: Float[np.ndarray, " p"],
    emissivity: Float[np.ndarray, " p"],
    temperature: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " p"]:
    """Heat that leaves each surface of a grey enclosure, net of what comes back [W].

    Args:
        factor: F_ij; each row adds up to 1 and A_i F_ij = A_j F_ji.
        area: A [m^2].
        emissivity: [-].
        temperature: T [K].

    Raises:
        InputError: if it is no enclosure, or a value is out of range.
    """
    if not np.allclose(factor.sum(1), 1.0, rtol=0, atol=1e-9):
        raise InputError(
            "net_exchange: the view factors of a surface do not add up to 1; "
            "give the surroundings as a surface"
        )
    if (emissivity < 0).any() or (emissivity > 1).any() or (temperature < 0).any():
        raise InputError("net_exchange: give emissivities of 0 to 1, and kelvin")
    outside = np.zeros(len(area))
    grey = np.maximum(emissivity, LEAST_EMISSIVITY)
    spread, _ = irradiation(factor, outside, grey)
    emitted = STEFAN_BOLTZMANN * temperature**4
    return area * emissivity * (emitted - spread @ emitted)


def irradiation(
    factor: Float[Values, "p p"],
    outside: Float[Values, " p"],
    emissivity: Float[Values, " p"],
) -> tuple[Float[Values, "p p"], Float[Values, " p"]]:
    """K and k_s in H = K E + k_s E_s.

    Args:
        factor: F_ij.
        outside: F_i to the surroundings.
        emissivity: above 0.
    """
    own: Any = jnp if is_traced((factor, outside, emissivity)) else np
    mirrors = (
        own.eye(len(outside), dtype=factor.dtype) - factor * (1 - emissivity)[None]
    )
    sources = own.concatenate([factor * emissivity[None], outside[:, None]], axis=1)
    both = own.linalg.solve(mirrors, sources)
    return both[:, :-1], both[:, -1]


class PatchExchange(eqx.Module):
    """Radiation among fragments, patch by patch, and with black surroundings.

    All fragments of all bodies, one body after the other.
    """

    patch: Int[Array, " s"]
    """Of each fragment."""
    weight: Float[Array, " s"]
    """Share of each fragment in what its patch emits at one temperature."""
    emissivity: Float[Array, " s"]
    spread: Float[Array, "p p"]
    """K: irradiation of each patch for each unit of emissive power of another."""
    from_surroundings: Float[Array, " p"]
    """k_s; with the row of K it adds up to 1."""
    grey_area: Float[Array, " p"]
    """A eps of each patch [m^2]."""
    fragments: tuple[int, ...] = eqx.field(static=True)
    """How many each body has."""

    def emitted(
        self, theta: Float[Array, "*s"], base: Float[Array, ""]
    ) -> Float[Array, "*s"]:
        """Sigma (T^4 - T_0^4) of fragments at T = T_0 + theta [W/m^2].

        Args:
            theta: above `base`, the same for all bodies [K].
            base: T_0 [K].
        """
        hot = base + theta
        sums = (hot + base) * (hot * hot + base * base)
        return STEFAN_BOLTZMANN * theta * sums

    def irradiation(
        self, emitted: Float[Array, " s"], surroundings: Float[Array, ""]
    ) -> Float[Array, " s"]:
        """H on fragments, less sigma T_0^4 [W/m^2]; one matrix times a vector.

        Args:
            emitted: by fragments, less sigma T_0^4 [W/m^2].
            surroundings: likewise.
        """
        of_patch = self._by_patch(emitted)
        heat = self.spread @ of_patch + self.from_surroundings * surroundings
        return heat.at[self.patch].get(mode="promise_in_bounds")

    def heat_flux(
        self,
        theta: Float[Array, " s"],
        surroundings: Float[Array, ""],
        base: Float[Array, ""],
    ) -> Float[Array, " s"]:
        """Net heat flux into every fragment, eps (H - sigma T^4) [W/m^2].

        Args:
            theta: of fragments above `base` [K].
            surroundings: temperature above `base` [K].
            base: T_0 [K].
        """
        own = self.emitted(theta, base)
        around = self.emitted(surroundings, base)
        return self.emissivity * (self.irradiation(own, around) - own)

    def to_surroundings(
        self,
        theta: Float[Array, " s"],
        surroundings: Float[Array, ""],
        base: Float[Array, ""],
    ) -> Float[Array, ""]:
        """Net heat to the surroundings [W]: what all fragments lose."""
        of_patch = self._by_patch(self.emitted(theta, base))
        around = self.emitted(surroundings, base)
        return self.grey_area @ (self.from_surroundings * (of_patch - around))

    def max_slope(self, hottest: Float[Array, ""]) -> Float[Array, " s"]:
        """4 eps sigma T^3: no -d(heat flux)/dT is larger below `hottest` [K]."""
        return 4 * STEFAN_BOLTZMANN * self.emissivity * hottest**3

    def _by_patch(self, emitted: Float[Array, " s"]) -> Float[Array, " p"]:
        count = self.grey_area.shape[0]
        return jax.ops.segment_sum(self.weight * emitted, self.patch, count)


def patch_exchange(
    surfaces: tuple[Surface, ...],
    max_patches: int = MOST_PATCHES,
    directions: int = DIRECTIONS,
    across: int = ACROSS,
) -> PatchExchange:
    """The exchange of bodies where they stand, among each other and each with itself.

    Args:
        surfaces: of the bodies, in the scene's order.
        max_patches: a body.
        directions: views of the scene, and of each pair of bodies.
        across: lines over the largest extent.

    Raises:
        InputError: for fewer than 6 patches, or 8 directions or lines.
    """
    # What another body touches keeps a trace of its area: no patch is without any.
    areas = [np.maximum(s.area, 1e-6 * s.grid.fragment_area) for s in surfaces]
    grouped = [
        group(s.own_position, s.own_normal, area, s.grid.lattice, max_patches)
        for s, area in zip(surfaces, areas, strict=True)
    ]
    bodies = tuple(
        PatchedBody(s.pose.place(s.grid.mesh.triangles), patches, s.pose)
        for s, patches in zip(surfaces, grouped, strict=True)
    )
    first = np.cumsum([0, *(patches.count for patches in grouped)])
    patch = [p.patch + start for p, start in zip(grouped, first, strict=False)]
    spread_out = lambda s: s.emissivity * np.ones(len(s.position), s.dtype)
    own: Any = jnp if is_traced([s.emissivity for s in surfaces]) else np
    return exchange_of(
        view_factors(bodies, directions, across),
        np.concatenate(patch),
        np.concatenate(areas),
        own.concatenate([spread_out(s) for s in surfaces]),
        tuple(len(s.position) for s in surfaces),
    )


def exchange_of(
    views: ViewFactors,
    patch: Int[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    emissivity: Float[Values, " s"],
    fragments: tuple[int, ...],
) -> PatchExchange:
    """The exchange of fragments whose patches have these view factors.

    Args:
        views: of the patches.
        patch: of each fragment.
        area: of the fragments [m^2].
        emissivity: of the fragments; gradients reach it.
        fragments: how many each body has.
    """
    dtype = emissivity.dtype
    own: Any = jnp if is_traced(emissivity) else np
    wide = emissivity if own is jnp else np.asarray(emissivity, float)
    grey = own.maximum(wide, LEAST_EMISSIVITY)
    count = len(views.area)
    as_own = lambda values: own.asarray(values, wide.dtype)
    emitting = as_own(area) * grey
    if own is jnp:
        grey_area = jax.ops.segment_sum(emitting, jnp.asarray(patch), count)
    else:
        grey_area = np.bincount(patch, emitting, count)
    mean = grey_area / as_own(views.area)
    spread, outside = irradiation(
        as_own(views.factor), as_own(views.to_surroundings), mean
    )
    give = lambda values: jnp.asarray(values, dtype)
    return PatchExchange(
        patch=jnp.asarray(patch, jnp.int32),
        weight=give(emitting / grey_area[patch]),
        emissivity=give(grey),
        spread=give(spread),
        from_surroundings=give(outside),
        grey_area=give(grey_area),
        fragments=fragments,
    )
