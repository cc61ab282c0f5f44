"""Small mesh files, written from code: glTF of a box in many forms, and polygons."""

import json
import struct
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np

from jaxthermo.geometry import shapes


GIVEN = Path(__file__).parent / "data" / "mesh_and_heat"
"""Folder of small files that were read wrongly once."""

_COMPONENT_TYPES = {
    "i1": 5120,
    "u1": 5121,
    "i2": 5122,
    "u2": 5123,
    "u4": 5125,
    "f4": 5126,
}
_ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def exported(mesh: Any, file_type: str) -> bytes:
    """A mesh or scene of trimesh as a file of its kind."""
    content = mesh.export(file_type=file_type)
    return content.encode() if isinstance(content, str) else bytes(content)


class GltfWriter:
    """A glTF in the making, with one buffer."""

    def __init__(self) -> None:
        self.document: Any = {"asset": {"version": "2.0"}, "scene": 0}
        self.document |= {"bufferViews": [], "accessors": [], "nodes": [], "meshes": []}
        self.buffer = b""

    def view(self, content: bytes) -> int:
        """Number of a new view of the buffer with this content."""
        views = self.document["bufferViews"]
        offset = len(self.buffer)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(content)})
        self.buffer += content + bytes(-len(content) % 4)
        return len(views) - 1

    def accessor(self, numbers: Any, dtype: str = "f4", **entries: Any) -> int:
        """Number of a new accessor of these rows."""
        rows = np.asarray(numbers).astype("<" + dtype)
        rows = rows.reshape(len(rows), -1)
        if rows.shape[1] == 3:
            entries = {
                "min": rows.min(0).tolist(),
                "max": rows.max(0).tolist(),
            } | entries
        accessors = self.document["accessors"]
        accessors.append(
            {
                "bufferView": self.view(rows.tobytes()),
                "componentType": _COMPONENT_TYPES[dtype],
                "count": len(rows),
                "type": _ELEMENT_TYPES[rows.shape[1]],
            }
            | entries
        )
        return len(accessors) - 1

    def mesh(self, *primitives: Any, **entries: Any) -> int:
        """Number of a new mesh."""
        self.document["meshes"].append({"primitives": list(primitives)} | entries)
        return len(self.document["meshes"]) - 1

    def node(self, **entries: Any) -> int:
        """Number of a new node."""
        self.document["nodes"].append(entries)
        return len(self.document["nodes"]) - 1

    def require(self, *extensions: str) -> None:
        """Announce extensions as required."""
        self.document["extensionsUsed"] = list(extensions)
        self.document["extensionsRequired"] = list(extensions)

    def complete(self, uri: str | None = None) -> Any:
        """The document, with a scene of all nodes but children if it has none."""
        nodes = self.document["nodes"]
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
        buffer: Any = {"byteLength": len(self.buffer)} | ({"uri": uri} if uri else {})
        scenes = self.document.get("scenes", [{"nodes": roots}])
        return self.document | {"scenes": scenes, "buffers": [buffer]}

    def glb(self) -> bytes:
        """The file as GLB."""
        text = json.dumps(self.complete()).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.buffer), b"BIN\0") + self.buffer
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def box_gltf(size: Any = (1.0, 2.0, 3.0), **node: Any) -> GltfWriter:
    """A glTF of one node with a box around its origin."""
    writer = GltfWriter()
    writer.node(mesh=writer.mesh(box_primitive(writer, size)), **node)
    return writer


def box_primitive(writer: GltfWriter, size: Any = (1.0, 2.0, 3.0)) -> Any:
    """A primitive of a box around the origin."""
    box = shapes.box(tuple(size))
    vertices = box.vertices - box.bounds.mean(0)
    position = writer.accessor(vertices)
    indices = writer.accessor(box.faces.reshape(-1), "u2")
    return {"attributes": {"POSITION": position}, "indices": indices}


def draco_primitive(writer: GltfWriter, vertices: np.ndarray, faces: np.ndarray) -> Any:
    """A primitive whose arrays are compressed with Draco, and only so."""
    numbers = (writer.accessor(vertices), writer.accessor(faces.reshape(-1), "u2"))
    for number in numbers:
        del writer.document["accessors"][number]["bufferView"]
    content = DracoPy.encode(vertices, faces, quantization_bits=14)
    name = "KHR_draco_mesh_compression"
    extension = {"bufferView": writer.view(content), "attributes": {"POSITION": 0}}
    writer.require(name)
    return {
        "attributes": {"POSITION": numbers[0]},
        "indices": numbers[1],
        "extensions": {name: extension},
    }


def prism_polygons(
    outline: np.ndarray, height: float
) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices and faces, of any number of corners, of an upright prism.

    The outline runs counter-clockwise seen from above.
    """
    count = len(outline)
    lower = np.column_stack([outline, np.zeros(count)])
    upper = np.column_stack([outline, np.full(count, height)])
    sides = [
        [i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)
    ]
    faces = [list(range(count))[::-1], list(range(count, 2 * count)), *sides]
    return np.concatenate([lower, upper]), faces


def polygon_file(suffix: str, vertices: np.ndarray, faces: list[list[int]]) -> bytes:
    """A file with faces of any number of corners, in one of four formats."""
    rows = [" ".join(f"{x:.17g}" for x in vertex) for vertex in vertices]
    if suffix == "obj":
        corners = [" ".join(str(corner + 1) for corner in face) for face in faces]
        lines = [f"v {row}" for row in rows] + [f"f {row}" for row in corners]
        return "\n".join(lines).encode() + b"\n"
    counted = [" ".join(map(str, [len(face), *face])) for face in faces]
    if suffix == "off":
        head = ["OFF", f"{len(vertices)} {len(faces)} 0"]
        return "\n".join([*head, *rows, *counted]).encode() + b"\n"
    order = {"ply": "ascii", "ply_little": "binary_little_endian"}
    order["ply_big"] = "binary_big_endian"
    head = ["ply", f"format {order[suffix]} 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    header = "\n".join([*head, "end_header"]).encode() + b"\n"
    if suffix == "ply":
        return header + "\n".join([*rows, *counted]).encode() + b"\n"
    sign = ">" if suffix == "ply_big" else "<"
    content = vertices.astype(sign + "f8").tobytes()
    for face in faces:
        content += struct.pack(f"{sign}B{len(face)}i", len(face), *face)
    return header + content
