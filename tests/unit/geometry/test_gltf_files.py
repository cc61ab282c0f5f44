"""GLB and glTF files: what extensions store otherwise is read, or refused by name."""

import base64
import json
import os
from typing import Any
from unittest.mock import Mock

import DracoPy
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.files import file_mesh
from jaxthermo.geometry.load import load_mesh
from tests.mesh_files import (
    GIVEN,
    GltfWriter,
    box_gltf,
    box_primitive,
    draco_primitive,
)


BOX = shapes.box((1.0, 2.0, 3.0))
CENTRED = BOX.vertices - BOX.bounds.mean(0)
HALF_TURN = np.sqrt(0.5)


@pytest.fixture
def read(tmp_path):
    """A function from a writer of a glTF to its mesh, as the file has it."""

    def load(writer: GltfWriter) -> jt.Mesh:
        path = tmp_path / "a.glb"
        path.write_bytes(writer.glb())
        return load_mesh(path, unit="m", repair=False)

    return load


def refused(read, writer) -> str:
    with pytest.raises(InputError) as caught:
        read(writer)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def is_box(mesh, size=(1.0, 2.0, 3.0), rel=1e-6) -> bool:
    """True for one closed box of that size."""
    extent = np.ptp(mesh.bounds, axis=0)
    volume_fits = mesh.volume == pytest.approx(np.prod(size), rel=rel)
    return mesh.is_watertight and volume_fits and extent == pytest.approx(size, rel=rel)


def test_given_quantized_file():
    mesh = load_mesh(GIVEN / "quantized.glb", unit="m", repair=False)
    assert is_box(mesh)


def test_given_instanced_file():
    mesh = load_mesh(GIVEN / "instanced.glb", unit="m", repair=False)
    assert mesh.volume == pytest.approx(18.0)
    assert mesh.area == pytest.approx(66.0)
    assert len(jt.load_parts(GIVEN / "instanced.glb", unit="m")) == 3


def test_given_file_of_which_draco_does_not_know():
    with pytest.raises(InputError, match="compressed with Draco"):
        load_mesh(GIVEN / "draco.glb", unit="m")


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2"])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantized_positions(read, dtype, normalized):
    """Fractions of the largest number of their type, or plain whole numbers."""
    largest = np.iinfo(dtype).max
    lowest = 0 if dtype.startswith("u") else -largest
    stored = np.where(CENTRED > 0.0, largest, lowest)
    span = (largest - lowest) / (largest if normalized else 1.0)
    writer = GltfWriter()
    writer.require("KHR_mesh_quantization")
    position = writer.accessor(stored, dtype, normalized=normalized)
    indices = writer.accessor(BOX.faces.reshape(-1), "u1")
    mesh = writer.mesh({"attributes": {"POSITION": position}, "indices": indices})
    writer.node(mesh=mesh, scale=(np.array([1.0, 2.0, 3.0]) / span).tolist())
    assert is_box(read(writer))


def test_interleaved_positions(read):
    """Positions and normals in turn, as most engines write them."""
    writer = box_gltf()
    rows = np.hstack([CENTRED, CENTRED]).astype("<f4")
    view = writer.view(rows.tobytes())
    writer.document["bufferViews"][view]["byteStride"] = 24
    writer.document["accessors"][0]["bufferView"] = view
    assert is_box(read(writer))


@pytest.mark.parametrize("with_base", [True, False])
def test_sparse_positions(read, with_base):
    """Some rows of an array, or all rows of one that is zero, have other values."""
    writer = box_gltf()
    changed = np.flatnonzero(CENTRED[:, 0] > 0.0) if with_base else np.arange(8)
    stretched = CENTRED * (4.0, 1.0, 1.0)
    bounds = np.where(np.isin(np.arange(8), changed)[:, None], stretched, CENTRED)
    accessor = writer.document["accessors"][0]
    accessor |= {"min": bounds.min(0).tolist(), "max": bounds.max(0).tolist()}
    accessor["sparse"] = {
        "count": len(changed),
        "indices": {
            "bufferView": writer.view(changed.astype("<u2").tobytes()),
            "componentType": 5123,
        },
        "values": {
            "bufferView": writer.view(stretched[changed].astype("<f4").tobytes())
        },
    }
    if not with_base:
        del accessor["bufferView"]
    assert is_box(read(writer), size=(2.5 if with_base else 4.0, 2.0, 3.0))


@pytest.mark.parametrize("mode", [5, 6])
@pytest.mark.parametrize("is_indexed", [True, False])
def test_strips_and_fans(read, mode, is_indexed):
    """A regular polygon of 9 corners: its area, seen from above all over."""
    count = 9
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    order = np.arange(count)
    if mode == 5:
        # To and fro: 0, 1, 8, 2, 7, ...
        order = np.array([0, *np.column_stack([order[1:5], order[:4:-1]]).reshape(-1)])
    writer = GltfWriter()
    primitive: Any = {"mode": mode}
    if is_indexed:
        primitive["indices"] = writer.accessor(order, "u1")
        order = np.arange(count)
    primitive["attributes"] = {"POSITION": writer.accessor(ring[order])}
    writer.node(mesh=writer.mesh(primitive))
    mesh = read(writer)
    assert len(mesh.faces) == count - 2
    upward = mesh.area_vectors[:, 2]
    assert (upward > 0.0).all()
    assert upward.sum() == pytest.approx(count / 2 * np.sin(2.0 * np.pi / count))


def test_points_and_lines_are_no_surface(read):
    writer = box_gltf()
    primitives = writer.document["meshes"][0]["primitives"]
    primitives += [primitives[0] | {"mode": mode} for mode in range(4)]
    assert is_box(read(writer))


def test_instances_are_turned_and_scaled(read):
    writer = box_gltf(translation=[0.0, 0.0, 100.0])
    writer.require("EXT_mesh_gpu_instancing")
    attributes = {
        "TRANSLATION": writer.accessor([(0.0, 0.0, 0.0), (10.0, 0.0, 0.0)]),
        "ROTATION": writer.accessor([(0, 0, 0, 1), (0, 0, HALF_TURN, HALF_TURN)]),
        "SCALE": writer.accessor([(1.0, 1.0, 1.0), (2.0, 1.0, 1.0)]),
    }
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    writer.document["nodes"][0]["extensions"] = extensions
    mesh = read(writer)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(6.0 + 12.0)
    # The second is 2 along x and, as it is turned by 90 degrees, 2 along y.
    assert mesh.bounds == pytest.approx(np.array([(-0.5, -1, 98.5), (11, 1, 101.5)]))


def test_nodes_within_nodes_and_reflections(read):
    """A child's place is within its parent; a mirror image is not inside out."""
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer))
    child = writer.node(mesh=mesh, translation=[1.0, 0.0, 0.0], scale=[-1.0, 1.0, 1.0])
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    matrix[:3, 3] = 0.0, 0.0, 5.0
    writer.node(children=[child], matrix=matrix.T.reshape(-1).tolist())
    placed = read(writer)
    assert placed.volume == pytest.approx(48.0)
    assert placed.bounds.mean(0) == pytest.approx([2.0, 0.0, 5.0])


@pytest.mark.parametrize(
    ("children", "scenes", "number"),
    [
        ({0: [0]}, [{"nodes": [0]}], 0),
        ({0: [1], 1: [0]}, [{"nodes": [0]}], 0),
        ({0: [2], 1: [2]}, [{"nodes": [0, 1]}], 2),
        ({}, [{"nodes": [1, 1]}], 1),
        # Without a scene nothing above the circle leads to it.
        ({1: [2], 2: [1]}, [], 1),
        ({0: [0]}, [], 0),
    ],
)
def test_nodes_that_are_no_tree_are_refused(read, children, scenes, number):
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer))
    for node in range(3):
        writer.node(
            mesh=mesh, **({"children": children[node]} if node in children else {})
        )
    writer.document["scenes"] = scenes
    message = refused(read, writer)
    assert f"the node {number} is" in message
    assert "nodes are no tree" in message


def test_nodes_are_nested_as_deep_as_a_file_has_them(read):
    writer = GltfWriter()
    depth = 3000
    for node in range(depth - 1):
        writer.node(children=[node + 1], translation=[0.0, 0.0, 1.0])
    writer.node(mesh=writer.mesh(box_primitive(writer)))
    assert read(writer).bounds.mean(0) == pytest.approx([0.0, 0.0, depth - 1.0])


def test_morph_targets_and_skins_are_as_at_rest(read):
    writer = GltfWriter()
    primitive = box_primitive(writer)
    offset = np.where(CENTRED > 0.0, (2.0, 0.0, 0.0), 0.0)
    primitive["targets"] = [{"POSITION": writer.accessor(offset)}]
    joints = np.zeros((8, 4))
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (8, 1))
    primitive["attributes"] |= {
        "JOINTS_0": writer.accessor(joints, "u1"),
        "WEIGHTS_0": writer.accessor(weights),
    }
    inverse = np.diag([0.5, 0.5, 0.5, 1.0]).reshape(1, 16)
    writer.document["skins"] = [
        {"joints": [1], "inverseBindMatrices": writer.accessor(inverse)}
    ]
    # The place of a node with a skin does not count: its joints say where it is.
    mesh = writer.mesh(primitive, weights=[0.5])
    writer.node(mesh=mesh, skin=0, scale=[100.0, 100.0, 100.0])
    writer.node(scale=[2.0, 2.0, 2.0], translation=[7.0, 0.0, 0.0])
    placed = read(writer)
    assert is_box(placed, size=(2.0, 2.0, 3.0))
    assert placed.bounds[0, 0] == pytest.approx(6.5)


@pytest.fixture
def compressed():
    """A glTF with a box that is compressed with Draco."""
    writer = GltfWriter()
    writer.node(mesh=writer.mesh(draco_primitive(writer, CENTRED, BOX.faces)))
    return writer


def test_draco(read, compressed):
    assert is_box(read(compressed), rel=1e-3)


def test_a_mesh_of_many_nodes_is_decompressed_once(read, compressed, monkeypatch):
    decode = Mock(wraps=DracoPy.decode)
    monkeypatch.setattr(DracoPy, "decode", decode)
    compressed.node(mesh=0, translation=[5.0, 0.0, 0.0])
    assert read(compressed).volume == pytest.approx(12.0, rel=1e-3)
    decode.assert_called_once()


def test_draco_names_the_package_that_it_needs(read, compressed, monkeypatch):
    monkeypatch.setattr(file_mesh, "is_installed", lambda name: False)
    message = refused(read, compressed)
    assert "compressed with Draco need the package DracoPy" in message
    assert "make env EXTRAS=formats" in message


def test_draco_with_a_plain_copy_needs_no_package(read, compressed, monkeypatch):
    plain = box_primitive(compressed)
    monkeypatch.setattr(file_mesh, "is_installed", lambda name: False)
    compressed.document["meshes"][0]["primitives"][0] |= plain
    assert is_box(read(compressed))


def test_draco_of_another_number_of_vertices(read, compressed):
    compressed.document["accessors"][0]["count"] = 9
    assert "9 vertices and 36 indices, and 8 and 36" in refused(read, compressed)


@pytest.mark.parametrize(
    "name", ["KHR_implicit_shapes", "EXT_geometry_of_the_future", "MSFT_lod"]
)
def test_required_extensions_are_refused_by_name(read, name):
    writer = box_gltf()
    writer.require("KHR_materials_unlit", name)
    message = refused(read, writer)
    assert f"requires {name}, which is not understood" in message
    assert "KHR_materials" not in message


@pytest.mark.parametrize("prefix", ["EXT", "KHR"])
def test_meshopt_names_the_program_that_decompresses(read, prefix):
    name = f"{prefix}_meshopt_compression"
    writer = box_gltf()
    writer.require(name)
    assert "gltfpack -noq" in refused(read, writer)
    # Not required: a second buffer has the plain numbers, if the file has that.
    view: Any = {"buffer": 0, "byteLength": 96}
    view["extensions"] = {name: {"buffer": 0, "byteLength": 96, "count": 8}}
    writer.document["bufferViews"][0] |= view
    del writer.document["extensionsRequired"]
    assert is_box(read(writer))


def test_extensions_of_materials_are_no_hindrance(read):
    writer = box_gltf()
    writer.require("KHR_materials_unlit", "KHR_texture_transform", "EXT_texture_webp")
    assert is_box(read(writer))


@pytest.mark.parametrize(
    ("collection", "entry", "misspelt"),
    [
        ("nodes", "scale", "scael"),
        ("nodes", "extensions", "extnesions"),
        ("accessors", "normalized", "normlaized"),
        ("nodes", "mesh", "mehs"),
        ("nodes", "translation", "translations"),
        ("bufferViews", "byteStride", "byteStrdie"),
    ],
)
def test_misspelt_entries_are_not_ignored(read, collection, entry, misspelt):
    writer = box_gltf()
    writer.document[collection][0][misspelt] = 1
    assert f"{misspelt!r}, perhaps for {entry!r}" in refused(read, writer)
    del writer.document[collection][0][misspelt]
    writer.document[collection][0] |= {"ourOwnNumber": 1, "targetNames": []}
    assert is_box(read(writer))


@pytest.mark.parametrize(
    ("collection", "entry", "value", "reason"),
    [
        ("accessors", "count", 9, "does not fit"),
        ("accessors", "count", -8, "does not fit"),
        ("accessors", "count", 10**12, "does not fit"),
        ("accessors", "max", [0.5, 1.0, 9.0], "it states"),
        ("bufferViews", "byteLength", 10**9, "ends outside"),
        ("bufferViews", "byteOffset", -4, "ends outside"),
        ("nodes", "mesh", -1, "does not exist"),
        ("nodes", "children", [0], "reached twice"),
        ("nodes", "rotation", [0, 0, 0, 3.0], "no rotation"),
        ("nodes", "matrix", [1.0] * 16, "no placement"),
    ],
)
def test_wrong_entries(read, collection, entry, value, reason):
    writer = box_gltf()
    writer.document[collection][0][entry] = value
    if entry == "children":
        writer.node(children=[0])
    assert reason in refused(read, writer)


def test_an_index_of_another_part_is_out_of_range(read):
    """Joined with it, the vertex would exist."""
    writer = box_gltf()
    primitive = box_primitive(writer)
    primitive["indices"] = writer.accessor([0, 1, 8], "u2")
    writer.node(mesh=writer.mesh(primitive))
    writer.node(mesh=0)
    assert "a face index is out of range: 8" in refused(read, writer)


def test_buffers_beside_a_gltf_and_within(tmp_path):
    writer = box_gltf()
    uri = "data:application/octet-stream;base64,"
    uri += base64.b64encode(writer.buffer).decode()
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(writer.complete(uri)))
    assert is_box(load_mesh(path, unit="m"))
    path.write_text(json.dumps(writer.complete("the%20numbers.bin")))
    with pytest.raises(InputError, match=r"the numbers\.bin: there is no such file"):
        load_mesh(path, unit="m")
    (tmp_path / "the numbers.bin").write_bytes(writer.buffer)
    assert is_box(load_mesh(path, unit="m"))
    # The mesh is that of the numbers of today, not of those read before.
    larger = box_gltf((2.0, 2.0, 3.0))
    (tmp_path / "the numbers.bin").write_bytes(larger.buffer)
    path.write_text(json.dumps(larger.complete("the%20numbers.bin")))
    assert is_box(load_mesh(path, unit="m"), size=(2.0, 2.0, 3.0))
    (tmp_path / "the numbers.bin").write_bytes(larger.buffer[:-8])
    with pytest.raises(InputError, match="cut short: the buffer 0 has"):
        load_mesh(path, unit="m")
    (tmp_path / "the numbers.bin").unlink()
    os.mkfifo(tmp_path / "the numbers.bin")
    with pytest.raises(InputError, match="a pipe or a device"):
        load_mesh(path, unit="m")
    path.write_text(json.dumps(writer.complete("https://example.org/a.bin")))
    with pytest.raises(InputError, match="is not a file: download it"):
        load_mesh(path, unit="m")
