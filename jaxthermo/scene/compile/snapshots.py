"""A scene looked at: where bodies touch and what acts on their surfaces, and when."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...physics.term import Surface, TemperatureRange
from ..scene import Scene
from .bodies import PreparedBody
from .contacts import Touching, find_contacts
from .snapshot_times import middles
from .surface_terms import Bound, bind_terms, body_surface, drop_idle, surface_terms


class Snapshot(NamedTuple):
    """A scene at one moment."""

    touching: Touching
    bounds: tuple[Bound, ...]
    """Of every body."""


def take_snapshots(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    names: tuple[str, ...],
    starts: tuple[float, ...],
    end: float | int,
    reach: TemperatureRange | None,
    prune: bool,
) -> list[Snapshot]:
    """The scene at every moment, with the same bindings at each.

    Args:
        scene: bodies and terms.
        prepared: the bodies.
        names: of the terms.
        starts: when the moments begin [s].
        end: of the last of them [s].
        reach: what the run can get to, if that is known.
        prune: whether what does nothing is left out.
    """
    once = prune and len(starts) == 1
    known = partial(replace, temperature_range=reach, prune=once)
    snapshots = [
        _snapshot(scene, prepared, names, t, known) for t in middles(starts, end)
    ]
    if once or not prune:
        return snapshots
    bodies = [drop_idle([x.bounds[b] for x in snapshots]) for b in range(len(prepared))]
    return [
        snapshot._replace(bounds=bounds)
        for snapshot, *bounds in zip(snapshots, *bodies, strict=True)
    ]


def _snapshot(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    names: tuple[str, ...],
    time: float,
    known: Callable[[Surface], Surface],
) -> Snapshot:
    poses = tuple(body.pose.at(time) for body in scene.bodies)
    triangles = np.concatenate(
        [
            pose.place(body.structure.grid.mesh.triangles)
            for body, pose in zip(scene.bodies, poses, strict=True)
        ]
    )
    touching = find_contacts(scene, poses, names)
    terms = surface_terms(scene, time)
    dtype: Any = np.dtype(scene.dtype)
    bounds = []
    for index, one in enumerate(prepared):
        covered = touching.covered[index]
        surface = body_surface(index, one, poses[index], covered, triangles, dtype)
        bounds.append(bind_terms(terms, known(surface), one.reference))
    return Snapshot(touching, tuple(bounds))
