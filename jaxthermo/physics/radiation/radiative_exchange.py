"""Radiative exchange between bodies and with the surroundings, as a term.

It replaces `Surroundings` where bodies, or parts of one, see each other:

    q = eps (H - E),    J = eps E + (1 - eps) H,    H = F J + F_s E_s,

with the emissive power E = sigma T^4, the radiosity J and the irradiation H of each
patch. H = K E + k_s E_s, where the rows of K and k_s add up to 1, as they do with a
third factor for a ground; see `transfer`. Every fragment receives the irradiation
of its patch and emits at its own temperature. Each step first finds the surface
temperatures for the irradiation of surfaces at node temperature, then exchanges the
radiation of surfaces at these temperatures, which conserves heat. Source: Hottel and
Sarofim, Radiative Transfer (1967); Gebhart, Heat Transfer (1961).
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import (
    TimeVarying,
    device_array,
    is_traced,
    namespace,
    stacked,
    taken,
)
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ...memo.found import digest, found
from ...voxels.selection import AbstractSelection
from ..boundary import ImposedFlux
from ..flux_law import AbstractFluxLaw, Forcing, Values
from ..surface import BodySurface, Surface, spread
from ..term import AbstractExchangeTerm
from ..time_varying import for_jit, value_at
from .emission import (
    AbstractEmission,
    AbstractSurroundings,
    equilibrium_temperature,
    net_emission,
)
from .irradiation import Irradiation
from .patches import PatchedBody, group_patches, shares_of_patches
from .transfer import AbstractTransfer, transfer
from .view_factors import (
    DEFAULT_MAX_DIRECTIONS,
    MIN_DIRECTIONS,
    Sampling,
    ViewFactors,
    refined_view_factors,
    view_factors,
)


# Smallest emissivity of a patch: radiosity is undetermined between perfect mirrors.
_MIN_EMISSIVITY = 1e-6


class _Irradiated(AbstractEmission):
    """Heat flux H - sigma T^4 [W/m^2]."""

    exchanges = True

    received: Float[Any, "*#m"]
    """H - sigma T_0^4 [W/m^2]."""
    base: Float[Any, ""]
    """T_0 [K], the same for all bodies."""
    reference: Any = 0.0

    @override
    def flux(self, time, theta) -> Float[Array, "*#m"]:
        del time
        above = theta + (self.reference - self.base)
        return self.received - net_emission(self.reference + theta, self.base, above)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return STEFAN_BOLTZMANN * within.highest**4

    @override
    def supersolution(self, time, imposed) -> Float[Array, "*#m"]:
        del time
        absorbed = self.received + jnp.maximum(imposed, 0)
        return equilibrium_temperature(self.base, absorbed) - self.reference

    @override
    def irradiated(self, received: Float[Array, " m"], emits: bool) -> AbstractFluxLaw:
        # Without emission the flux does not depend on the surface's temperature.
        return replace(self, received=received) if emits else ImposedFlux(received)


class RadiativeExchange(AbstractExchangeTerm, AbstractSurroundings):
    """Radiation between grey diffuse bodies and with black surroundings.

    q = eps (H - sigma T^4) [W/m^2],    H = F J + F_s sigma T_s^4,
    J = eps sigma T^4 + (1 - eps) H

    The surface of each body is divided into patches, each with one irradiation H; the
    view factors F account for all obstacles. They are sampled by lines in more and
    more directions, which all bodies share, until an estimate of their error holds; it
    is in the receipt. Source:
    Hottel and Sarofim, Radiative Transfer (1967).

    Raises:
        InputError: for a negative temperature, or options out of range.
    """

    name = "emission"

    temperature: TimeVarying
    """T_s of the black surroundings [K], a number or a function of time; with `ground`,
    that of the sky."""
    ground: TimeVarying | None = None
    """Temperature below the horizon [K], a number or a function of time."""
    max_patches: int = eqx.field(static=True, default=128)
    """Largest number of patches of a body. All bodies together share ten times as many
    by their areas, with one for each side at least."""
    directions: int | None = eqx.field(static=True, default=None)
    """Number of directions in which view factors are sampled; None for the number
    that `error` requires."""
    error: float = eqx.field(static=True, default=0.01)
    """Largest estimated relative error of the exchange of a body [-]."""
    max_directions: int = eqx.field(static=True, default=DEFAULT_MAX_DIRECTIONS)
    """Number of directions at which sampling ends, whatever the estimate."""
    on: AbstractSelection | None = None
    """Part of the surface; the rest reflects, without absorbing or emitting heat."""

    def __check_init__(self):
        if not 0 < self.error < 1:
            raise InputError(
                f"RadiativeExchange(error={self.error!r}): give a fraction above 0 and "
                "below 1, such as 0.01"
            )
        if self.max_directions < MIN_DIRECTIONS:
            raise InputError(
                f"RadiativeExchange(max_directions={self.max_directions!r}): give "
                f"{MIN_DIRECTIONS} or more, such as {DEFAULT_MAX_DIRECTIONS}"
            )

    @override
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        zero = jnp.zeros((), surface.dtype)
        # The irradiation follows at every step from the enclosure.
        base = _references(surface).mean()
        law = _Irradiated(zero, jnp.asarray(base, surface.dtype))
        return (self._on_all(surface, [np.ones(n) for n in surface.counts], law),)

    @override
    def enclosure(self, surface: Surface) -> tuple["Enclosure", Sampling]:
        bodies = surface.bodies
        references = _references(surface)
        base = references.mean()
        # Fragments in contact keep a trace of their area, so that no patch has area 0.
        areas = [np.maximum(b.area, 1e-6 * b.grid.fragment_area) for b in bodies]
        sampled = self._views(bodies, areas)
        # What is not selected of a fragment reflects all that it receives.
        selected = np.concatenate([b.selected_fraction(self.on) for b in bodies])
        grey = surface.coefficient("emissivity") * selected.astype(surface.dtype)
        ground = self.ground
        upward = np.concatenate([b.normal[:, 2] for b in bodies])
        enclosure = _enclosure(
            sampled.views,
            patch=sampled.patch,
            area=np.concatenate(areas),
            emissivity=grey,
            upward=None if ground is None else upward,
            base=jnp.asarray(base, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
            ground=None if ground is None else for_jit(ground, surface.dtype),
            above=spread(references - base, surface.counts, surface.dtype),
        )
        return enclosure, sampled.sampling

    def _views(
        self, bodies: tuple[BodySurface, ...], areas: list[Float[np.ndarray, " _"]]
    ) -> "_SampledViews":
        options = (self.max_patches, self.directions, self.error, self.max_directions)
        poses = tuple(b.pose.key for b in bodies)
        occluders = bodies[0].occluders
        at_rest = tuple(n for o in occluders if not o.moves for n in o.bodies)
        content = poses, at_rest, tuple(digest(area) for area in areas)
        return found(
            tuple(b.grid for b in bodies),
            by=("view_factors", options, *content),
            find=lambda: self._sampled_views(bodies, areas, at_rest),
            search="view factors",
        )

    def _sampled_views(
        self,
        bodies: tuple[BodySurface, ...],
        areas: list[Float[np.ndarray, " _"]],
        at_rest: tuple[int, ...],
    ) -> "_SampledViews":
        patched = []
        numbers = []
        first = 0
        shares = shares_of_patches(
            np.array([area.sum() for area in areas]), self.max_patches
        )
        for body, area, share in zip(bodies, areas, shares, strict=True):
            patches = group_patches(body.grid, area=area, max_patches=int(share))
            patched.append(PatchedBody.of_grid(body.grid, patches, body.pose))
            numbers.append(patches.patch + first)
            first += patches.count
        if self.directions is None:
            views, sampling = refined_view_factors(
                tuple(patched),
                error=self.error,
                max_directions=self.max_directions,
                at_rest=at_rest,
            )
        else:
            views = view_factors(tuple(patched), self.directions, at_rest=at_rest)
            sampling = Sampling(self.directions, error=np.nan, limit=self.error)
            sampling = sampling.of(views)
        return _SampledViews(views, sampling=sampling, patch=np.concatenate(numbers))


class _SampledViews(NamedTuple):
    """View factors of the patches of all bodies."""

    views: ViewFactors
    sampling: Sampling
    patch: Int[np.ndarray, " s"]
    """Patch of each fragment, bodies concatenated."""


def _references(surface: Surface) -> Float[Values, " b"]:
    """References of the bodies, whose mean is T_0 [K].

    One array: operations on each of them would be compiled again wherever they are
    read.
    """
    is_known = not is_traced(surface.references)
    return stacked(surface.references, float if is_known else surface.dtype)


class Enclosure(Module):
    """Radiation among the surface cells of all bodies and with black surroundings."""

    patch: Int[Array, " s"]
    """Patch of each cell, bodies concatenated."""
    weight: Float[Array, " s"]
    """Fraction of its patch's emission by each cell at one temperature [-]."""
    transfer: AbstractTransfer
    """Irradiation of each patch for the emission of all."""
    from_surroundings: Float[Array, " p"]
    """k_s [-]: of the surroundings, or of the sky alone if there is a ground."""
    from_ground: Float[Array, " p"] | None
    """k of a ground [-]; with k_s and the row of K it adds up to 1."""
    base: Float[Array, ""]
    """T_0 [K]."""
    temperature: Any
    """T_s of the surroundings, or of the sky [K]."""
    ground: Any
    """Temperature below the horizon [K]; None if it is T_s."""
    above: Float[Any, "*#s"]
    """Reference of each cell minus T_0 [K]."""

    def escaping(self) -> Float[Array, " s"]:
        """Fraction of the emission of each cell that ends in the surroundings [-]."""
        fraction = self.from_surroundings
        if self.from_ground is not None:
            fraction = fraction + self.from_ground
        return taken(fraction, self.patch)

    def _emitted(self, above: Float[Array, "*s"]) -> Float[Array, "*s"]:
        # sigma (T^4 - T_0^4) at T = T_0 + `above` [W/m^2].
        return net_emission(self.base + above, self.base, above)

    def _received(
        self, time: Float[Array, ""], emitted: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        around = self._emitted(value_at(self.temperature, time) - self.base)
        # The emission of a patch is the sum over its cells, so that no heat is lost.
        count = len(self.from_surroundings)
        by_patch = jax.ops.segment_sum(self.weight * emitted, self.patch, count)
        heat = self.transfer.irradiation(by_patch) + self.from_surroundings * around
        if self.from_ground is not None:
            below = self._emitted(value_at(self.ground, time) - self.base)
            heat = heat + self.from_ground * below
        return taken(heat, self.patch)

    def irradiation(
        self, time: Float[Array, ""], theta: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        """H - sigma T_0^4 on surface cells at temperatures `theta` [W/m^2]."""
        return self._received(time, self._emitted(theta + self.above))

    def net(
        self, time: Float[Array, ""], theta: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        """Irradiation minus emission of surface cells [W/m^2]."""
        emitted = self._emitted(theta + self.above)
        return self._received(time, emitted) - emitted

    def coarsened(
        self, cell: Int[np.ndarray, " s"], counts: tuple[int, ...]
    ) -> "Enclosure":
        """Exchange on cells that each combine fragments of one patch, -1 for none."""
        # The patches remain, and with them their exchange; only the weights are summed.
        cells = sum(counts)
        fragments = np.flatnonzero(cell >= 0)
        target = cell[fragments]
        weight = self.weight
        if is_traced(weight):
            empty = jnp.zeros(cells, weight.dtype)
            weight = empty.at[target].add(weight[fragments])
        else:
            sums = np.bincount(target, np.asarray(weight)[fragments], cells)
            weight = device_array(sums, weight.dtype)
        # All fragments of a cell have one patch and one reference.
        fragment = np.zeros(cells, int)
        fragment[target] = fragments
        above = self.above
        if above.ndim:
            above = device_array(namespace(above).asarray(above)[fragment])
        return replace(
            self,
            patch=device_array(np.asarray(self.patch)[fragment]),
            weight=weight,
            above=above,
        )


def _enclosure(
    views: ViewFactors,
    patch: Int[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    emissivity: Float[Values, " s"],
    upward: Float[np.ndarray, " s"] | None = None,
    ground: Any = None,
    **temperatures: Any,
) -> Enclosure:
    """Exchange of fragments, by their area [m^2], and the view factors of patches.

    With a ground, `upward` is the vertical component of the fragments' normals.
    """
    # Gradients pass through the emissivities.
    traced = is_traced(emissivity)
    xp = namespace(emissivity)
    dtype = emissivity.dtype if traced else float
    emitting = xp.asarray(area, dtype) * xp.maximum(
        xp.asarray(emissivity, dtype), _MIN_EMISSIVITY
    )
    count = len(views.area)
    if traced:
        grey = jax.ops.segment_sum(emitting, jnp.asarray(patch), count)
    else:
        grey = np.bincount(patch, emitting, count)
    mean = xp.asarray(grey / xp.asarray(views.area, dtype), dtype)
    around = views.to_surroundings[:, None]
    if upward is not None:
        around = around * _halves(views, patch=patch, area=area, upward=upward).T
    exchanged = transfer(views, emissivity=mean, around=around, dtype=emissivity.dtype)
    # Cells are built from it on the host, also while the emissivity is traced.
    with jax.ensure_compile_time_eval():
        host_patch = device_array(patch, jnp.int32)
    return Enclosure(
        patch=host_patch,
        weight=device_array(emitting / grey[patch], emissivity.dtype),
        transfer=exchanged.between,
        from_surroundings=exchanged.around[:, 0],
        from_ground=None if upward is None else exchanged.around[:, 1],
        ground=ground,
        **temperatures,
    )


def _halves(
    views: ViewFactors,
    patch: Int[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    upward: Float[np.ndarray, " s"],
) -> Float[np.ndarray, "2 p"]:
    """Fractions of each patch's surroundings that are sky and ground [-]."""
    # Without obstacles the view factors are exactly (1 + n_z) / 2 and (1 - n_z) / 2;
    # only the visible fraction of each is sampled.
    up = np.bincount(patch, area * (1 + upward) / 2, len(views.area))
    down = np.bincount(patch, area * (1 - upward) / 2, len(views.area))
    seen = np.stack([up, down]) * (1.0 if views.visible is None else views.visible)
    total = seen.sum(0)
    return np.where(total > 0, seen / np.where(total > 0, total, 1.0), 0.5)
