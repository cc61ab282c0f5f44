"""Voxel grids in the world frame, and the depth to which two of them overlap."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
from ...geometry.mesh import Pose
from ...voxels.grid import VoxelGrid


@dataclass(frozen=True, eq=False)
class PlacedGrid:
    """Voxel grid of a body with its pose, and its name in messages."""

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
        return self.pose.to_world(self.grid.fragment_position)

    @cached_property
    def world_bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the body in the world [m]."""
        corners = self.pose.to_world(self.grid.mesh.vertices)
        return np.stack([corners.min(0), corners.max(0)])

    def vertices_in(self, frame: "PlacedGrid") -> Float[np.ndarray, "v 3"]:
        """Vertices of the mesh in another body's frame [m]."""
        return frame.pose.to_body(self.pose.to_world(self.grid.mesh.vertices))

    def fragments_in(self, frame: "PlacedGrid") -> Float[np.ndarray, "s 3"]:
        """Positions of the fragments in another body's frame [m]."""
        return frame.pose.to_body(self.world_fragments)


# Allowed overlap in voxels of the coarser body: rounding and coarse meshes cause it.
_MAX_OVERLAP_VOXELS = 2.0

_AXIS_DIRECTIONS = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])


def max_overlap(a: PlacedGrid, b: PlacedGrid, threshold: float) -> float:
    """Largest overlap of two bodies that counts as contact [m]."""
    return max(threshold, _MAX_OVERLAP_VOXELS * max(a.pitch, b.pitch))


def _overlap_depth(a: PlacedGrid, b: PlacedGrid) -> float:
    """Largest depth of the surface of either body in the other [m], to half a voxel."""
    # The depth of a fragment in a body is the shortest way out of its voxels along the
    # axes of its lattice.
    return max(_depth_in(a, b), _depth_in(b, a))


def _depth_in(body: PlacedGrid, other: PlacedGrid) -> float:
    """Depth of a body's fragments in another one [m]; 0 if all are outside."""
    solid = np.pad(other.grid.solid, 1)
    cells = _solid_cells(body.fragments_in(other), other)
    if not len(cells):
        return 0.0
    # Padded on all sides, so that every way out ends.
    cells = np.unique(cells + 1, axis=0)
    steps = 0
    while len(cells):
        steps += 1
        ahead = np.clip(
            cells[:, None] + steps * _AXIS_DIRECTIONS, 0, np.array(solid.shape) - 1
        )
        cells = cells[solid[tuple(np.moveaxis(ahead, 2, 0))].all(1)]
    return (steps - 0.5) * other.pitch


def _solid_cells(
    points: Float[np.ndarray, "n 3"], body: PlacedGrid
) -> Int[np.ndarray, "m 3"]:
    """Solid cells that contain the points; points outside are dropped."""
    cells, solid = body.grid.lattice.to_cells(points), body.grid.solid
    within = ((cells >= 0) & (cells < solid.shape)).all(1)
    numbers = np.floor(cells[within]).astype(np.int64)
    return numbers[solid[tuple(numbers.T)]]


def _fraction_inside(body: PlacedGrid, other: PlacedGrid) -> float:
    """Fraction of a body's fragments with a voxel centre inside another body."""
    voxels = body.grid.lattice.centres(body.grid.fragment_voxel)
    inside = _solid_cells(other.pose.to_body(body.pose.to_world(voxels)), other)
    return len(inside) / len(voxels)


def require_shallow(a: PlacedGrid, b: PlacedGrid, threshold: float) -> None:
    """Raise an error for bodies that overlap too deeply to be in contact.

    `threshold` is the largest gap that counts as contact [m].

    Raises:
        InputError: naming both bodies and the depth.
    """
    depth = _overlap_depth(a, b)
    # The depth is known to half a voxel.
    limit = max_overlap(a, b, threshold) + 0.5 * max(a.pitch, b.pitch)
    # Thin bodies can be inside each other entirely at a small depth.
    if depth > limit or max(_fraction_inside(a, b), _fraction_inside(b, a)) > 0.5:
        raise InputError(
            f"{a.name} and {b.name} overlap by about {depth:.3g} m: move them apart "
            "until they touch, or join them in one mesh"
        )
