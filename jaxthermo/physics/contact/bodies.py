"""A voxel grid where it stands, as contact sees it."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
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


# How deep two bodies overlap: bodies in contact touch, they do not share space.


DEEPEST_VOXELS = 2.0
"""Of the coarser body: rounding and coarse meshes may make bodies overlap so deep."""

STAR = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])


def deepest_allowed(a: PlacedGrid, b: PlacedGrid, threshold: float) -> float:
    """How deep two bodies may overlap and still be in contact [m]."""
    return max(threshold, DEEPEST_VOXELS * max(a.pitch, b.pitch))


def overlap_depth(a: PlacedGrid, b: PlacedGrid) -> float:
    """How deep the surface of either body lies in the other [m], to half a voxel.

    The depth of a fragment in a body is the shortest way out of its voxels along the
    axes of its lattice.
    """
    return max(_depth_in(a, b), _depth_in(b, a))


def _depth_in(body: PlacedGrid, other: PlacedGrid) -> float:
    """Depth of a body's fragments in another one [m]; 0 if all are outside."""
    solid = np.pad(other.grid.solid, 1)
    cells = _solid_cells(body.fragments_in(other), other)
    if not len(cells):
        return 0.0
    # Padded all around, so that every way out ends.
    cells = np.unique(cells + 1, axis=0)
    steps = 0
    while len(cells):
        steps += 1
        ahead = np.clip(cells[:, None] + steps * STAR, 0, np.array(solid.shape) - 1)
        cells = cells[solid[tuple(np.moveaxis(ahead, 2, 0))].all(1)]
    return (steps - 0.5) * other.pitch


def _solid_cells(
    points: Float[np.ndarray, "n 3"], body: PlacedGrid
) -> Int[np.ndarray, "m 3"]:
    """Cells of the solid voxels that some of the points lie in, one a point."""
    cells, solid = body.grid.lattice.to_cells(points), body.grid.solid
    within = ((cells >= 0) & (cells < solid.shape)).all(1)
    numbers = np.floor(cells[within]).astype(np.int64)
    return numbers[solid[tuple(numbers.T)]]


def _share_in(body: PlacedGrid, other: PlacedGrid) -> float:
    """Share of a body's fragments whose voxels are centred in another body."""
    voxels = body.grid.lattice.centres(body.grid.fragment_voxel)
    inside = _solid_cells(other.pose.unplace(body.pose.place(voxels)), other)
    return len(inside) / len(voxels)


def require_shallow(a: PlacedGrid, b: PlacedGrid, threshold: float) -> None:
    """Refuse bodies that overlap by more than contact can mean.

    Args:
        a: the one body.
        b: the other body.
        threshold: widest gap that is contact [m].

    Raises:
        InputError: naming both bodies and the depth.
    """
    depth = overlap_depth(a, b)
    # Half a voxel more, to which the depth is known.
    limit = deepest_allowed(a, b, threshold) + 0.5 * max(a.pitch, b.pitch)
    # Thin bodies lie in each other entirely before they do so deeply.
    if depth > limit or max(_share_in(a, b), _share_in(b, a)) > 0.5:
        raise InputError(
            f"{a.name} and {b.name} overlap by about {depth:.3g} m: move them apart "
            "until they touch, or join them in one mesh"
        )
