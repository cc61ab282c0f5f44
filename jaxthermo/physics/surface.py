"""Surface of a scene, as terms find it, and what they become when bound to it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, is_traced, typed_array
from ..errors import InputError
from ..findings import found, is_finding
from ..geometry.mesh import Pose
from ..voxels.grid import VoxelGrid
from ..voxels.selection import AbstractSelection
from .flux_law import AbstractFluxLaw, Forcing, Values


class Omitted(NamedTuple):
    """The reason why a term does not act on a body; on any of them if none is named."""

    reason: str
    body: int | None = None


class Binding(NamedTuple):
    """A law on the surface of the scene."""

    effective_area: Float[Values, " s"]
    """As in `BoundTerm`, per fragment."""
    acts: Bool[np.ndarray, " s"]
    """False where the effective area is 0; known even where the area is traced."""
    law: AbstractFluxLaw
    notes: tuple[tuple[int, str], ...] = ()
    """Remarks on the validity of the law, by body, for the receipt."""


@dataclass(frozen=True, eq=False)
class BodySurface:
    """The surface fragments of one body at its present pose."""

    body: int
    """Number of the body in the scene."""
    grid: VoxelGrid
    """In the body's own frame, which `Side` and `Region` refer to."""
    pose: Pose
    position: Float[np.ndarray, "s 3"]
    """World [m]."""
    normal: Float[np.ndarray, "s 3"]
    """World, outward."""
    area: Float[np.ndarray, " s"]
    """True area that nothing touches [m^2]."""
    exposed_fraction: Float[np.ndarray, " s"]
    """Fraction of each fragment that nothing touches [-]."""
    natural: Bool[np.ndarray, " s"]
    """Fragments with a natural boundary: exposed, no temperature prescribed."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    emissivity: Float[Values, "*#s"]
    absorptivity: Float[Values, "*#s"]
    scene_triangles: Float[np.ndarray, "f 3 3"]
    """Triangles of every body, world [m]: what may cast a shadow."""
    dtype: Any
    enclosed: Bool[np.ndarray, " s"] | None = None
    """Fragments in a closed cavity, which nothing from outside reaches, if any."""
    prune: bool = True
    """False to keep terms that have no effect, for tests."""

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    @property
    def own_position(self) -> Float[np.ndarray, "s 3"]:
        """In the body's own frame [m]."""
        return self.grid.fragment_position

    @property
    def own_normal(self) -> Float[np.ndarray, "s 3"]:
        """In the body's own frame, outward."""
        return self.grid.fragment_normal

    def omitted(self, reason: str) -> Omitted:
        """An omission on this body."""
        return Omitted(reason, self.body)

    def selected(self, on: AbstractSelection | None) -> Bool[np.ndarray, " s"]:
        """Fragments that `on` selects; all of them for None.

        Raises:
            InputError: if it names this body and selects none of its surface.
        """
        if on is None:
            return np.ones(len(self.own_position), bool)
        own = on.on_body(self.body)
        if own is None:
            return np.zeros(len(self.own_position), bool)
        chosen = own.select(self.own_position, self.own_normal)
        if not chosen.any():
            raise InputError(
                f"on={own!r} selects no surface of body {self.body}: check its corners "
                "or its normal, which are in the body's own frame, in metres"
            )
        return chosen

    def exposed(
        self, on: AbstractSelection | None = None
    ) -> Bool[np.ndarray, " s"] | Omitted:
        """Selected fragments that have a natural boundary."""
        # All of it is the same array in all runs, and so is what is found of it.
        acting = self.natural
        # The reasons are those of the receipt, in the order that a user would check.
        if on is not None:
            chosen = self.selected(on)
            if self.prune and not chosen.any():
                return self.omitted("`on` is on another body")
            acting = chosen & self.natural
        if self.prune and not acting.any():
            closed = "" if self.enclosed is None else " or lies in a closed cavity"
            return self.omitted(f"all of its surface is held at a temperature{closed}")
        return acting


Cover = tuple[Float[Values, " _"], Bool[np.ndarray, " _"]]
# Effective area of the fragments of one body, and where it may be other than 0.


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a scene: the fragments of all bodies, one body after the other."""

    bodies: tuple[BodySurface, ...]
    references: tuple[Scalar, ...]
    """Temperature from which the state of each body counts [K]."""
    temperatures: Forcing | None = None
    """Bounds of all temperatures up to `end`; None if they are not known."""
    end: float | int = 0.0
    """End of the run [s]."""

    @property
    def dtype(self) -> Any:
        """Type of the state."""
        return self.bodies[0].dtype

    @property
    def prune(self) -> bool:
        """False to keep terms that have no effect, for tests."""
        return self.bodies[0].prune

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of fragments of each body."""
        return tuple(len(body.area) for body in self.bodies)

    @cached_property
    def body(self) -> Int[np.ndarray, " s"]:
        """Number of the body of each fragment."""
        return np.repeat(np.arange(len(self.bodies)), self.counts)

    @cached_property
    def outside(self) -> "Surface":
        """The surface without closed cavities, for terms from outside."""
        if all(body.enclosed is None for body in self.bodies):
            return self
        bodies = tuple(
            body
            if body.enclosed is None
            else dataclasses.replace(body, natural=body.natural & ~body.enclosed)
            for body in self.bodies
        )
        return dataclasses.replace(self, bodies=bodies)

    @cached_property
    def reference(self) -> Float[Values, "*#s"]:
        """Reference temperature per fragment [K]; one number if all are equal."""
        return spread(self.references, self.counts, self.dtype)

    def apart(self, values: Any) -> list[Any]:
        """Values of each body's fragments, which are on the last axis."""
        if len(self.bodies) == 1:
            return [values]
        # Traced values, such as a fitted emissivity, stay on the device.
        ends = np.cumsum(self.counts)[:-1]
        own: Any = jnp if is_traced(values) else np
        return own.split(values, ends, axis=-1)

    def bind(
        self,
        law: AbstractFluxLaw,
        covers: Sequence[Cover | Omitted] | None = None,
        on: AbstractSelection | None = None,
        notes: tuple[tuple[int, str], ...] = (),
    ) -> tuple[Binding | Omitted, ...]:
        """A law bound to the fragments where it acts, and the bodies without it.

        Args:
            law: for all bodies.
            covers: effective area of each body's fragments, and where they act; None
                for the exposed area that `on` selects.
            on: a selection of the surface; None for all of it.
            notes: on the validity of the law, by body.
        """
        if covers is None:
            found = [(body, body.exposed(on)) for body in self.bodies]
            covers = [e if isinstance(e, Omitted) else (b.area, e) for b, e in found]
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        # Several snapshots need the same bindings, whether they act or not.
        if self.prune and len(omitted) == len(self.bodies):
            return tuple(omitted)
        # Bodies without the term have no area: one law and one array for the scene.
        areas, acts = [], []
        for body, cover in zip(self.bodies, covers, strict=True):
            nowhere = np.zeros(len(body.area), bool)
            area, where = (body.area, nowhere) if isinstance(cover, Omitted) else cover
            # The whole surface has its own array, the same in all runs.
            if not where.all():
                area = _within(area, where)
            areas.append(area)
            acts.append(where)
        binding = Binding(
            effective_area=concatenated(areas),
            acts=concatenated(acts),
            law=law.above(self.reference),
            notes=notes,
        )
        return (binding, *omitted)


def _within(area: Any, where: Bool[np.ndarray, " s"]) -> Any:
    """Areas where a term acts, 0 elsewhere."""
    if not isinstance(area, np.ndarray):
        return jnp.where(where, area, 0)
    by = "within" if is_finding(area, where) else None
    return found((area, where), by, lambda: np.where(where, area, np.zeros_like(area)))


def spread(values: Sequence[Any], counts: Sequence[int], dtype: Any) -> Any:
    """Values of bodies at each of their cells; one number where all are equal."""
    # One number where bodies count from one temperature: no array for the time loop.
    same = not is_traced(values) and len({float(value) for value in values}) == 1
    if same or len(values) == 1:
        return typed_array(values[0], dtype)
    own: Any = jnp if is_traced(values) else np
    pairs = zip(values, counts, strict=True)
    return own.concatenate([own.full(n, own.asarray(v, dtype)) for v, n in pairs])


def concatenated(values: Sequence[Any], axis: int = -1) -> Any:
    """Arrays one after the other, on the host where none is traced."""
    if len(values) == 1:
        return values[0]
    return (jnp if is_traced(values) else np).concatenate(values, axis)
