"""Materials by the named parts of a mesh."""

from collections.abc import Mapping

from ..errors import InputError
from ..geometry.mesh import Mesh
from ..material.material import Material
from ..voxels.grid import VoxelGrid
from ..voxels.parts import part_labels
from .scene import MaterialLabels


def materials_by_part(
    grid: VoxelGrid, parts: Mapping[str, Mesh], materials: Mapping[str, Material]
) -> MaterialLabels:
    """Material of every voxel of a body, by the part of the mesh that it belongs to.

    Args:
        grid: of the whole body.
        parts: from `load_parts`, of the same file with the same unit and axes.
        materials: one for each part, by its name; "*" is for all that are not named.

    Raises:
        InputError: for a part without a material, or a material of no part.

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
    names = ", ".join(parts)
    for name in materials:
        if name not in parts and name != "*":
            raise InputError(f"materials: there is no part {name!r}; there are {names}")
    missing = [name for name in parts if name not in materials]
    if missing and "*" not in materials:
        raise InputError(
            f"materials: the part {missing[0]!r} has none: give one for each of "
            f"{names}, or '*' for all others"
        )
    # One entry for each part: two parts may be of one material.
    by_part = [materials[name if name in materials else "*"] for name in parts]
    labels = part_labels(grid, list(parts.values()))
    return MaterialLabels(labels, given=tuple(by_part), names=tuple(parts))
