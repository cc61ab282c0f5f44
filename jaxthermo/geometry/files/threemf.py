"""3MF files, read by trimesh."""

import io
from typing import Any

import lazy_loader
import numpy as np

from .file_mesh import (
    ABSENT,
    FileContents,
    FileMesh,
    PartName,
    joined_parts,
    placed_part,
    require_package,
)


_trimesh: Any = lazy_loader.load("trimesh")

_METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "millimeters": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}


def read_3mf(contents: FileContents) -> FileMesh:
    """Read a 3MF: a part for each object that is built."""
    require_package("lxml", "3MF files")
    require_package("networkx", "3MF files")
    scene = _trimesh.load_scene(
        io.BytesIO(contents.data), file_type="3mf", process=False, postprocess=False
    )
    parts = []
    units = ""
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        units = str(mesh.metadata.get("units"))
        name = PartName(node=str(node), mesh=str(geometry), material=ABSENT)
        vertices = np.asarray(mesh.vertices, np.float64)
        faces = np.asarray(mesh.faces, np.int64)
        parts.append(placed_part(name, vertices=vertices, faces=faces, matrix=matrix))
    return joined_parts(parts, metres_per_unit=_METRES.get(units))
