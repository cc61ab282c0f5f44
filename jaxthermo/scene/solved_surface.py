"""What of a solved body a camera needs: its shape, its fragments, its finish."""

from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ..geometry.pose import Pose
from ..voxels.grid import VoxelGrid
from .motion import Motion


@dataclass(frozen=True, eq=False)
class BodyGeometry:
    """Shape and fragments in the body's own frame [m], and where it stands."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    fragment_position: Float[np.ndarray, "s 3"]
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    pitch: float
    pose: Pose | Motion

    @property
    def placed(self) -> Pose:
        """Where it stands; for one that moves, at the start."""
        return self.pose.at(0.0)

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """World [m]."""
        return self.placed.place(self.vertices)[self.faces]


class SolvedSurface(eqx.Module):
    """A body's geometry with the finish of its surface."""

    geometry: BodyGeometry = eqx.field(static=True)
    emissivity: Float[Array, "*s"]
    """[-]; one number for one material."""
    absorptivity: Float[Array, "*s"]

    @property
    def moves(self) -> bool:
        """Whether it stands elsewhere at other times."""
        pose = self.geometry.pose
        return isinstance(pose, Motion) and not pose.is_still

    def at(self, time: float) -> "SolvedSurface":
        """Where it stands at a moment [s]."""
        here = replace(self.geometry, pose=self.geometry.pose.at(time))
        return SolvedSurface(here, self.emissivity, self.absorptivity)


def body_geometry(grid: VoxelGrid, pose: Pose | Motion) -> BodyGeometry:
    """The part of a voxel grid that outlives the solver."""
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_position,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=pose,
    )
