"""Radiation between grey surfaces by the radiosity method.

    J = eps E + (1 - eps) H,    H = F J + F_s E_s,    q = eps (H - E),    E = sigma T^4,

solved for the irradiation H once, before the run: H = K E + k_s E_s, with rows that add
up to 1. Every fragment of a patch receives the patch's irradiation and emits at its own
temperature. Source: Hottel and Sarofim, Radiative Transfer (1967); Gebhart, Heat
Transfer (1961).
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
from ..flux_law import Values
from ..term import BodySurface
from .patches import group_patches
from .view_factors import (
    DEFAULT_DIRECTIONS,
    DEFAULT_LINES,
    PatchedBody,
    ViewFactors,
    view_factors,
)


# Smallest emissivity of a patch: radiosity is undetermined between perfect mirrors.
_MIN_EMISSIVITY = 1e-6

DEFAULT_MAX_PATCHES = 128
"""Largest number of patches of a body."""


def net_exchange(
    factor: Float[np.ndarray, "p p"],
    area: Float[np.ndarray, " p"],
    emissivity: Float[np.ndarray, " p"],
    temperature: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " p"]:
    """Net heat rate out of each surface of a grey enclosure [W].

    View factors F_ij add up to 1 in each row, with A_i F_ij = A_j F_ji; areas in m^2,
    temperatures in K.

    Raises:
        InputError: for surfaces that are no enclosure, or values out of range.
    """
    if not np.allclose(factor.sum(1), 1.0, rtol=0, atol=1e-9):
        raise InputError(
            "net_exchange: the view factors of a surface do not add up to 1; "
            "give the surroundings as a surface"
        )
    if (emissivity < 0).any() or (emissivity > 1).any() or (temperature < 0).any():
        raise InputError("net_exchange: give emissivities of 0 to 1, and kelvin")
    outside = np.zeros(len(area))
    grey = np.maximum(emissivity, _MIN_EMISSIVITY)
    transfer, _ = _irradiation_matrix(factor, outside, grey)
    emitted = STEFAN_BOLTZMANN * temperature**4
    return area * emissivity * (emitted - transfer @ emitted)


def _irradiation_matrix(
    factor: Float[Values, "p p"],
    outside: Float[Values, " p"],
    emissivity: Float[Values, " p"],
) -> tuple[Float[Values, "p p"], Float[Values, " p"]]:
    """K and k_s in H = K E + k_s E_s, with `outside` the factors to surroundings."""
    xp: Any = jnp if is_traced((factor, outside, emissivity)) else np
    reflection = (
        xp.eye(len(outside), dtype=factor.dtype) - factor * (1 - emissivity)[None]
    )
    sources = xp.concatenate([factor * emissivity[None], outside[:, None]], axis=1)
    both = xp.linalg.solve(reflection, sources)
    return both[:, :-1], both[:, -1]


class PatchExchange(eqx.Module):
    """Radiation among all bodies' fragments and with black surroundings."""

    patch: Int[Array, " s"]
    """Patch of each fragment, bodies concatenated."""
    weight: Float[Array, " s"]
    """Fraction of its patch's emission by each fragment at one temperature [-]."""
    emissivity: Float[Array, " s"]
    transfer: Float[Array, "p p"]
    """K [-]: irradiation of each patch for a unit of emissive power of another."""
    from_surroundings: Float[Array, " p"]
    """k_s [-]; with the row of K it adds up to 1."""
    grey_area: Float[Array, " p"]
    """A eps of each patch [m^2]."""
    fragments: tuple[int, ...] = eqx.field(static=True)
    """Number of fragments of each body."""

    def emitted(
        self, theta: Float[Array, "*s"], base: Float[Array, ""]
    ) -> Float[Array, "*s"]:
        """Sigma (T^4 - T_0^4) [W/m^2] at T = T_0 + theta, with T_0 = `base` [K]."""
        # The factored form keeps the digits of small differences in float32.
        hot = base + theta
        sums = (hot + base) * (hot * hot + base * base)
        return STEFAN_BOLTZMANN * theta * sums

    def irradiation(
        self, emitted: Float[Array, " s"], surroundings: Float[Array, ""]
    ) -> Float[Array, " s"]:
        """Irradiation H of fragments minus sigma T_0^4 [W/m^2].

        Both emissive powers are given minus sigma T_0^4.
        """
        # A patch emits what its fragments emit, so that no heat is lost between the
        # two.
        by_patch = self._by_patch(emitted)
        heat = self.transfer @ by_patch + self.from_surroundings * surroundings
        return heat.at[self.patch].get(mode="promise_in_bounds")

    def heat_flux(
        self,
        theta: Float[Array, " s"],
        surroundings: Float[Array, ""],
        base: Float[Array, ""],
    ) -> Float[Array, " s"]:
        """Net heat flux into every fragment, eps (H - sigma T^4) [W/m^2].

        Temperatures of fragments and surroundings count from `base`, T_0 [K].
        """
        emitted = self.emitted(theta, base)
        around = self.emitted(surroundings, base)
        return self.emissivity * (self.irradiation(emitted, around) - emitted)

    def to_surroundings(
        self,
        theta: Float[Array, " s"],
        surroundings: Float[Array, ""],
        base: Float[Array, ""],
    ) -> Float[Array, ""]:
        """Net heat rate to the surroundings [W]: the loss of all fragments."""
        by_patch = self._by_patch(self.emitted(theta, base))
        around = self.emitted(surroundings, base)
        return self.grey_area @ (self.from_surroundings * (by_patch - around))

    def max_slope(self, hottest: Float[Array, ""]) -> Float[Array, " s"]:
        """Upper bound 4 eps sigma T^3 of -d(heat flux)/dT below `hottest` [K]."""
        return 4 * STEFAN_BOLTZMANN * self.emissivity * hottest**3

    def _by_patch(self, emitted: Float[Array, " s"]) -> Float[Array, " p"]:
        count = self.grey_area.shape[0]
        return jax.ops.segment_sum(self.weight * emitted, self.patch, count)


def patch_exchange(
    surfaces: tuple[BodySurface, ...],
    max_patches: int = DEFAULT_MAX_PATCHES,
    directions: int = DEFAULT_DIRECTIONS,
    lines: int = DEFAULT_LINES,
) -> PatchExchange:
    """Radiative exchange between the surfaces of bodies, and of each with itself.

    `directions` views of the scene and of each pair of bodies have `lines` lines across
    the largest extent.

    Raises:
        InputError: for fewer than 6 patches, or 8 directions or lines.
    """
    # Fragments in contact keep a trace of their area, so that no patch has area 0.
    areas = [np.maximum(s.area, 1e-6 * s.grid.fragment_area) for s in surfaces]
    grouped = [
        group_patches(s.own_position, s.own_normal, area, s.grid.lattice, max_patches)
        for s, area in zip(surfaces, areas, strict=True)
    ]
    bodies = tuple(
        PatchedBody(s.pose.to_world(s.grid.mesh.triangles), patches, s.pose)
        for s, patches in zip(surfaces, grouped, strict=True)
    )
    first = np.cumsum([0, *(patches.count for patches in grouped)])
    patch = [p.patch + start for p, start in zip(grouped, first, strict=False)]
    full = lambda s: s.emissivity * np.ones(len(s.position), s.dtype)
    xp: Any = jnp if is_traced([s.emissivity for s in surfaces]) else np
    return exchange_of(
        view_factors(bodies, directions, lines),
        np.concatenate(patch),
        np.concatenate(areas),
        xp.concatenate([full(s) for s in surfaces]),
        tuple(len(s.position) for s in surfaces),
    )


def exchange_of(
    views: ViewFactors,
    patch: Int[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    emissivity: Float[Values, " s"],
    fragments: tuple[int, ...],
) -> PatchExchange:
    """Exchange of fragments from the view factors of their patches.

    Areas of the fragments are in m^2; `fragments` is their number in each body.
    Gradients pass through the emissivities.
    """
    dtype = emissivity.dtype
    xp: Any = jnp if is_traced(emissivity) else np
    wide = emissivity if xp is jnp else np.asarray(emissivity, float)
    grey = xp.maximum(wide, _MIN_EMISSIVITY)
    count = len(views.area)
    cast = lambda values: xp.asarray(values, wide.dtype)
    emitting = cast(area) * grey
    if xp is jnp:
        grey_area = jax.ops.segment_sum(emitting, jnp.asarray(patch), count)
    else:
        grey_area = np.bincount(patch, emitting, count)
    mean = grey_area / cast(views.area)
    transfer, outside = _irradiation_matrix(
        cast(views.factor), cast(views.to_surroundings), mean
    )
    output = lambda values: jnp.asarray(values, dtype)
    return PatchExchange(
        patch=jnp.asarray(patch, jnp.int32),
        weight=output(emitting / grey_area[patch]),
        emissivity=output(grey),
        transfer=output(transfer),
        from_surroundings=output(outside),
        grey_area=output(grey_area),
        fragments=fragments,
    )
