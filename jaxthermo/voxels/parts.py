"""Voxels of the parts of a body: which part of a mesh each solid voxel belongs to."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from ..errors import InputError
from ..geometry.mesh import Mesh
from .fill import fill_by_vote
from .grid import VoxelGrid
from .lattice import Lattice, Views, peel_axes
from .surface import axis_fragments, face_axes


def part_labels(
    grid: VoxelGrid, part_meshes: Sequence[Mesh]
) -> Int[np.ndarray, "x y z"]:
    """Number of the part of every solid voxel; -1 outside the body.

    The voxels inside a closed part belong to it, or to the last of several parts. Other
    voxels, as in a body whose parts are patches of one surface, belong to the part with
    the nearest surface.

    Raises:
        InputError: if no part has a surface within the body's lattice.
    """
    shape = grid.lattice.shape
    label = np.full(shape, -1, np.int32)
    points = []
    owner = []
    for number, mesh in enumerate(part_meshes):
        views = peel_axes(mesh, grid.lattice)
        if mesh.is_watertight:
            label[fill_by_vote(views, shape) & grid.solid] = number
        part_points = _surface_points(mesh, grid.lattice, views)
        points.append(part_points)
        owner.append(np.full(len(part_points), number, np.int32))
    surface = np.concatenate(points)
    part_of_point = np.concatenate(owner)
    if not len(surface):
        raise InputError(
            "part_labels: no part has any surface where the body is: load both from "
            "the same file, with the same unit and axes"
        )
    unassigned = np.argwhere(grid.solid & (label < 0))
    if len(unassigned):
        _, nearest = KDTree(surface).query(grid.lattice.centres(unassigned))
        label[tuple(unassigned.T)] = part_of_point[nearest]
    return label


def _surface_points(
    mesh: Mesh, lattice: Lattice, views: Views
) -> Float[np.ndarray, "k 3"]:
    # One point for each piece of surface, from the view in which it is largest [m].
    normals, dominant = face_axes(mesh)
    positions = []
    for axis, layers in enumerate(views):
        fragments, _ = axis_fragments(
            layers, normals=normals, dominant=dominant, axis=axis, first_ray=0
        )
        positions.append(fragments.position)
    points = np.concatenate(positions)
    # Along its rays a view also sees what is beyond the lattice.
    within = ((points > -1) & (points < np.add(lattice.shape, 1))).all(axis=1)
    return lattice.origin + points[within] * lattice.pitch
