"""Named parts of a mesh file, and patterns of their names."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from .files.file_mesh import FileMesh, unique_labels
from .files.read import read_contents, read_mesh
from .load import FileScale, file_scale, placed_mesh
from .mesh import Mesh
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
    arguments. A part may be closed, or a patch of a surface: no hole is filled.

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
        meshes[label] = repair_mesh(patch, max_hole_edges=0)
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
