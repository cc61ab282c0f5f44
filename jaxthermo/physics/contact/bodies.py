"""A voxel grid where it stands, as contact sees it."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ...geometry.pose import Pose
from ...voxels.grid import VoxelGrid


@dataclass(frozen=True, eq=False)
class PlacedGrid:
    """A body's voxel grid with its pose and the name that messages use."""

    grid: VoxelGrid
    pose: Pose = field(default_factory=Pose)
    name: str = "body"

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    @cached_property
    def world_fragments(self) -> Float[np.ndarray, "s 3"]:
        """Positions of the fragments in the world [m]."""
        return self.pose.place(self.grid.fragment_position)

    @cached_property
    def world_bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the body in the world [m]."""
        corners = self.pose.place(self.grid.mesh.vertices)
        return np.stack([corners.min(0), corners.max(0)])

    def vertices_in(self, frame: "PlacedGrid") -> Float[np.ndarray, "v 3"]:
        """Vertices of the mesh in another body's frame [m]."""
        return frame.pose.unplace(self.pose.place(self.grid.mesh.vertices))

    def fragments_in(self, frame: "PlacedGrid") -> Float[np.ndarray, "s 3"]:
        """Positions of the fragments in another body's frame [m]."""
        return frame.pose.unplace(self.world_fragments)
