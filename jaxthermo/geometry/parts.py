"""Named parts of a mesh file, and patterns of their names."""

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ..errors import InputError
from .files.file_mesh import FileMesh, unique_labels
from .files.read import read_contents, read_mesh
from .load import FileScale, file_scale, placed_mesh
from .mesh import Mesh, joined
from .repair import repair_mesh


def load_parts(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: str = "z",
) -> dict[str, Mesh]:
    """Read the named parts of a mesh file, each as a separate mesh.

    A part's name is "node/mesh/material": node, mesh and material of a GLB, glTF or
    DAE, object, group and material of an OBJ; "-" stands for one that there is not. The
    second part of a name ends in "#2". Names are in the order of the file, and the same
    in every run. Parts have the positions that `load_mesh` gives them with the same
    arguments. A part may be closed, or a patch of a surface: no hole is filled, and the
    front of a patch is where the file has it.

    Args:
        path: the file.
        unit: length of one file unit, as a name ("mm") or in metres.
        height: instead of `unit`: the extent of all parts along the up axis [m].
        up: the file's axis that points up.

    Raises:
        InputError: as `load_mesh`.
    """
    path = Path(path).expanduser()
    scale = file_scale(path, unit=unit, height=height, up=up)
    return separate_parts(path, read_mesh(path, read_contents(path)), scale)


def separate_parts(path: Path, mesh: FileMesh, scale: FileScale) -> dict[str, Mesh]:
    """The parts of the mesh of a file, as `load_parts` returns them.

    Raises:
        InputError: for a flat mesh that the height would scale.
    """
    placed = placed_mesh(path, mesh, scale)
    counts = np.bincount(placed.part, minlength=len(placed.names))
    by_part = placed.faces[np.argsort(placed.part, kind="stable")]
    faces_of_parts = np.split(by_part, np.cumsum(counts)[:-1])
    meshes = {}
    for label, faces in zip(unique_labels(placed.names), faces_of_parts, strict=True):
        if not len(faces):
            continue
        # Its own vertices alone: repairing all of them takes as long as all parts.
        used, renumbered = np.unique(faces, return_inverse=True)
        patch = Mesh(
            vertices=placed.vertices[used],
            faces=renumbered.reshape(faces.shape),
            name=label,
            axes=scale.axes,
        )
        # Welded, so that a closed part is watertight.
        meshes[label] = repair_mesh(patch, max_hole_edges=0, turns_open=False)
    return meshes


def matching_parts(pattern: str, names: Iterable[str]) -> list[str]:
    """Names of parts that a pattern stands for.

    A pattern with a "/" is that of a whole name. One without matches the node, the mesh
    or the material. In it "*" stands for any characters, and "?" for one.
    """
    names = list(names)
    if pattern in names:
        return [pattern]
    expression = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    if "/" in pattern:
        return [name for name in names if re.fullmatch(expression, name)]
    return [
        name
        for name in names
        if any(re.fullmatch(expression, word) for word in _words(name))
    ]


def _words(name: str) -> list[str]:
    return [name, *re.sub(r"#\d+$", "", name).split("/")]


_MAX_LISTED = 12
"""Largest number of names of parts in a message."""


def pattern_of_parts(
    names: list[str], patterns: list[str], argument: str
) -> dict[str, str]:
    """The pattern that is for each part, by the part's name.

    A pattern without "/" matches the node, the mesh or the material of a part; "*" is
    for all parts that nothing else names.

    Raises:
        InputError: for a part of no or of several patterns, or a pattern of no part.
    """
    listed = ", ".join(names[:_MAX_LISTED])
    if len(names) > _MAX_LISTED:
        listed += f" and {len(names) - _MAX_LISTED:,} more (jaxthermo parts lists them)"
    pattern_of: dict[str, str] = {}
    for pattern in patterns:
        matching = [] if pattern == "*" else matching_parts(pattern, names)
        if not matching and pattern != "*":
            raise InputError(
                f"{argument}: there is no part {pattern!r}; there are {listed}"
            )
        for name in matching:
            earlier = pattern_of.setdefault(name, pattern)
            # A whole name says more than a pattern.
            if name == pattern:
                pattern_of[name] = pattern
            elif earlier not in (name, pattern):
                raise InputError(
                    f"{argument}: both {earlier!r} and {pattern!r} match the part "
                    f"{name!r}: give its whole name"
                )
    missing = [name for name in names if name not in pattern_of]
    if missing and "*" not in patterns:
        raise InputError(
            f"{argument}: the part {missing[0]!r} has none: give one for each of "
            f"{listed}, or '*' for all others"
        )
    return {name: pattern_of.get(name, "*") for name in names}


class JoinedParts(NamedTuple):
    """One mesh of several parts."""

    mesh: Mesh
    face_part: Int[np.ndarray, " f"]
    """Number of the part that each face belongs to."""


def joined_parts(meshes: Sequence[Mesh]) -> JoinedParts:
    """Concatenate meshes in their order; a single one is returned as it is."""
    counts = [len(mesh.faces) for mesh in meshes]
    face_part = np.repeat(np.arange(len(meshes)), counts)
    if len(meshes) == 1:
        return JoinedParts(meshes[0], face_part)
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in meshes])
    first = meshes[0]
    mesh = Mesh(vertices=vertices, faces=faces, name=first.name, axes=first.axes)
    return JoinedParts(mesh, face_part)
