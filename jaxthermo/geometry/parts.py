"""Named parts of a mesh file, and meshes of several parts."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ..choices import UpAxis
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
    up: UpAxis = "z",
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
        # Welded, so that a closed part is watertight. Of a part without extent no face
        # would be left.
        if patch.has_extent:
            patch = repair_mesh(patch, max_hole_edges=0, turns_open=False)
        meshes[label] = patch
    return meshes


class _JoinedParts(NamedTuple):
    """One mesh of several parts."""

    mesh: Mesh
    face_part: Int[np.ndarray, " f"]
    """Number of the part that each face belongs to."""


def joined_parts(meshes: Sequence[Mesh]) -> _JoinedParts:
    """Concatenate meshes in their order; a single one is returned as it is."""
    counts = [len(mesh.faces) for mesh in meshes]
    face_part = np.repeat(np.arange(len(meshes)), counts)
    if len(meshes) == 1:
        return _JoinedParts(meshes[0], face_part)
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in meshes])
    first = meshes[0]
    mesh = Mesh(vertices=vertices, faces=faces, name=first.name, axes=first.axes)
    return _JoinedParts(mesh, face_part)
