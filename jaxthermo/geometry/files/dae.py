"""DAE files (COLLADA), read by pycollada."""

import io
from collections.abc import Iterator
from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float

from .file_mesh import (
    ABSENT,
    FileContents,
    FileFault,
    FileMesh,
    FilePart,
    PartName,
    joined_parts,
    placed_part,
    require_package,
)
from .polygons import Polygons, triangulated


_collada: Any = lazy_loader.load("collada")


class _Instance(NamedTuple):
    """A geometry in the scene."""

    node_name: str
    geometry_node: Any
    matrix: Float[np.ndarray, "4 4"]
    """From its coordinates to those of the scene."""


def read_dae(contents: FileContents) -> FileMesh:
    """Read a DAE: a part for each node and primitive of its geometry."""
    require_package("collada", "DAE files")
    unsupported = [_collada.common.DaeUnsupportedError]
    document = _collada.Collada(io.BytesIO(contents.data), ignore=unsupported)
    # Geometry of an unsupported kind would be missing without a word.
    for error in document.errors:
        if "geometry" in str(error):
            raise FileFault(f"it is of a kind that is not read ({error})")
    if document.scene is None:
        raise FileFault("it has no scene")
    parts = []
    for root in document.scene.nodes:
        for instance in _instances(root, name=ABSENT, matrix=np.eye(4)):
            parts += _parts(instance)
    return joined_parts(parts, metres_per_unit=document.assetInfo.unitmeter or 1.0)


def _instances(
    node: Any, name: str, matrix: Float[np.ndarray, "4 4"]
) -> Iterator[_Instance]:
    scene = _collada.scene
    if isinstance(node, scene.ControllerNode):
        raise FileFault(
            "it has a mesh that bones or morph targets move, which is not read",
            remedy="export it without its armature, or as GLB",
        )
    if isinstance(node, scene.GeometryNode):
        yield _Instance(name, geometry_node=node, matrix=matrix)
    elif isinstance(node, scene.Node):
        node_name = node.xmlnode.get("name") or node.id or ABSENT
        for child in node.children:
            yield from _instances(child, name=node_name, matrix=matrix @ node.matrix)


def _parts(instance: _Instance) -> Iterator[FilePart]:
    geometry = instance.geometry_node.geometry
    for source in geometry.sourceById.values():
        if isinstance(source, _collada.source.FloatSource):
            _require_count(source.xmlnode[0], present=source.data.size, noun="numbers")
    materials = {
        material.symbol: material.target.name or material.target.id
        for material in instance.geometry_node.materials
    }
    for primitive in geometry.primitives:
        polygons = _polygons(primitive)
        if polygons is None or primitive.vertex is None:
            continue
        vertices = np.asarray(primitive.vertex, np.float64)
        triangles = triangulated(vertices, polygons)
        name = PartName(
            node=instance.node_name,
            mesh=geometry.name or geometry.id or ABSENT,
            material=materials.get(primitive.material) or ABSENT,
        )
        yield placed_part(
            name, vertices=vertices, faces=triangles.faces, matrix=instance.matrix
        )


def _polygons(primitive: Any) -> Polygons | None:
    """Faces of a primitive; None for lines."""
    if isinstance(primitive, _collada.triangleset.TriangleSet):
        corners = np.asarray(primitive.vertex_index, np.int64)
        if primitive.xmlnode.tag.endswith("}triangles"):
            _require_count(primitive.xmlnode, present=len(corners), noun="triangles")
        return Polygons(corners.reshape(-1), counts=np.full(len(corners), 3))
    if isinstance(primitive, _collada.polylist.Polylist):
        counts = np.asarray(primitive.vcounts, np.int64)
        _require_count(primitive.xmlnode, present=len(counts), noun="polygons")
        corners = np.asarray(primitive.vertex_index, np.int64)
        if len(corners) != counts.sum():
            raise FileFault(
                f"its polygons have {counts.sum()} corners, {len(corners)} can be read"
            )
        return Polygons(corners, counts=counts)
    return None


def _require_count(element: Any, present: int, noun: str) -> None:
    announced = element.get("count")
    if announced is not None and int(announced) != present:
        raise FileFault(f"it announces {announced} {noun}, {present} can be read")
