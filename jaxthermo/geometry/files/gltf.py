"""GLB and glTF files: nodes, instances, meshes and materials as parts."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

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
from .gltf_data import GltfData, gltf_data


_draco: Any = lazy_loader.load("DracoPy")

_POINTS_AND_LINES = (0, 1, 2, 3)
_TRIANGLES = 4
_STRIP = 5
_FAN = 6

_DRACO = "KHR_draco_mesh_compression"
_INSTANCES = "EXT_mesh_gpu_instancing"

_MAX_DEVIATION = 0.01
"""Difference of positions from the bounds that the file states, over its extent, that
quantization may cause [-]."""


class _Arrays(NamedTuple):
    """Decoded arrays of a primitive."""

    attributes: dict[str, np.ndarray]
    indices: Int[np.ndarray, " n"]


class _Primitive(NamedTuple):
    """Triangles of a mesh that are of one material."""

    content: Any
    """Its object in the JSON."""
    arrays: _Arrays
    faces: Int[np.ndarray, "f 3"]
    material: str


class _Node(NamedTuple):
    """A node with its place in the scene."""

    number: int
    matrix: Float[np.ndarray, "4 4"]
    """From its coordinates to those of the scene."""


def read_gltf(contents: FileContents) -> FileMesh:
    """Read a glTF or GLB: a part for each node, instance and primitive of its mesh.

    The scene is the default one; morph targets and skins are as at rest. Units are
    metres.
    """
    data = gltf_data(contents.data, contents.files)
    nodes = list(_nodes(data))
    matrices = {node.number: node.matrix for node in nodes}
    # Decoded once: assemblies have a mesh, such as a screw, in many nodes.
    primitives: dict[int, list[_Primitive]] = {}
    parts = []
    for node in nodes:
        content = data.item("nodes", node.number)
        if "mesh" not in content:
            continue
        mesh_number = content["mesh"]
        mesh = data.item("meshes", mesh_number)
        if mesh_number not in primitives:
            primitives[mesh_number] = _primitives(data, mesh)
        placements = [node.matrix @ instance for instance in _instances(data, content)]
        for primitive in primitives[mesh_number]:
            arrays = primitive.arrays
            faces = primitive.faces
            positions = _morphed(data, primitive.content, arrays, content, mesh)
            name = PartName(
                node=content.get("name") or f"node{node.number}",
                mesh=mesh.get("name") or f"mesh{mesh_number}",
                material=primitive.material,
            )
            if "skin" in content:
                vertices = _skinned(data, arrays, positions, content["skin"], matrices)
                parts.append(FilePart(name, vertices=vertices, faces=faces))
                continue
            for matrix in placements:
                parts.append(
                    placed_part(name, vertices=positions, faces=faces, matrix=matrix)
                )
    return joined_parts(parts, metres_per_unit=1.0)


def _primitives(data: GltfData, mesh: Any) -> list[_Primitive]:
    """Primitives of a mesh but points and lines, which have no surface."""
    primitives = []
    for content in mesh["primitives"]:
        mode = content.get("mode", _TRIANGLES)
        if mode in _POINTS_AND_LINES:
            continue
        arrays = _arrays(data, content)
        primitives.append(
            _Primitive(
                content=content,
                arrays=arrays,
                faces=_triangles(arrays.indices, mode),
                material=_material_name(data, content),
            )
        )
    return primitives


def _nodes(data: GltfData) -> Iterator[_Node]:
    """Nodes of the default scene, parents before children, in the order of the file."""
    document = data.document
    count = len(document.get("nodes", []))
    has_scene = bool(document.get("scenes"))
    if has_scene:
        roots = data.item("scenes", document.get("scene", 0)).get("nodes", [])
    else:
        children = {
            c for node in document.get("nodes", []) for c in node.get("children", [])
        }
        roots = [number for number in range(count) if number not in children]
    waiting = [_Node(number, matrix=np.eye(4)) for number in reversed(roots)]
    visited: set[int] = set()
    while waiting:
        number, parent_matrix = waiting.pop()
        node = data.item("nodes", number)
        if number in visited:
            raise FileFault(f"the node {number} is reached twice: nodes are no tree")
        visited.add(number)
        matrix = parent_matrix @ _matrix(node)
        yield _Node(number, matrix=matrix)
        waiting += [
            _Node(child, matrix=matrix) for child in reversed(node.get("children", []))
        ]
    # Without a scene each node is a root, or below one.
    if not has_scene and len(visited) < count:
        number = min(set(range(count)) - visited)
        raise FileFault(f"the node {number} is below itself: nodes are no tree")


def _matrix(node: Any) -> Float[np.ndarray, "4 4"]:
    """From the coordinates of a node to those of its parent."""
    if "matrix" not in node:
        return _placement(
            np.array(node.get("translation", (0.0, 0.0, 0.0)), float),
            rotation=np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), float),
            scale=np.array(node.get("scale", (1.0, 1.0, 1.0)), float),
        )
    matrix = np.array(node["matrix"], float).reshape(4, 4).T
    if not np.isfinite(matrix).all() or (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise FileFault("the matrix of a node is no placement")
    return matrix


def _placement(
    translation: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "4"],
    scale: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "4 4"]:
    """Matrix of a scale, a rotation by a unit quaternion (x, y, z, w), and a shift."""
    length = float(np.linalg.norm(rotation))
    if not np.isfinite([*translation, *scale]).all() or not abs(length - 1.0) < 0.05:
        raise FileFault("the placement of a node is not finite, or no rotation")
    x, y, z, w = rotation / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) + 2.0 * (w * cross + cross @ cross)) * scale
    matrix[:3, 3] = translation
    return matrix


def _instances(data: GltfData, node: Any) -> list[Float[np.ndarray, "4 4"]]:
    """Placements of the mesh of a node, within the node."""
    extension = node.get("extensions", {}).get(_INSTANCES)
    if extension is None:
        return [np.eye(4)]
    columns = {
        name: data.numbers(number) for name, number in extension["attributes"].items()
    }
    counts = {len(column) for column in columns.values()}
    if len(counts) != 1:
        raise FileFault("the instances of a node have arrays of different lengths")
    (count,) = counts
    translation = columns.get("TRANSLATION", np.zeros((count, 3)))
    rotation = columns.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    scale = columns.get("SCALE", np.ones((count, 3)))
    return [
        _placement(translation[n], rotation=rotation[n], scale=scale[n])
        for n in range(count)
    ]


def _arrays(data: GltfData, primitive: Any) -> _Arrays:
    compressed = primitive.get("extensions", {}).get(_DRACO)
    numbers = primitive["attributes"]
    wanted = ("POSITION", "JOINTS_", "WEIGHTS_")
    names = [name for name in numbers if name.startswith(wanted)]
    if "POSITION" not in names:
        raise FileFault("a primitive has no positions")
    # A file may have the same arrays without compression too.
    is_plain = "bufferView" in data.item("accessors", numbers["POSITION"])
    if compressed is not None and not is_plain:
        arrays = _decompressed(data, primitive, compressed, names)
    else:
        attributes = {name: data.numbers(numbers[name]) for name in names}
        indices = np.arange(len(attributes["POSITION"]))
        if "indices" in primitive:
            indices = data.stored(primitive["indices"]).reshape(-1).astype(np.int64)
        arrays = _Arrays(attributes, indices=indices)
    if len({len(array) for array in arrays.attributes.values()}) != 1:
        raise FileFault("the attributes of a primitive have different lengths")
    _require_bounds(data, numbers["POSITION"], arrays.attributes["POSITION"])
    return arrays


def _decompressed(
    data: GltfData, primitive: Any, compressed: Any, names: list[str]
) -> _Arrays:
    require_package("DracoPy", "meshes compressed with Draco")
    content = data.view(compressed["bufferView"])
    try:
        mesh = _draco.decode(content)
    except Exception as error:  # of the package's own kinds
        raise FileFault(
            "it is compressed with Draco, and cannot be decompressed "
            f"({str(error).strip() or type(error).__name__})"
        ) from error
    attributes = {}
    for name in names:
        attribute = mesh.get_attribute_by_unique_id(compressed["attributes"][name])
        number = primitive["attributes"][name]
        attributes[name] = data.fractions(number, attribute["data"])
    indices = np.asarray(mesh.faces, np.int64).reshape(-1)
    vertex_count = data.item("accessors", primitive["attributes"]["POSITION"])["count"]
    index_count = data.item("accessors", primitive["indices"])["count"]
    counts = (len(attributes["POSITION"]), len(indices))
    if counts != (vertex_count, index_count):
        raise FileFault(
            f"it announces {vertex_count} vertices and {index_count} indices, and "
            f"{counts[0]} and {counts[1]} were compressed"
        )
    return _Arrays(attributes, indices=indices)


def _require_bounds(
    data: GltfData, number: int, positions: Float[np.ndarray, "v 3"]
) -> None:
    """Refuse positions that are not within the bounds that the file states."""
    accessor = data.item("accessors", number)
    if "min" not in accessor or "max" not in accessor:
        return
    stated = data.fractions(number, [accessor["min"], accessor["max"]])
    bounds = np.array([positions.min(axis=0), positions.max(axis=0)])
    extent = float(np.ptp(stated, axis=0).max())
    if not (np.abs(bounds - stated) <= _MAX_DEVIATION * extent).all():
        raise FileFault(
            f"its positions reach from {bounds[0].tolist()} to {bounds[1].tolist()}, "
            f"and it states {stated[0].tolist()} to {stated[1].tolist()}"
        )


def _triangles(indices: Int[np.ndarray, " n"], mode: int) -> Int[np.ndarray, "t 3"]:
    """Triangles of a list, a strip or a fan of vertices."""
    if mode == _TRIANGLES and len(indices) % 3 == 0:
        return indices.reshape(-1, 3)
    if mode in (_STRIP, _FAN) and len(indices) >= 3:
        number = np.arange(len(indices) - 2)
        if mode == _FAN:
            corners = [number * 0, number + 1, number + 2]
        else:
            # Every second triangle of a strip has the other winding.
            is_odd = number % 2
            corners = [number, number + 1 + is_odd, number + 2 - is_odd]
        return indices[np.stack(corners, axis=1)]
    raise FileFault(f"{len(indices)} indices are no triangles of the mode {mode}")


def _material_name(data: GltfData, primitive: Any) -> str:
    if "material" not in primitive:
        return ABSENT
    number = primitive["material"]
    return data.item("materials", number).get("name") or f"material{number}"


def _morphed(
    data: GltfData, primitive: Any, arrays: _Arrays, node: Any, mesh: Any
) -> Float[np.ndarray, "v 3"]:
    """Positions with the morph targets of the file's own weights."""
    positions = arrays.attributes["POSITION"]
    targets = primitive.get("targets", [])
    weights = node.get("weights", mesh.get("weights", [0.0] * len(targets)))
    for target, weight in zip(targets, weights, strict=True):
        if weight and "POSITION" in target:
            positions = positions + weight * data.numbers(target["POSITION"])
    return positions


def _skinned(
    data: GltfData,
    arrays: _Arrays,
    positions: Float[np.ndarray, "v 3"],
    number: int,
    matrices: dict[int, Float[np.ndarray, "4 4"]],
) -> Float[np.ndarray, "v 3"]:
    """Positions in the scene of vertices that follow the joints of a skin."""
    skin = data.item("skins", number)
    joints = np.stack([matrices[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        columns = data.numbers(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
        joints = joints @ columns[: len(joints)].transpose(0, 2, 1)
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    placed = np.zeros((len(positions), 3))
    total = np.zeros((len(positions), 1))
    sets = [name for name in arrays.attributes if name.startswith("JOINTS_")]
    for name in sets:
        weights = arrays.attributes[name.replace("JOINTS_", "WEIGHTS_")]
        for joint, weight in zip(
            arrays.attributes[name].T.astype(np.int64), weights.T, strict=True
        ):
            moved = np.einsum("vij,vj->vi", joints[joint], homogeneous)
            placed += weight[:, None] * moved[:, :3]
            total += weight[:, None]
    if not (np.abs(total - 1.0) < 0.05).all():
        raise FileFault("the weights of a skin do not sum to 1")
    return placed / total
