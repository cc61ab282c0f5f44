"""Geometry of a body as its images need it, from its voxels and materials."""

import numpy as np

from ..geometry.mesh import Pose
from ..material.material import Material
from ..voxels.grid import VoxelGrid
from .motion import Motion
from .scene import AbstractMaterials, BodyGeometry, MaterialLabels


def body_geometry(
    grid: VoxelGrid,
    pose: Pose | Motion,
    material: Material | AbstractMaterials | None = None,
) -> BodyGeometry:
    """The part of a voxel grid that a camera needs after the run."""
    fragment_part = None
    names = ()
    if isinstance(material, MaterialLabels):
        fragment_part = np.asarray(material.of_fragments(grid), np.int32)
        names = material.names or tuple(map(str, range(len(material.given))))
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_foot,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=pose,
        fragment_part=fragment_part,
        part_names=names,
    )
