"""Geometry and surface properties of a simulated body, for a camera."""

from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ..geometry.mesh import Pose
from ..voxels.grid import VoxelGrid
from .motion import Motion


@dataclass(frozen=True, eq=False)
class BodyGeometry:
    """Shape and fragments in the body's own frame [m], and its pose."""

    # Not the grid: its voxels need far more memory than its surface.
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    fragment_position: Float[np.ndarray, "s 3"]
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    pitch: float
    pose: Pose | Motion

    @property
    def placed(self) -> Pose:
        """The pose; of a body that moves, at the start."""
        return self.pose.at(0.0)

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Triangles in the world [m]."""
        return self.placed.to_world(self.vertices)[self.faces]


class SolvedSurface(eqx.Module):
    """A body's geometry with the radiative properties of its surface."""

    geometry: BodyGeometry = eqx.field(static=True)
    emissivity: Float[Array, "*s"]
    """One number for one material [-]."""
    absorptivity: Float[Array, "*s"]

    @property
    def moves(self) -> bool:
        """True if the pose changes with time."""
        pose = self.geometry.pose
        return isinstance(pose, Motion) and not pose.is_still

    def at(self, time: float) -> "SolvedSurface":
        """The surface at the pose of a moment [s]."""
        here = replace(self.geometry, pose=self.geometry.pose.at(time))
        return SolvedSurface(here, self.emissivity, self.absorptivity)


def body_geometry(grid: VoxelGrid, pose: Pose | Motion) -> BodyGeometry:
    """The part of a voxel grid that a camera needs after the run."""
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_position,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=pose,
    )
