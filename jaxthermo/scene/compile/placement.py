"""Bodies at their poses: results that depend on voxels and poses alone.

Positions and triangles in the world, closed cavities, contacts and overlaps are
computed once for all runs, and again for a body that moved.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...findings import found
from ...geometry.mesh import Pose
from ...physics.contact.overlap import Overlap, find_overlaps
from ...physics.contact.rays import PlacedGrid
from ...physics.contact.search import ContactPairs, contacts_between
from ...voxels.cavities import Cavities
from ...voxels.grid import VoxelGrid
from ..scene import Scene


def overlaps_of(
    placed: tuple[PlacedGrid, ...], clear_pairs: dict
) -> dict[tuple[int, int], Overlap]:
    """Overlaps of bodies, as by `find_overlaps`."""
    if len(placed) == 1:
        return {}
    return found(
        tuple(body.grid for body in placed),
        by=("overlaps", tuple(_pose_key(body.pose) for body in placed)),
        find=lambda: find_overlaps(placed, clear_pairs),
        search="overlaps of bodies",
    )


def _pose_key(pose: Pose) -> tuple:
    return pose.translation, pose.rotation


class _PlacedSurface(NamedTuple):
    """Surface of a body in the world [m]."""

    position: Float[np.ndarray, "s 3"]
    normal: Float[np.ndarray, "s 3"]
    triangles: Float[np.ndarray, "f 3 3"]


def placed_surface(grid: VoxelGrid, pose: Pose) -> _PlacedSurface:
    """Surface of a body in the world, the same arrays at the same pose."""
    mesh = grid.mesh
    return found(
        (grid,),
        ("placed_surface", _pose_key(pose)),
        lambda: _PlacedSurface(
            pose.to_world(grid.fragment_position),
            pose.rotate(grid.fragment_normal),
            pose.to_world(mesh.vertices[mesh.faces]),
        ),
    )


def scene_triangles(placed: list[_PlacedSurface]) -> Float[np.ndarray, "f 3 3"]:
    """Triangles of all bodies [m]; the same array in every run, for shadows."""
    triangles = tuple(surface.triangles for surface in placed)
    if len(triangles) == 1:
        return triangles[0]
    return found(triangles, "triangles", lambda: np.concatenate(triangles))


def enclosed_fragments(
    scene: Scene, poses: tuple[Pose, ...]
) -> list[Bool[np.ndarray, " _"] | None]:
    """Fragments of each body in a closed cavity, of its own or another body."""
    inside = tuple(body.inside for body in scene.bodies)
    return found(
        tuple(body.structure.grid for body in scene.bodies),
        ("enclosed", tuple(map(_pose_key, poses)), inside),
        lambda: _enclosed(scene, poses),
    )


def _enclosed(
    scene: Scene, poses: tuple[Pose, ...]
) -> list[Bool[np.ndarray, " _"] | None]:
    grids = [body.structure.grid for body in scene.bodies]
    enclosed: list[Bool[np.ndarray, " _"] | None] = [None] * len(grids)
    for number, (around, body) in enumerate(zip(grids, scene.bodies, strict=True)):
        if body.inside == "open" or around.cavities is None:
            continue
        for other_number, grid in enumerate(grids):
            faced = grid.fragment_cavity
            if other_number != number:
                faced = _surrounding(
                    around.cavities,
                    around=poses[number],
                    grid=grid,
                    pose=poses[other_number],
                )
            inside = faced > 0
            previous = enclosed[other_number]
            if previous is not None:
                inside = previous | inside
            if inside.any():
                enclosed[other_number] = inside
    return enclosed


def _surrounding(
    cavities: Cavities, around: Pose, grid: VoxelGrid, pose: Pose
) -> Int[np.ndarray, " s"]:
    """Cavity of another body in which each fragment is, 0 or -1 for none."""
    # The voxels of a wall may cover a fragment that is closer to it than a voxel. Half
    # a voxel further inside its own body, the fragment is outside of them.
    faced = np.full(len(grid.fragment_area), -1)
    for depth in (0.5, 0.0, -0.5):
        solid = np.flatnonzero(faced < 0)
        inward = depth * grid.pitch * grid.fragment_normal[solid]
        position = pose.to_world(grid.fragment_position[solid] - inward)
        faced[solid] = cavities.at(around.to_body(position))
    return faced


def touching(
    placed: tuple[PlacedGrid, ...], max_gap: Any
) -> dict[tuple[int, int], ContactPairs]:
    """Contacts of bodies, as by `contacts_between`."""
    gap = None if max_gap is None else float(max_gap)
    return found(
        tuple(body.grid for body in placed),
        by=("contacts", tuple(_pose_key(body.pose) for body in placed), gap),
        find=lambda: contacts_between(placed, gap),
        search="contacts of bodies",
    )
