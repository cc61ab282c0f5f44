"""Radiative exchange between bodies and with the surroundings, as a term.

It replaces `Surroundings` where bodies, or parts of one, see each other:

    q = eps (H - E),    J = eps E + (1 - eps) H,    H = F J + F_s E_s,

with the emissive power E = sigma T^4, the radiosity J and the irradiation H of each
patch. H = K E + k_s E_s is solved once, before the run; the rows of K and k_s add up to
1, as they do with a third factor for a ground. Every fragment receives the irradiation
of its patch and emits at its own temperature. Each step first finds the surface
temperatures for the irradiation of surfaces at node temperature, then exchanges the
radiation of surfaces at these temperatures, which conserves heat. Source: Hottel and
Sarofim, Radiative Transfer (1967); Gebhart, Heat Transfer (1961).
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import TimeVarying, device_array, is_traced, product, taken
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ...findings import digest, found
from ...module import Module
from ...voxels.selection import AbstractSelection
from ..boundary import ImposedFlux, either, toward
from ..flux_law import AbstractFluxLaw, Forcing, Values
from ..surface import BodySurface, Surface, spread
from ..term import AbstractExchangeTerm
from ..time_varying import check_value, for_jit, value_at
from .emission import AbstractEmission, equilibrium_temperature, net_emission
from .irradiation import AbstractRadiativeTerm, Irradiation
from .patches import PatchedBody, group_patches
from .refinement import (
    DEFAULT_MAX_DIRECTIONS,
    MIN_DIRECTIONS,
    Sampling,
    refined_view_factors,
)
from .view_factors import ViewFactors, view_factors


# Smallest emissivity of a patch: radiosity is undetermined between perfect mirrors.
_MIN_EMISSIVITY = 1e-6


class _Irradiated(AbstractEmission):
    """Heat flux H - sigma T^4 [W/m^2]."""

    received: Float[Array, "*#m"]
    """H - sigma T_0^4 [W/m^2]."""
    base: Float[Array, ""]
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
        brought = self.received + jnp.maximum(imposed, 0)
        return equilibrium_temperature(self.base, brought) - self.reference

    @override
    def irradiated(self, received: Float[Array, " m"], emits: bool) -> AbstractFluxLaw:
        # The net flux does not depend on the temperature of the surface any more.
        return replace(self, received=received) if emits else ImposedFlux(received)


class RadiativeExchange(AbstractExchangeTerm, AbstractRadiativeTerm):
    """Radiation between grey diffuse bodies and with black surroundings.

    q = eps (H - sigma T^4) [W/m^2],    H = F J + F_s sigma T_s^4,
    J = eps sigma T^4 + (1 - eps) H

    The surface of each body is divided into patches, each with one irradiation H; the
    view factors F account for all obstacles. They are sampled in more and more
    directions until an estimate of their error holds; it is in the receipt. Source:
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
    """Largest number of patches of a body."""
    directions: int | None = eqx.field(static=True, default=None)
    """Number of directions in which view factors are sampled; None for as many as
    `error` needs."""
    error: float = eqx.field(static=True, default=0.01)
    """Largest estimated relative error of the exchange of a body [-]."""
    max_directions: int = eqx.field(static=True, default=DEFAULT_MAX_DIRECTIONS)
    """Number of directions at which sampling ends, whatever the estimate."""
    on: AbstractSelection | None = None
    """Part of the surface; what remains reflects, without taking or giving heat."""

    def __check_init__(self):
        check_value(self.temperature, "RadiativeExchange(temperature [K])", 0.0)
        if self.ground is not None:
            check_value(self.ground, "RadiativeExchange(ground [K])", 0.0)
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
    def forcing(self, end: float | int) -> Forcing:
        return either([toward(value, end) for value in self.values])

    @property
    @override
    def horizon(self) -> tuple[Any, Any]:
        ground = self.temperature if self.ground is None else self.ground
        return self.temperature, ground

    @override
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        zero = jnp.zeros((), surface.dtype)
        # What the surface receives is found at every step.
        law = _Irradiated(zero, jnp.asarray(_base(surface), surface.dtype))
        return (self._on_all(surface, [np.ones(n) for n in surface.counts], law),)

    @override
    def enclosure(self, surface: Surface) -> tuple["Enclosure", Sampling]:
        bodies, base = surface.bodies, _base(surface)
        # Fragments in contact keep a trace of their area, so that no patch has area 0.
        areas = [np.maximum(b.area, 1e-6 * b.grid.fragment_area) for b in bodies]
        views, sampling, patch = self._views(bodies, areas)
        # What exchanges no heat reflects all that it receives.
        takes_part = [b.selected(self.on).astype(b.dtype) for b in bodies]
        pairs = zip(bodies, takes_part, strict=True)
        grey = [body.emissivity * part for body, part in pairs]
        ground = self.ground
        upward = np.concatenate([b.normal[:, 2] for b in bodies])
        enclosure = _enclosure(
            views,
            patch=patch,
            area=np.concatenate(areas),
            emissivity=(jnp if is_traced(grey) else np).concatenate(grey),
            upward=None if ground is None else upward,
            base=jnp.asarray(base, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
            ground=None if ground is None else for_jit(ground, surface.dtype),
            above=spread(
                [reference - base for reference in surface.references],
                surface.counts,
                surface.dtype,
            ),
        )
        return enclosure, sampling

    def _views(
        self, bodies: tuple[BodySurface, ...], areas: list[Float[np.ndarray, " _"]]
    ) -> tuple[ViewFactors, Sampling, Int[np.ndarray, " s"]]:
        """View factors of the patches of all bodies, and the patch of each fragment."""
        options = self.max_patches, self.directions, self.error, self.max_directions
        poses = tuple((b.pose.translation, b.pose.rotation) for b in bodies)
        return found(
            tuple(b.grid for b in bodies),
            by=("view_factors", options, poses, tuple(digest(area) for area in areas)),
            find=lambda: self._sampled_views(bodies, areas),
            search="view factors",
        )

    def _sampled_views(
        self, bodies: tuple[BodySurface, ...], areas: list[Float[np.ndarray, " _"]]
    ) -> tuple[ViewFactors, Sampling, Int[np.ndarray, " s"]]:
        patches = [
            group_patches(
                *(b.own_position, b.own_normal, area, b.grid.lattice),
                *(self.max_patches, b.grid.cavities),
            )
            for b, area in zip(bodies, areas, strict=True)
        ]
        patched = tuple(
            PatchedBody.of_mesh(b.grid.mesh, own, b.pose)
            for b, own in zip(bodies, patches, strict=True)
        )
        first = np.cumsum([0, *(own.count for own in patches)])
        if self.directions is None:
            asked = self.error, self.max_directions
            views, sampling = refined_view_factors(patched, *asked)
        else:
            views = view_factors(patched, self.directions)
            sampling = Sampling(self.directions, np.nan, self.error)
        pairs = zip(patches, first, strict=False)
        return views, sampling, np.concatenate([p.patch + n for p, n in pairs])


def _base(surface: Surface) -> Any:
    """T_0, the mean of the bodies' references [K]."""
    return sum(surface.references) / len(surface.references)


class Enclosure(Module):
    """Radiation among the surface cells of all bodies and with black surroundings."""

    patch: Int[Array, " s"]
    """Patch of each cell, bodies concatenated."""
    weight: Float[Array, " s"]
    """Fraction of its patch's emission by each cell at one temperature [-]."""
    transfer: Float[Array, "p p"]
    """K [-]: irradiation of each patch for a unit of emissive power of another."""
    from_surroundings: Float[Array, " p"]
    """k_s [-], of the sky alone if there is a ground."""
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

    def _emitted(self, above: Float[Array, "*s"]) -> Float[Array, "*s"]:
        # Sigma (T^4 - T_0^4) at T_0 + `above`.
        return net_emission(self.base + above, self.base, above)

    def _received(
        self, time: Float[Array, ""], emitted: Float[Array, " s"]
    ) -> Float[Array, " s"]:
        around = self._emitted(value_at(self.temperature, time) - self.base)
        # A patch emits what its cells emit, so that no heat is lost between the two.
        count = len(self.from_surroundings)
        by_patch = jax.ops.segment_sum(self.weight * emitted, self.patch, count)
        heat = product(self.transfer, by_patch) + self.from_surroundings * around
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
        # The patches remain, and with them the matrix K; only the weights are summed.
        kept, cells = np.flatnonzero(cell >= 0), sum(counts)
        patch = np.zeros(cells, np.int32)
        patch[cell[kept]] = np.asarray(self.patch)[kept]
        above, weight = self.above, self.weight
        if is_traced(weight):
            none = jnp.zeros(cells, weight.dtype)
            weight = none.at[cell[kept]].add(weight[kept])
        else:
            sums = np.bincount(cell[kept], np.asarray(weight)[kept], cells)
            weight = device_array(sums, weight.dtype)
        if above.ndim and is_traced(above):
            above = jnp.zeros(cells, above.dtype).at[cell[kept]].set(above[kept])
        elif above.ndim:
            rows = np.zeros(cells, above.dtype)
            rows[cell[kept]] = np.asarray(above)[kept]
            above = device_array(rows)
        return replace(self, patch=device_array(patch), weight=weight, above=above)


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
    # Gradients pass through the emissivities; what is not traced is solved on the host,
    # in double precision.
    xp: Any = jnp if is_traced(emissivity) else np
    wide = emissivity if xp is jnp else np.asarray(emissivity, float)
    cast = lambda values: xp.asarray(values, wide.dtype)
    emitting = cast(area) * xp.maximum(wide, _MIN_EMISSIVITY)
    if xp is jnp:
        grey = jax.ops.segment_sum(emitting, jnp.asarray(patch), len(views.area))
    else:
        grey = np.bincount(patch, emitting, len(views.area))
    mean, factor, outside = map(
        cast, (grey / cast(views.area), views.factor, views.to_surroundings)
    )
    reflection = xp.eye(len(mean), dtype=factor.dtype) - factor * (1 - mean)[None]
    around = outside[:, None]
    if upward is not None:
        around = around * cast(_halves(views, patch=patch, area=area, upward=upward)).T
    sources = xp.concatenate([factor * mean[None], around], axis=1)
    solved = xp.linalg.solve(reflection, sources)
    count = len(mean)
    output = lambda values: device_array(values, emissivity.dtype)
    # Cells are found from it while a function of the emissivity is compiled.
    with jax.ensure_compile_time_eval():
        known = device_array(patch, jnp.int32)
    return Enclosure(
        patch=known,
        weight=output(emitting / grey[patch]),
        transfer=output(solved[:, :count]),
        from_surroundings=output(solved[:, count]),
        from_ground=None if upward is None else output(solved[:, count + 1]),
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
    every = seen.sum(0)
    return np.where(every > 0, seen / np.where(every > 0, every, 1.0), 0.5)
