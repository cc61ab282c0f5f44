"""Materials by the named parts of a mesh."""

from collections.abc import Mapping

from ..geometry.mesh import Mesh
from ..geometry.part_names import pattern_of_parts
from ..material.material import Material
from ..voxels.grid import VoxelGrid
from ..voxels.parts import part_labels
from .body_materials import MaterialLabels


def materials_by_part(
    grid: VoxelGrid, parts: Mapping[str, Mesh], materials: Mapping[str, Material]
) -> MaterialLabels:
    """Material of every voxel of a body, by the part of the mesh that it belongs to.

    Args:
        grid: of the whole body.
        parts: from `load_parts`, of the same file with the same unit and axes.
        materials: one for each part, by its name "node/mesh/material" or by a pattern
            without "/" that matches one of the three, such as "blade" or "wheel*"; "*"
            is for all parts that nothing else names.

    Raises:
        InputError: for a part with no or several materials, or a material of no part.

    Example:
        >>> import jaxthermo as jt
        >>> blade = jt.shapes.box((0.04, 0.01, 0.01)).moved((0.02, 0.0, 0.0))
        >>> parts = {"blade": blade, "grip": blade.moved((-0.04, 0.0, 0.0))}
        >>> grid = jt.voxelize(jt.shapes.box((0.08, 0.01, 0.01)), pitch=0.01)
        >>> given = {"blade": jt.materials["copper"], "grip": jt.materials["brick"]}
        >>> labels = jt.materials_by_part(grid, parts, given).labels
        >>> labels[:, 0, 0].tolist()
        [1, 1, 1, 1, 0, 0, 0, 0]
    """
    patterns = pattern_of_parts(list(parts), list(materials), "materials")
    # One entry for each part: two parts may be of one material.
    by_part = [materials[patterns[name]] for name in parts]
    labels = part_labels(grid, list(parts.values()))
    return MaterialLabels(labels, given=tuple(by_part), names=tuple(parts))
