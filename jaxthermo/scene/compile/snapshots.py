"""Snapshots: the geometry of a scene, its contacts and bound terms at one moment."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...geometry.mesh import Pose
from ...physics.contact.bodies import PlacedGrid
from ...physics.contact.pairs import ContactPairs
from ...physics.contact.search import contacts_between
from ...physics.flux_law import TemperatureRange
from ...physics.term import AbstractPairTerm, BodySurface, Surface
from ..receipt import Omission
from ..scene import Scene
from .bodies import PreparedBody, surface_property
from .surface_terms import BoundSurface, acting, bind_terms, with_terms


# Number of a run in which a source moves by a function of time.
_SOURCE_SNAPSHOTS = 64

PairKey = tuple[int, int, int]
"""Numbers of a term and of both its bodies."""


class Snapshot(NamedTuple):
    """A scene at one moment."""

    surface: BoundSurface
    pairs: dict[PairKey, ContactPairs]
    omitted: tuple[Omission, ...]
    """Pair terms that do not act."""


def snapshot_times(scene: Scene, end: float) -> tuple[float, ...]:
    """Increasing times from 0, each the start of a time in which nothing moves [s]."""
    times = {0.0}
    for body in scene.bodies:
        times |= {t for t in body.pose.snapshot_times(end) if 0 < t < end}
    if any(term.moves for term in scene.terms):
        times |= {end * k / _SOURCE_SNAPSHOTS for k in range(_SOURCE_SNAPSHOTS)}
    return tuple(sorted(times))


def take_snapshots(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    names: tuple[str, ...],
    starts: tuple[float, ...],
    end: float | int,
    temperatures: TemperatureRange | None,
    prune: bool,
) -> list[Snapshot]:
    """The scene at every snapshot, with the same bindings at each.

    Args:
        scene: bodies and terms.
        prepared: the bodies.
        names: of the terms.
        starts: of the snapshots [s].
        end: of the last of them [s].
        temperatures: range of the run, if it is known.
        prune: True to leave out terms that have no effect.
    """
    # Several snapshots need the same bindings: a term that does not act now is omitted
    # only where there is one snapshot.
    once = prune and len(starts) == 1
    stops = (*starts[1:], max(end, starts[-1]))
    snapshots = []
    for start, stop in zip(starts, stops, strict=True):
        # The geometry halfway between two snapshots is exact to second order in their
        # distance for whatever moves smoothly.
        time = (start + stop) / 2
        poses = tuple(body.pose.at(time) for body in scene.bodies)
        pairs, covered, omitted = _find_contacts(scene, poses, names)
        surface = Surface(
            bodies=_body_surfaces(scene, prepared, poses, covered, once),
            references=tuple(body.reference for body in prepared),
            temperature_range=temperatures,
        )
        terms = tuple(term.at(time) for term in scene.terms)
        snapshots.append(Snapshot(bind_terms(terms, surface), pairs, omitted))
    if not prune:
        return snapshots
    keep = [bool(where.any()) for where in acting([each.surface for each in snapshots])]
    return [s._replace(surface=with_terms(s.surface, keep)) for s in snapshots]


def _body_surfaces(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    poses: tuple[Pose, ...],
    covered: list[Float[np.ndarray, " _"]],
    prune: bool,
) -> tuple[BodySurface, ...]:
    """The surfaces of all bodies; `covered` is a fraction of each fragment."""
    dtype: Any = np.dtype(scene.dtype)
    grids = [body.structure.grid for body in scene.bodies]
    triangles = np.concatenate(
        [
            pose.to_world(grid.mesh.triangles)
            for grid, pose in zip(grids, poses, strict=True)
        ]
    )
    surfaces = []
    for index, (body, pose) in enumerate(zip(scene.bodies, poses, strict=True)):
        grid, exposed = grids[index], 1 - covered[index]
        surfaces.append(
            BodySurface(
                body=index,
                grid=grid,
                pose=pose,
                position=pose.to_world(grid.fragment_position),
                normal=pose.rotate(grid.fragment_normal),
                area=(grid.fragment_area * exposed).astype(dtype),
                exposed_fraction=exposed.astype(dtype),
                natural=exposed > 0,
                half_cell=prepared[index].half_cell * exposed.astype(dtype),
                emissivity=surface_property(body, "emissivity", dtype),
                absorptivity=surface_property(body, "absorptivity", dtype),
                scene_triangles=triangles,
                dtype=dtype,
                prune=prune,
            )
        )
    return tuple(surfaces)


def _find_contacts(
    scene: Scene, poses: tuple[Pose, ...], names: tuple[str, ...]
) -> tuple[
    dict[PairKey, ContactPairs], list[Float[np.ndarray, " _"]], tuple[Omission, ...]
]:
    """Touching fragments of each pair of bodies, covered fractions, and omissions.

    Raises:
        InputError: if bodies overlap deeply, or two terms join the same ones.
    """
    terms = [
        (n, term)
        for n, term in enumerate(scene.terms)
        if isinstance(term, AbstractPairTerm)
    ]
    # Fractions of fragments that another body covers: no other term acts there.
    covered = [np.zeros(len(b.structure.grid.fragment_area)) for b in scene.bodies]
    if not terms or len(scene.bodies) == 1:
        alone = tuple(Omission(names[n], "there is one body") for n, _ in terms)
        return {}, covered, alone
    placed = tuple(
        PlacedGrid(body.structure.grid, pose, f"body {index}")
        for index, (body, pose) in enumerate(zip(scene.bodies, poses, strict=True))
    )
    pairs: dict[PairKey, ContactPairs] = {}
    omitted = []
    for number, term in terms:
        touching = contacts_between(placed, term.max_gap)
        found = {key: each for key, each in touching.items() if term.connects(*key)}
        if not found:
            omitted.append(Omission(names[number], "no bodies touch"))
        # An idle pair still covers the surface: it insulates it.
        elif term.is_idle:
            omitted.append(Omission(names[number], "its conductance is 0"))
        for (one, other), each in found.items():
            _refuse_twice(pairs, number, one, other)
            if not term.is_idle:
                pairs[number, one, other] = each
            covered[one] = covered[one] + each.coverage_a
            covered[other] = covered[other] + each.coverage_b
    return pairs, [np.minimum(part, 1) for part in covered], tuple(omitted)


def _refuse_twice(
    pairs: dict[PairKey, ContactPairs], number: int, one: int, other: int
):
    for before in pairs:
        if before[1:] == (one, other):
            raise InputError(
                f"terms[{before[0]}] and terms[{number}] both join bodies {one} and "
                f"{other}: say which bodies each joins"
            )


def pair_counts(snapshots: list[Snapshot]) -> dict[PairKey, int]:
    """The most touching pairs at any snapshot, of all bodies that ever touch."""
    counts: dict[PairKey, int] = {}
    for snapshot in snapshots:
        for key, pairs in snapshot.pairs.items():
            counts[key] = max(counts.get(key, 0), len(pairs.area))
    return {key: counts[key] for key in sorted(counts)}
