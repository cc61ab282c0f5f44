"""Snapshots: the geometry of a scene, its contacts and bound terms at one moment."""

import itertools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...errors import located
from ...geometry.mesh import Pose
from ...memo.found import found
from ...memo.once import once
from ...physics.contact.overlap import AnyOverlap, find_overlaps
from ...physics.contact.rays import PlacedGrid
from ...physics.flux_law import Forcing
from ...physics.occluder import Occluder
from ...physics.radiation.irradiation import Irradiation
from ...physics.surface import (
    BodySurface,
    Omitted,
    Surface,
    enclosing_bodies,
    placed_surface,
)
from ...voxels.abstract_grid import AbstractGrid
from ..air import bodies_with_surface
from ..motion import moving_together
from ..scene import Body, Scene
from .bindings import BindingSteps, NumberedBindings, bind_terms
from .bodies import (
    PreparedGroup,
    half_cells_of,
    references_of,
    surface_property,
)
from .contacts import Contacts, PairKey, TouchingPairs, find_contacts


class Snapshot(NamedTuple):
    """A scene at one moment: its surface, and what acts on it."""

    surface: Surface
    natural: NumberedBindings
    """Terms that give a flux, where no temperature is prescribed."""
    prescribed: NumberedBindings
    radiating: NumberedBindings
    """Exchange of surfaces whose temperature is prescribed with others."""
    omitted: tuple[tuple[int, Omitted], ...]
    """Surface terms that do not act on a body, by their number."""
    irradiation: tuple[tuple[str, Irradiation], ...]
    """Radiation that reaches the surface, with the property that absorbs it."""
    pairs: dict[PairKey, TouchingPairs]
    unpaired: tuple[tuple[int, str], ...]
    """Pair terms that do not act, by their number, and why."""
    overlaps: dict[tuple[int, int], AnyOverlap]
    """Bodies that overlap by more than a contact, by their numbers."""

    @property
    def bindings(self) -> NumberedBindings:
        """All bindings, natural ones first."""
        return (*self.natural, *self.prescribed, *self.radiating)


def take_snapshots(
    scene: Scene,
    prepared: tuple[PreparedGroup, ...],
    starts: tuple[float, ...],
    end: float | int,
    temperatures: Forcing | None,
    prune: bool,
) -> list[Snapshot]:
    """The scene at every snapshot, from its start, with the same bindings at each.

    What stands still is the same object in all of them: surfaces of bodies at rest, and
    bindings to them of terms at rest. Terms without effect are left out if `prune`.
    """
    # Several snapshots need the same bindings: a term that does not act now is omitted
    # only where there is one snapshot.
    is_single = prune and len(starts) == 1
    stops = (*starts[1:], max(end, starts[-1]))
    # The geometry halfway between two snapshots is exact to second order in their
    # distance for whatever moves smoothly.
    times = [(start + stop) / 2 for start, stop in zip(starts, stops, strict=True)]
    surfaced = bodies_with_surface(scene)
    known_poses: dict[tuple, Pose] = {}
    poses_at = []
    # A method of a module is a new object in each call: one for all times.
    pose_at = [body.pose.at for body in surfaced]
    for time in times:
        poses = [at(time) for at in pose_at]
        # Equal poses are one object.
        poses_at.append(tuple(known_poses.setdefault(p.key, p) for p in poses))
    together = moving_together(
        poses_at, min(body.structure.grid.pitch for body in surfaced)
    )

    moving = tuple(
        any(poses[group[0]] is not poses_at[0][group[0]] for poses in poses_at)
        for group in together
    )

    @once
    def at_rest(*poses: Pose) -> _AtRest:
        return _at_rest(
            scene,
            prepared=prepared,
            poses=poses,
            together=together,
            moving=moving,
            temperatures=temperatures,
            end=end,
            prune=is_single,
        )

    steps = BindingSteps.once()
    snapshots = []
    for time, poses in zip(times, poses_at, strict=True):
        bodies = at_rest(*poses)
        terms = [term.at(time) for term in scene.terms]
        bound = bind_terms(terms, bodies.surface, steps)
        snapshots.append(
            Snapshot(
                surface=bound.surface,
                natural=bound.natural,
                prescribed=bound.prescribed,
                radiating=bound.radiating,
                omitted=bound.omitted,
                irradiation=bound.irradiation,
                pairs=bodies.contacts.pairs,
                unpaired=bodies.contacts.unpaired,
                overlaps=bodies.overlaps,
            )
        )
    return _without_idle(snapshots) if prune else snapshots


class _AtRest(NamedTuple):
    """Bodies at some poses: their surface, and where they touch and overlap."""

    surface: Surface
    contacts: Contacts
    overlaps: dict[tuple[int, int], AnyOverlap]


def _at_rest(
    scene: Scene,
    prepared: tuple[PreparedGroup, ...],
    poses: tuple[Pose, ...],
    together: tuple[tuple[int, ...], ...],
    moving: tuple[bool, ...],
    temperatures: Forcing | None,
    end: float | int,
    prune: bool,
) -> _AtRest:
    surfaced = bodies_with_surface(scene)
    placed = tuple(
        PlacedGrid(body.structure.grid, pose, f"body {index}")
        for index, (body, pose) in enumerate(zip(surfaced, poses, strict=True))
    )
    overlaps = _overlaps(placed)
    contacts = find_contacts(scene, placed)
    bodies = _body_surfaces(
        surfaced,
        poses=poses,
        together=together,
        moving=moving,
        covered=contacts.covered,
        dtype=np.dtype(scene.dtype),
        prune=prune,
    )
    half_cell = half_cells_of(prepared)
    if any(fraction is not None for fraction in contacts.covered):
        exposed = [body.exposed_fraction for body in bodies]
        half_cell = half_cell * np.concatenate(exposed)
    surface = Surface(
        bodies=bodies,
        half_cell=half_cell,
        references=references_of(prepared)[: len(surfaced)],
        temperatures=temperatures,
        end=end,
    )
    return _AtRest(surface, contacts=contacts, overlaps=overlaps)


def _without_idle(snapshots: list[Snapshot]) -> list[Snapshot]:
    """The snapshots without bindings that act at none of them."""
    flags = iter([bool(is_acting.any()) for is_acting in acting(snapshots)])
    first = snapshots[0]
    is_used = {
        field: [next(flags) for _ in getattr(first, field)]
        for field in ("natural", "prescribed", "radiating")
    }
    return [
        snapshot._replace(
            **{
                field: tuple(itertools.compress(getattr(snapshot, field), used))
                for field, used in is_used.items()
            }
        )
        for snapshot in snapshots
    ]


def acting(snapshots: list[Snapshot]) -> list[Bool[np.ndarray, " s"]]:
    """Fragments on which each binding acts at any snapshot."""
    # A light that moves reaches a fragment at some snapshots only.
    rows = zip(*(snapshot.bindings for snapshot in snapshots), strict=True)
    return [np.any([binding.acting for _, binding in row], axis=0) for row in rows]


def _body_surfaces(
    bodies: tuple[Body, ...],
    poses: tuple[Pose, ...],
    together: tuple[tuple[int, ...], ...],
    moving: tuple[bool, ...],
    covered: list[Float[np.ndarray, " _"] | None],
    dtype: Any,
    prune: bool,
) -> tuple[BodySurface, ...]:
    # Covered is the fraction of each fragment that another body touches, if any.
    grids = tuple(body.structure.grid for body in bodies)
    placed = [
        placed_surface(grid, pose) for grid, pose in zip(grids, poses, strict=True)
    ]
    occluders = tuple(
        Occluder.of_bodies(
            tuple(grids[number] for number in group),
            poses=tuple(poses[number] for number in group),
            triangles=[placed[number].triangles for number in group],
            bodies=group,
            moves=moves,
        )
        for group, moves in zip(together, moving, strict=True)
    )
    enclosing = enclosing_bodies(
        grids,
        poses=poses,
        inside=tuple(body.inside for body in bodies),
    )
    surfaces = []
    for index, (body, pose) in enumerate(zip(bodies, poses, strict=True)):
        grid = body.structure.grid
        exposed = _exposed(grid, covered[index], dtype)
        with located(f"bodies[{index}]"):
            emissivity = surface_property(body, "emissivity", dtype)
            absorptivity = surface_property(body, "absorptivity", dtype)
        surfaces.append(
            BodySurface(
                body=index,
                grid=grid,
                pose=pose,
                position=placed[index].position,
                normal=placed[index].normal,
                area=exposed.area,
                exposed_fraction=exposed.fraction,
                natural=exposed.natural,
                emissivity=emissivity,
                absorptivity=absorptivity,
                occluders=occluders,
                dtype=dtype,
                enclosing=enclosing[index],
                prune=prune,
            )
        )
    return tuple(surfaces)


class _Exposed(NamedTuple):
    """The part of each fragment of a body that nothing touches."""

    area: Float[np.ndarray, " s"]
    """[m^2]"""
    fraction: Float[np.ndarray, " s"]
    natural: Bool[np.ndarray, " s"]
    """True where the fraction is not 0."""


def _exposed(
    grid: AbstractGrid, covered: Float[np.ndarray, " s"] | None, dtype: Any
) -> _Exposed:
    """The exposed part of a surface with these covered fractions; None for none."""
    fraction = np.ones(len(grid.fragment_area))
    if covered is not None:
        fraction = 1 - covered
    area = (grid.fragment_area * fraction).astype(dtype)
    return _Exposed(area, fraction.astype(dtype), fraction > 0)


# Overlaps depend on voxels and poses alone: they are computed once for all runs, and
# again for pairs of which one has moved.
def _overlaps(
    placed: tuple[PlacedGrid, ...],
) -> dict[tuple[int, int], AnyOverlap]:
    if len(placed) == 1:
        return {}
    return found(
        tuple(body.grid for body in placed),
        by=("overlaps", tuple(body.pose.key for body in placed)),
        find=lambda: find_overlaps(placed),
    )
