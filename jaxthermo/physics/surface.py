"""Surface of a scene, as it is passed to terms, and the bindings that they return."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from equinox import Module
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, is_traced, namespace, stacked, typed_array
from ..errors import InputError
from ..geometry.mesh import Pose
from ..geometry.vectors import row_length, unit_vectors
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.cavities import AbstractCavities
from ..voxels.fractions import area_fractions
from ..voxels.fragment_pieces import Facing, FragmentPieces
from ..voxels.selection import AbstractSelection
from .flux_law import AbstractFluxLaw, Forcing, Values
from .occluder import Occluder, joined_triangles
from .together import found_between


class Omitted(NamedTuple):
    """Reason why a term does not act on a body, or on any if `body` is None."""

    reason: str
    body: int | None = None


class Note(Module):
    """A remark on the validity of a law on one body, for the receipt."""

    body: int = eqx.field(static=True)
    text: Callable[[Any], tuple[str, ...]] = eqx.field(static=True)
    """Its lines, from the numbers."""
    numbers: Float[Any, "..."] = ()
    """Numbers that the lines depend on; traced where the scene is."""

    @classmethod
    def of_line(cls, body: int, line: str) -> "Note":
        """A remark that depends on no numbers."""
        return cls(body, partial(_unchanged, line))

    def lines(self) -> tuple[str, ...]:
        """Its lines; none where the numbers are not known."""
        return () if is_traced(self.numbers) else self.text(np.asarray(self.numbers))


def _unchanged(line: str, _: Any) -> tuple[str, ...]:
    return (line,)


class Binding(NamedTuple):
    """A law on the surface of the scene."""

    effective_area: Float[Values, " s"]
    """Effective area of each fragment, as in `BoundTerm` [m^2]."""
    acting: Bool[np.ndarray, " s"]
    """False where the effective area is 0; known even where the area is traced."""
    law: AbstractFluxLaw
    notes: tuple[Note, ...] = ()
    """Remarks on the validity of the law, for the receipt."""


# Largest sum of the fractions of a fragment that two terms select side by side, which
# have the areas of the mesh and not of the fragment.
_MAX_SIDE_BY_SIDE = 1.25


def overlap(
    first: Float[np.ndarray, " s"], second: Float[np.ndarray, " s"]
) -> Bool[np.ndarray, " s"]:
    """True where two terms act on one piece of a fragment, by the fractions of it."""
    return (first > 0) & (second > 0) & (first + second > _MAX_SIDE_BY_SIDE)


@dataclass(frozen=True, eq=False)
class BodySurface:
    """The surface fragments of one body at its present pose."""

    body: int
    """Number of the body in the scene."""
    grid: AbstractGrid
    """Surface in the body's own frame, which `Side` and `Region` refer to."""
    pose: Pose
    position: Float[np.ndarray, "s 3"]
    """Centres of the fragments in the world [m]."""
    normal: Float[np.ndarray, "s 3"]
    """Outward unit normals in the world."""
    area: Float[np.ndarray, " s"]
    """True area of each fragment that nothing touches [m^2]."""
    exposed_fraction: Float[np.ndarray, " s"]
    """Fraction of each fragment that nothing touches [-]."""
    natural: Bool[np.ndarray, " s"]
    """Fragments with a natural boundary: exposed, no temperature prescribed."""
    emissivity: Float[Values, "*#s"]
    absorptivity: Float[Values, "*#s"]
    occluders: tuple[Occluder, ...]
    """All bodies of the scene: what may block a line of sight."""
    dtype: Any
    enclosing: Int[np.ndarray, " s"] | None = None
    """Number of the body in whose closed cavity each fragment is, -1 for none; None if
    all are outside."""
    prune: bool = True
    """False to keep terms that have no effect, for tests."""

    @cached_property
    def enclosed(self) -> Bool[np.ndarray, " s"] | None:
        """Fragments in closed cavities, which nothing from outside reaches.

        None if there are none.
        """
        return None if self.enclosing is None else self.enclosing >= 0

    @property
    def scene_triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Triangles of every body, world [m]; the same array in every run."""
        return joined_triangles([occluder.triangles for occluder in self.occluders])

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    @property
    def own_position(self) -> Float[np.ndarray, "s 3"]:
        """Centres of the fragments in the body's own frame [m]."""
        return self.grid.fragment_position

    @property
    def own_normal(self) -> Float[np.ndarray, "s 3"]:
        """Outward unit normals in the body's own frame."""
        return self.grid.fragment_normal

    @cached_property
    def _open(self) -> Bool[np.ndarray, " s"]:
        """Fragments with a natural boundary that terms without a selection reach."""
        reached = self.grid.reached_by(None)
        return self.natural if reached is None else self.natural & reached

    @cached_property
    def _pieces(self) -> FragmentPieces | None:
        """Pieces of curved fragments, with their normals in the world."""
        pieces = self.grid.pieces
        if pieces is None:
            return None
        return pieces._replace(normal=self.pose.rotate(pieces.normal))

    def facing(self, towards: Float[np.ndarray, "#s 3"] | None) -> Facing:
        """Part of each fragment that faces a direction, of any length; None for all.

        A curved fragment may face it in part only.
        """
        if towards is None or self._pieces is None:
            return Facing(normal=self.normal, fraction=1.0)
        vectors = self._pieces.facing(towards, len(self.normal))
        fraction = row_length(vectors)
        turned = np.where(fraction[:, None] > 0, unit_vectors(vectors), self.normal)
        return Facing(normal=turned, fraction=fraction)

    def omitted(self, reason: str) -> Omitted:
        """An omission on this body."""
        return Omitted(reason, self.body)

    def selected(self, on: AbstractSelection | None) -> Bool[np.ndarray, " s"]:
        """Fragments that `on` selects; for None all of them but adiabatic ones.

        Raises:
            InputError: if it names this body and selects none of its surface.
        """
        if on is None:
            reached = self.grid.reached_by(None)
            return np.ones(len(self.own_position), bool) if reached is None else reached
        selection = on.on_body(self.body)
        if selection is None:
            return np.zeros(len(self.own_position), bool)
        selected = selection.select(self.grid.fragment_centres)
        reached = self.grid.reached_by(selection)
        if reached is not None:
            selected = selected & reached
        if not selected.any():
            raise InputError(
                f"on={selection!r} selects no surface of body {self.body}: check its "
                "corners or its normal, which are in the body's own frame, in metres"
            )
        return selected

    def selected_fraction(
        self, on: AbstractSelection | None
    ) -> Float[np.ndarray, " s"] | Bool[np.ndarray, " s"]:
        """Fraction of each fragment that `on` selects; flags where all are 0 or 1.

        Raises:
            InputError: if it names this body and selects none of its surface.
        """
        selection = None if on is None else on.on_body(self.body)
        if selection is None:
            return self.selected(on)
        fraction = area_fractions(selection, self.grid)
        if not fraction.any():
            # Raises the error.
            return self.selected(on)
        is_partial = (fraction > 0) & (fraction < 1)
        return fraction if is_partial.any() else fraction > 0

    def exposed(
        self, on: AbstractSelection | None = None
    ) -> Bool[np.ndarray, " s"] | Omitted:
        """Fragments whose centre is selected and that have a natural boundary."""
        return self.exposed_of(None if on is None else self.selected(on))

    def exposed_of(
        self, selected: Bool[np.ndarray, " s"] | None
    ) -> Bool[np.ndarray, " s"] | Omitted:
        """Fragments among the selected ones that have a natural boundary."""
        # Without a selection this is the stored array itself, by whose identity the
        # results that were computed from it are recognized.
        acting = self._open
        # The reasons are those of the receipt, in the order that a user would check.
        if selected is not None:
            if self.prune and not selected.any():
                return self.omitted("`on` is on another body")
            acting = selected & self.natural
        if self.prune and not acting.any():
            closed = "" if self.enclosed is None else " or lies in a closed cavity"
            return self.omitted(f"all of its surface is held at a temperature{closed}")
        return acting

    def cover(
        self, area: Float[Values, " s"], on: AbstractSelection | None = None
    ) -> "Cover | Omitted":
        """Effective area of all fragments, and those that are selected and exposed.

        A fragment that `on` divides has that fraction of its effective area.
        """
        if on is None:
            exposed = self.exposed()
        else:
            fraction = self.selected_fraction(on)
            exposed = self.exposed_of(fraction > 0)
            if fraction.dtype != bool:
                area = area * fraction.astype(area.dtype)
        return exposed if isinstance(exposed, Omitted) else (area, exposed)


Cover = tuple[Float[Values, " _"], Bool[np.ndarray, " _"]]
# Effective area of the fragments of one body, and where it may be other than 0.


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a scene: the fragments of all bodies, one body after the other."""

    bodies: tuple[BodySurface, ...]
    references: tuple[Scalar, ...]
    """Temperature from which the state of each body counts [K]."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
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

    @cached_property
    def natural(self) -> Bool[np.ndarray, " s"]:
        """Fragments with a natural boundary: exposed, no temperature prescribed."""
        return concatenated([body.natural for body in self.bodies])

    def coefficient(self, name: str) -> Float[Values, "*#s"]:
        """Emissivity or absorptivity per fragment [-]; one number if all are equal."""
        values = [getattr(body, name) for body in self.bodies]
        return spread(values, self.counts, self.dtype)

    def apart(self, values: Any) -> list[Any]:
        """Values of each body's fragments, which are on the last axis."""
        if len(self.bodies) == 1:
            return [values]
        # Traced values, such as a fitted emissivity, stay on the device.
        ends = np.cumsum(self.counts)[:-1]
        return namespace(values).split(values, ends, axis=-1)

    def bind(
        self,
        law: AbstractFluxLaw,
        covers: Sequence[Cover | Omitted] | None = None,
        on: AbstractSelection | None = None,
        notes: tuple[Note, ...] = (),
    ) -> tuple[Binding | Omitted, ...]:
        """A law bound to the fragments where it acts, and the bodies without it.

        Args:
            law: for all bodies.
            covers: effective area of each body's fragments, and where they act; None
                for the exposed area that `on` selects.
            on: a selection of the surface; None for all of it.
            notes: on the validity of the law.
        """
        if covers is None:
            covers = [body.cover(body.area, on) for body in self.bodies]
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        # Several snapshots need the same bindings, whether they act or not.
        if self.prune and len(omitted) == len(self.bodies):
            return tuple(omitted)
        # Bodies without the term have no area: one law and one array for the scene.
        areas = []
        masks = []
        for body, cover in zip(self.bodies, covers, strict=True):
            if isinstance(cover, Omitted):
                cover = (body.area, np.zeros(len(body.area), bool))
            area, mask = cover
            # Where all fragments take part, the body's own array serves as it is.
            if not mask.all():
                area = namespace(area).where(mask, area, 0)
            areas.append(area)
            masks.append(mask)
        binding = Binding(
            effective_area=concatenated(areas),
            acting=concatenated(masks),
            law=law.above(self.reference),
            notes=notes,
        )
        return (binding, *omitted)


def spread(
    values: Sequence[Any] | Float[Values, " b"], counts: Sequence[int], dtype: Any
) -> Any:
    """Values of bodies at each of their cells; one number where all are equal."""
    # Bodies that count from one temperature need no array in the time loop.
    same = (
        not is_traced(values) and len(set(np.concatenate(values, None).tolist())) == 1
    )
    if same:
        return typed_array(np.ravel(values[0])[0], dtype)
    if len(values) == 1:
        return typed_array(values[0], dtype)
    xp = namespace(values)
    is_array = isinstance(values, jax.Array)
    if is_array or not any(map(np.ndim, values)):
        of_bodies = values if is_array else stacked([*values], dtype)
        return of_bodies[np.repeat(np.arange(len(values)), counts)]
    pairs = zip(values, counts, strict=True)
    return xp.concatenate([xp.broadcast_to(xp.asarray(v, dtype), n) for v, n in pairs])


def concatenated(values: Sequence[Any]) -> Any:
    """Arrays joined along their last axis, on the host where none is traced."""
    if len(values) == 1:
        return values[0]
    return namespace(values).concatenate(values, -1)


class _PlacedSurface(NamedTuple):
    """Surface of a body in the world [m]."""

    position: Float[np.ndarray, "s 3"]
    normal: Float[np.ndarray, "s 3"]
    triangles: Float[np.ndarray, "f 3 3"]


def placed_surface(grid: AbstractGrid, pose: Pose) -> _PlacedSurface:
    """Surface of a body in the world, the same arrays at the same pose."""
    mesh = grid.mesh
    return found(
        (grid,),
        ("placed_surface", pose.key),
        lambda: _PlacedSurface(
            pose.to_world(grid.fragment_position),
            pose.rotate(grid.fragment_normal),
            pose.to_world(mesh.vertices[mesh.faces]),
        ),
    )


def enclosing_bodies(
    grids: tuple[AbstractGrid, ...], poses: tuple[Pose, ...], inside: tuple[str, ...]
) -> list[Int[np.ndarray, " _"] | None]:
    """Number of the body in whose closed cavity each fragment is; -1 for none.

    A fragment in the cavity of a body in the cavity of another one is in the inner one.

    Args:
        grids: of the bodies.
        poses: of the bodies.
        inside: "open" for each body whose cavities are open to the outside.

    Returns:
        The numbers for each body; None for one that is outside of all others.
    """
    return found(
        grids,
        ("enclosing", tuple(pose.key for pose in poses), inside),
        lambda: _enclosing(grids, poses, inside),
    )


def _enclosing(
    grids: tuple[AbstractGrid, ...], poses: tuple[Pose, ...], inside: tuple[str, ...]
) -> list[Int[np.ndarray, " _"] | None]:
    enclosing: list[Int[np.ndarray, " _"] | None] = [None] * len(grids)
    size = [float(np.linalg.norm(np.ptp(grid.mesh.bounds, axis=0))) for grid in grids]
    # Smaller bodies last: they may be in the larger ones.
    for number in np.argsort(size)[::-1]:
        around = grids[number]
        if inside[number] == "open" or around.cavities is None:
            continue
        for other_number, grid in enumerate(grids):
            faced = grid.fragment_cavity
            if other_number != number:
                pose = poses[other_number]
                # Bodies that move together keep what is inside of them.
                faced = found_between(
                    (around, grid),
                    poses=(poses[number], pose),
                    by=("surrounding",),
                    find=partial(
                        _surrounding,
                        around.cavities,
                        around=poses[number],
                        grid=grid,
                        pose=pose,
                    ),
                )
            if not (faced > 0).any():
                continue
            previous = enclosing[other_number]
            outer = -1 if previous is None else previous
            enclosing[other_number] = np.where(faced > 0, number, outer)
    return enclosing


def _surrounding(
    cavities: AbstractCavities, around: Pose, grid: AbstractGrid, pose: Pose
) -> Int[np.ndarray, " s"]:
    """Cavity of another body in which each fragment is, 0 or -1 for none."""
    # The voxels of a wall may cover a fragment that is closer to it than a voxel. Half
    # a voxel further inside its own body, the fragment is outside of them.
    faced = np.full(len(grid.fragment_area), -1)
    # A thin wall is seen from just in front of either face.
    depths = (-1e-3, -0.5) if grid.is_two_sided else (0.5, 0.0, -0.5)
    for depth in depths:
        solid = np.flatnonzero(faced < 0)
        inward = depth * grid.pitch * grid.fragment_normal[solid]
        position = pose.to_world(grid.fragment_position[solid] - inward)
        faced[solid] = cavities.at(around.to_body(position))
    return faced
