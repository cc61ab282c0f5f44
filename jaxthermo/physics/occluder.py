"""Occluders: bodies that block lines of sight, those together that move together.

A line of sight is free if none of the occluders blocks it. What one of them blocks
depends on its place in the frame of the body that looks, so that snapshots of a motion
share what did not move.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..geometry.mesh import Pose
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid


@dataclass(frozen=True, eq=False)
class Occluder:
    """Triangles of some bodies that keep their places in one another."""

    triangles: Float[np.ndarray, "f 3 3"]
    """In the world [m]."""
    shapes: tuple[object, ...]
    """Objects that its shape follows from, compared by identity."""
    pose: Pose = Pose()
    """Pose of the first of its bodies."""
    places: bytes = b""
    """Places of its bodies in the frame of the first, as numbers to compare."""
    bodies: tuple[int, ...] = ()
    """Numbers of its bodies in the scene."""
    moves: bool = False
    """True if it is elsewhere at other times."""

    @classmethod
    def of_triangles(cls, triangles: Float[np.ndarray, "f 3 3"]) -> "Occluder":
        """An occluder that does not move."""
        return cls(triangles, shapes=(triangles,))

    @classmethod
    def of_bodies(
        cls,
        grids: tuple[AbstractGrid, ...],
        poses: tuple[Pose, ...],
        triangles: Sequence[Float[np.ndarray, "_ 3 3"]],
        bodies: tuple[int, ...],
        moves: bool,
    ) -> "Occluder":
        """The occluder of bodies at poses, with the triangles of each in the world."""
        first = poses[0]
        length = min(grid.pitch for grid in grids)
        return cls(
            joined_triangles(triangles),
            shapes=grids,
            pose=first,
            # One value, whose hash Python keeps: every group of bodies compares it.
            places=repr([first.relative_key(pose, length) for pose in poses]).encode(),
            bodies=bodies,
            moves=moves,
        )

    def place_from(self, pose: Pose, length: float) -> tuple[tuple, bytes]:
        """Its place in the frame of a body at a pose, as numbers to compare."""
        return pose.relative_key(self.pose, length), self.places


def joined_triangles(
    triangles: Sequence[Float[np.ndarray, "_ 3 3"]],
) -> Float[np.ndarray, "f 3 3"]:
    """Triangles of several bodies [m]; the same array in every run."""
    if len(triangles) == 1:
        return triangles[0]
    return found(tuple(triangles), "triangles", lambda: np.concatenate(triangles))
