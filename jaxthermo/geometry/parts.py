"""Named parts of a mesh file: the nodes of a GLB, the groups and objects of an OBJ."""

import os
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from .load import load_mesh
from .mesh import Mesh
from .repair import repair_mesh


_trimesh: Any = lazy_loader.load("trimesh")

# Name of the faces before any group.
_UNNAMED = "unnamed"


def load_parts(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: str = "z",
) -> dict[str, Mesh]:
    """Read the named parts of a GLB or OBJ file, each as a separate mesh.

    Parts have the positions that `load_mesh` gives them with the same arguments. A part
    may be closed, or a patch of a surface: no hole is filled.

    Args:
        path: the file; nodes of a GLB, groups or objects of an OBJ are parts.
        unit: length of one file unit, as a name ("mm") or in metres.
        height: instead of `unit`: the extent of all parts along the up axis [m].
        up: the file's axis that points up.

    Raises:
        InputError: as `load_mesh`, and for a format without parts.
    """
    path = Path(path).expanduser()
    # All parts together, so that the file is checked as one mesh.
    merged = load_mesh(path, unit=unit, height=height, up=up, repair=False)
    if path.suffix.lower() == ".obj":
        groups = _obj_parts(path.read_text("utf-8", "replace"))
        faces = groups.faces
        names = groups.names
        vertices = _placed_as(merged, groups.vertices, faces)
    elif path.suffix.lower() == ".glb":
        vertices = merged.vertices
        faces = merged.faces
        names = _glb_names(path)
    else:
        raise InputError(
            f"{path}: {path.suffix} files have no named parts: give a GLB with nodes, "
            "or an OBJ with groups"
        )
    assert len(names) == len(faces)
    meshes = {}
    for name in dict.fromkeys(names):
        part_faces = faces[np.array(names) == name]
        mesh = Mesh(vertices=vertices, faces=part_faces, name=name, axes=merged.axes)
        # Welded, so that a closed part is watertight.
        meshes[name] = repair_mesh(mesh, max_hole_edges=0)
    return meshes


def _glb_names(path: Path) -> list[str]:
    """Name of the node of each face, in the order of `load_mesh`."""
    scene = _trimesh.load_scene(
        path, process=False, skip_materials=True, maintain_order=True
    )
    names = []
    for node in scene.graph.nodes_geometry:
        _, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if isinstance(mesh, _trimesh.Trimesh):
            names += [str(node)] * len(mesh.faces)
    return names


class _ObjParts(NamedTuple):
    """Triangles of an OBJ file with the names of their groups."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    names: list[str]
    """Name of the group of each face."""


def _obj_parts(text: str) -> _ObjParts:
    vertices = []
    faces = []
    names = []
    name = _UNNAMED
    for key, words in _obj_lines(text):
        if key == "v":
            vertices.append([float(word) for word in words[:3]])
        elif key in ("g", "o"):
            name = " ".join(words) or _UNNAMED
        elif key == "f":
            corners = [int(word.split("/")[0]) for word in words]
            # Counted from 1, or back from the last vertex so far.
            index = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            fan = [(index[0], *pair) for pair in pairwise(index[1:])]
            faces += fan
            names += [name] * len(fan)
    return _ObjParts(
        vertices=np.array(vertices, float), faces=np.array(faces, np.int64), names=names
    )


def _obj_lines(text: str) -> Iterator[tuple[str, list[str]]]:
    for line in text.replace("\\\n", " ").splitlines():
        words = line.split("#")[0].split()
        if words:
            yield words[0], words[1:]


def _placed_as(
    merged: Mesh, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "v 3"]:
    """Vertices of the file in the axes and at the scale of the merged mesh."""
    turned = np.empty_like(vertices)
    for ours, axis in enumerate(merged.axes):
        sign = -1.0 if axis.startswith("-") else 1.0
        turned[:, ours] = sign * vertices[:, "xyz".index(axis[-1])]
    extent = float(np.ptp(turned[faces].reshape(-1, 3), axis=0).max())
    return turned * (float(np.ptp(merged.bounds, axis=0).max()) / extent)
