"""Materials by the named parts of a mesh."""

from collections.abc import Mapping

from ..errors import InputError
from ..geometry.mesh import Mesh
from ..geometry.parts import matching_parts
from ..material.material import Material
from ..voxels.grid import VoxelGrid
from ..voxels.parts import part_labels
from .scene import MaterialLabels


_MAX_LISTED = 12
"""Largest number of names of parts in a message."""


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
    patterns = _pattern_of_parts(list(parts), list(materials))
    # One entry for each part: two parts may be of one material.
    by_part = [materials[patterns[name]] for name in parts]
    labels = part_labels(grid, list(parts.values()))
    return MaterialLabels(labels, given=tuple(by_part), names=tuple(parts))


def _pattern_of_parts(names: list[str], patterns: list[str]) -> dict[str, str]:
    """The pattern that says the material of each part, by the part's name."""
    listed = ", ".join(names[:_MAX_LISTED])
    if len(names) > _MAX_LISTED:
        listed += f" and {len(names) - _MAX_LISTED:,} more (jaxthermo parts lists them)"
    pattern_of: dict[str, str] = {}
    for pattern in patterns:
        matching = [] if pattern == "*" else matching_parts(pattern, names)
        if not matching and pattern != "*":
            raise InputError(
                f"materials: there is no part {pattern!r}; there are {listed}"
            )
        for name in matching:
            earlier = pattern_of.setdefault(name, pattern)
            # A whole name says more than a pattern.
            if name == pattern:
                pattern_of[name] = pattern
            elif earlier not in (name, pattern):
                raise InputError(
                    f"materials: both {earlier!r} and {pattern!r} match the part "
                    f"{name!r}: give its whole name"
                )
    missing = [name for name in names if name not in pattern_of]
    if missing and "*" not in patterns:
        raise InputError(
            f"materials: the part {missing[0]!r} has none: give one for each of "
            f"{listed}, or '*' for all others"
        )
    return {name: pattern_of.get(name, "*") for name in names}
