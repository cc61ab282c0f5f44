"""Meshes as GLB files (glTF 2.0), coloured at their vertices or by a texture.

Z is up here and y is up in glTF: a root node turns the scene. Materials are unlit,
since false colours must not be shaded. The exporter of trimesh rounds linear colours to
8 bits, which would show bands, and writes neither samplers nor unlit materials.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NotRequired, TypedDict

import numpy as np
from jaxtyping import Float, Int, UInt8

from ...atomic import replacing
from ...geometry.mesh import Pose


_FLOAT = 5126
_UINT = 5125
_VECTORS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_VERTICES = 34962
_INDICES = 34963
_LINEAR = 9729
_CLAMP = 33071
# From z up to y up, columns first.
_TURNED = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
_UNLIT = "KHR_materials_unlit"


class GltfMesh(NamedTuple):
    """A mesh at its pose."""

    name: str
    pose: Pose
    faces: Int[np.ndarray, "f 3"]
    attributes: Mapping[str, Float[np.ndarray, "v *k"]]
    """By name: POSITION [m], NORMAL, COLOR_0 (linear), TEXCOORD_0, and others that
    begin with an underscore."""
    texture: bytes | None = None
    """PNG of the colours, in sRGB."""
    extras: Mapping[str, Any] = {}


def linear_colours(srgb: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Colours as COLOR_0 has them: linear, where PNG files and palettes are sRGB."""
    value = np.asarray(srgb, float) / 255
    curved = ((value + 0.055) / 1.055) ** 2.4
    return np.where(value <= 0.04045, value / 12.92, curved).astype(np.float32)


class _BufferView(TypedDict):
    """Bytes of the binary part."""

    buffer: int
    byteOffset: int
    byteLength: int
    target: NotRequired[int]


class _Accessor(TypedDict):
    """Array in the binary part."""

    bufferView: int
    componentType: int
    count: int
    type: str
    min: list[float]
    max: list[float]


class _Node(TypedDict):
    """Object of the scene, with a mesh or with objects below it."""

    name: str
    matrix: list[float]
    mesh: NotRequired[int]
    children: NotRequired[list[int]]


class _Primitive(TypedDict):
    """Triangles of one material."""

    attributes: dict[str, int]
    indices: int
    material: int


class _Mesh(TypedDict):
    name: str
    primitives: list[_Primitive]
    extras: NotRequired[Mapping[str, Any]]


class _Material(TypedDict):
    name: str
    pbrMetallicRoughness: dict[str, float | dict[str, int]]
    extensions: dict[str, dict[str, str]]


class _Buffer:
    """The binary part of a file, with the accessors to it."""

    def __init__(self):
        self.data = bytearray()
        self.views: list[_BufferView] = []
        self.accessors: list[_Accessor] = []

    def add(self, content: bytes, target: int | None = None) -> int:
        """Append bytes; returns the number of their view."""
        self.data += b"\0" * (-len(self.data) % 4)
        start = len(self.data)
        view: _BufferView = {
            "buffer": 0,
            "byteOffset": start,
            "byteLength": len(content),
        }
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.data += content
        return len(self.views) - 1

    def add_array(self, values: np.ndarray, target: int) -> int:
        """Append an array; returns the number of its accessor."""
        indices = target == _INDICES
        packed = np.ascontiguousarray(values, "<u4" if indices else "<f4")
        columns = packed.reshape(len(packed), -1)
        self.accessors.append(
            {
                "bufferView": self.add(packed.tobytes(), target=target),
                "componentType": _UINT if indices else _FLOAT,
                "count": len(columns),
                "type": _VECTORS[columns.shape[1]],
                "min": columns.min(axis=0).tolist(),
                "max": columns.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1


def write_meshes(
    path: str | Path, meshes: Sequence[GltfMesh], extras: Mapping[str, Any]
) -> None:
    """Write meshes as nodes of one scene, with plain values as its extras.

    Raises:
        InputError: if the file cannot be written.
    """
    buffer = _Buffer()
    numbers = range(1, len(meshes) + 1)
    root: _Node = {"name": "z_up", "matrix": list(_TURNED), "children": list(numbers)}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "jaxthermo"},
        "scene": 0,
        "scenes": [{"nodes": [0], "extras": dict(extras)}],
        "nodes": [root, *(_node(number - 1, meshes[number - 1]) for number in numbers)],
        "meshes": [_mesh(number, mesh, buffer) for number, mesh in enumerate(meshes)],
        "materials": [],
        "extensionsUsed": [_UNLIT],
    }
    for mesh in meshes:
        tree["materials"].append(_material(mesh, tree, buffer))
    tree |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    tree["buffers"] = [{"byteLength": len(buffer.data)}]
    with replacing(path) as temporary:
        temporary.write_bytes(_packed(tree, bytes(buffer.data)))


def _node(number: int, mesh: GltfMesh) -> _Node:
    matrix = np.eye(4)
    matrix[:3, :3] = mesh.pose.rotation
    matrix[:3, 3] = mesh.pose.translation
    return {"name": mesh.name, "mesh": number, "matrix": matrix.T.ravel().tolist()}


def _mesh(number: int, mesh: GltfMesh, buffer: _Buffer) -> _Mesh:
    primitive: _Primitive = {
        "attributes": {
            name: buffer.add_array(np.asarray(values), _VERTICES)
            for name, values in mesh.attributes.items()
        },
        "indices": buffer.add_array(np.asarray(mesh.faces).ravel(), _INDICES),
        "material": number,
    }
    description: _Mesh = {"name": mesh.name, "primitives": [primitive]}
    if mesh.extras:
        description["extras"] = dict(mesh.extras)
    return description


def _material(mesh: GltfMesh, tree: dict[str, Any], buffer: _Buffer) -> _Material:
    # Rough, for viewers that light it nevertheless.
    colours: dict[str, float | dict[str, int]]
    colours = {"metallicFactor": 0, "roughnessFactor": 1}
    if mesh.texture is not None:
        images = tree.setdefault("images", [])
        view = buffer.add(mesh.texture)
        images.append({"bufferView": view, "mimeType": "image/png"})
        # Without mipmaps, which would mix triangles that are apart on the surface.
        filters = {"magFilter": _LINEAR, "minFilter": _LINEAR}
        tree["samplers"] = [{**filters, "wrapS": _CLAMP, "wrapT": _CLAMP}]
        textures = tree.setdefault("textures", [])
        textures.append({"source": len(images) - 1, "sampler": 0})
        colours["baseColorTexture"] = {"index": len(textures) - 1}
    return {
        "name": mesh.name,
        "pbrMetallicRoughness": colours,
        "extensions": {_UNLIT: {}},
    }


def _packed(tree: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(tree, allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)

    def word(number: int) -> bytes:
        return number.to_bytes(4, "little")

    chunks = word(len(text)) + b"JSON" + text + word(len(data)) + b"BIN\0" + data
    return b"glTF" + word(2) + word(12 + len(chunks)) + chunks
