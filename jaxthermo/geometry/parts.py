"""Named parts of a mesh file: the nodes of a GLB, the groups and objects of an OBJ."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from .load import load_mesh
from .mesh import Mesh
from .repair import repair_mesh


_trimesh: Any = lazy_loader.load("trimesh")

# Of faces before any group.
_UNNAMED = "unnamed"

_FileMesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def load_parts(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: str = "z",
) -> dict[str, Mesh]:
    """Read the named parts of a GLB or OBJ file, each as a mesh of its own.

    Parts are where `load_mesh` with the same arguments has them. A part may be closed,
    or a patch of a surface: no hole is filled.

    Args:
        path: the file; nodes of a GLB, groups or objects of an OBJ are parts.
        unit: length of one file unit, as a name ("mm") or in metres.
        height: instead of `unit`: the extent of all parts along the up axis [m].
        up: the file's axis that points up.

    Raises:
        InputError: as `load_mesh`, and for a format without parts.
    """
    path = Path(path).expanduser()
    # All parts together, checked as a whole.
    whole = load_mesh(path, unit=unit, height=height, up=up, repair=False)
    if path.suffix.lower() == ".obj":
        vertices, faces, names = _obj_parts(path.read_text("utf-8", "replace"))
        vertices = _placed_as(whole, vertices, faces)
    elif path.suffix.lower() == ".glb":
        vertices, faces, names = whole.vertices, whole.faces, _glb_names(path)
    else:
        raise InputError(
            f"{path}: {path.suffix} files have no named parts: give a GLB with nodes, "
            "or an OBJ with groups"
        )
    assert len(names) == len(faces)
    found = {}
    for name in dict.fromkeys(names):
        own = faces[np.array(names) == name]
        part = Mesh(vertices=vertices, faces=own, name=name, axes=whole.axes)
        # Welded, so that a closed part is known as one.
        found[name] = repair_mesh(part, max_hole_edges=0)
    return found


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


def _obj_parts(
    text: str,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], list[str]]:
    """Vertices, triangles and the name of the group of each."""
    vertices, faces, names, name = [], [], [], _UNNAMED
    for key, words in _obj_lines(text):
        if key == "v":
            vertices.append([float(word) for word in words[:3]])
        elif key in ("g", "o"):
            name = " ".join(words) or _UNNAMED
        elif key == "f":
            corners = [int(word.split("/")[0]) for word in words]
            # Counted from 1, or back from the last vertex so far.
            index = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            fan = [
                (index[0], *pair) for pair in zip(index[1:], index[2:], strict=False)
            ]
            faces += fan
            names += [name] * len(fan)
    return np.array(vertices, float), np.array(faces, np.int64), names


def _obj_lines(text: str) -> Iterator[tuple[str, list[str]]]:
    for line in text.replace("\\\n", " ").splitlines():
        words = line.split("#")[0].split()
        if words:
            yield words[0], words[1:]


def _placed_as(
    whole: Mesh, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "v 3"]:
    """Vertices of the file in the axes and the scale of the whole mesh."""
    turned = np.empty_like(vertices)
    for ours, axis in enumerate(whole.axes):
        sign = -1.0 if axis.startswith("-") else 1.0
        turned[:, ours] = sign * vertices[:, "xyz".index(axis[-1])]
    extent = float(np.ptp(turned[faces].reshape(-1, 3), axis=0).max())
    return turned * (float(np.ptp(whole.bounds, axis=0).max()) / extent)
