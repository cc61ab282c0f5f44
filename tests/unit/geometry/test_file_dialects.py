"""Usual states of STL, OFF, PLY, OBJ, 3MF and DAE files are read as they are meant."""

import io
import re
import struct
import zipfile

import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.files import file_mesh
from jaxthermo.geometry.files.read import read_contents, read_mesh
from jaxthermo.geometry.load import load_mesh
from tests.mesh_files import GIVEN, box_gltf, exported, polygon_file


SIDES = (1.0, 2.0, 3.0)
BOX = shapes.box(SIDES)
TEXTS = ["obj", "off", "ply", "stl"]


def read(folder, name, content):
    path = folder / name
    path.write_bytes(content)
    return load_mesh(path, unit="m")


def text_file(suffix):
    """A box as text."""
    if suffix != "stl":
        return polygon_file(suffix, BOX.vertices, BOX.faces.tolist())
    box = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
    return exported(box, "stl_ascii") + b"\n"


def binary_stl(count=None, after=b""):
    """A box as binary STL that announces some number of triangles."""
    box = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
    content = exported(box, "stl")
    announced = struct.pack("<I", len(BOX.faces) if count is None else count)
    return content[:80] + announced + content[84:] + after


def is_box(mesh):
    extent = np.ptp(mesh.bounds, axis=0)
    return (
        mesh.is_watertight
        and mesh.volume == pytest.approx(6.0)
        and (extent == pytest.approx(SIDES))
    )


@pytest.mark.parametrize("ending", [b"\n", b"\r\n", b"\r"], ids=["lf", "crlf", "cr"])
@pytest.mark.parametrize("mark", ["", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("suffix", TEXTS)
def test_line_ends_and_byte_order_marks(tmp_path, suffix, mark, ending):
    content = text_file(suffix).replace(b"\n", ending)
    if mark:
        content = content.decode().encode(mark)
    assert is_box(read(tmp_path, f"a.{suffix}", content))


def test_given_stl_with_bytes_after_its_last_triangle():
    mesh = load_mesh(GIVEN / "trailing.stl", unit="m")
    assert is_box(mesh)


@pytest.mark.parametrize(
    "after", [b"\n", bytes(92), b"made by a scanner, " * 9, b"\xff" * 60]
)
def test_bytes_after_the_last_triangle_of_an_stl(tmp_path, after):
    assert is_box(read(tmp_path, "a.stl", binary_stl(after=after)))


@pytest.mark.parametrize("suffix", ["ply_little", "ply_big"])
def test_zeros_and_line_ends_after_the_last_face_of_a_ply(tmp_path, suffix):
    content = polygon_file(suffix, BOX.vertices, BOX.faces.tolist())
    assert is_box(read(tmp_path, "a.ply", content + bytes(30) + b"\r\n"))
    with pytest.raises(InputError, match="3 bytes follow the last element"):
        read(tmp_path, "a.ply", content + b"abc")


def test_bytes_after_a_glb(tmp_path):
    assert is_box(read(tmp_path, "a.glb", box_gltf(SIDES).glb() + b"appended"))


def test_an_stl_written_as_a_stream_leaves_its_count_at_0(tmp_path):
    assert is_box(read(tmp_path, "a.stl", binary_stl(count=0)))


@pytest.mark.parametrize("count", [1, 6, 11])
def test_an_stl_with_more_triangles_than_it_announces(tmp_path, count):
    with pytest.raises(InputError, match=f"announces {count} faces, and more follow"):
        read(tmp_path, "a.stl", binary_stl(count=count))


def test_solids_of_an_stl_are_parts(tmp_path):
    path = tmp_path / "two.stl"
    box = text_file("stl").split(b"\n", 1)[1].rsplit(b"endsolid", 1)[0]
    solids = [
        b"solid " + name + b"\n" + box for name in (b"left part", b"", b"left part")
    ]
    path.write_bytes(b"".join(solid + b"endsolid\n" for solid in solids))
    meshes = jt.load_parts(path, unit="m")
    assert list(meshes) == ["left part/-/-", "-/-/-", "left part/-/-#2"]
    assert all(is_box(mesh) for mesh in meshes.values())


@pytest.mark.parametrize("header", ["OFF", "COFF", "NOFF", "STCNOFF", "OFF # box\n#\n"])
def test_headers_of_an_off(tmp_path, header):
    lines = text_file("off").decode().split("\n")
    vertices = [f"{line} 9 9 9 9" if "C" in header else line for line in lines[2:10]]
    faces = [f"{line} 255 0 0  # red" for line in lines[10:-1]]
    text = "\n".join([f"{header} {lines[1]}", "", *vertices, *faces])
    assert is_box(read(tmp_path, "a.off", text.encode()))


@pytest.mark.parametrize(
    ("header", "reason"),
    [("4OFF", "other than three coordinates"), ("OFF BINARY", "a binary OFF")],
)
def test_kinds_of_off_that_are_refused(tmp_path, header, reason):
    with pytest.raises(InputError, match=reason):
        read(tmp_path, "a.off", text_file("off").replace(b"OFF", header.encode()))


@pytest.mark.parametrize("suffix", ["off", "ply", "ply_little", "ply_big"])
@pytest.mark.parametrize(("old", "new"), [("12", "11"), ("12", "13"), ("8", "7")])
def test_other_numbers_of_faces_or_vertices_than_announced(tmp_path, suffix, old, new):
    content = polygon_file(suffix, BOX.vertices, BOX.faces.tolist())
    assert content.count(old.encode() + b"\n") + content.count(b" 12 0") >= 1
    head, _, rest = content.partition(old.encode())
    with pytest.raises(InputError):
        read(tmp_path, f"a.{suffix.split('_')[0]}", head + new.encode() + rest)


def test_ply_with_further_elements_and_properties(tmp_path):
    """Colours, and lists before and after the corners, which differ in length."""
    header = (
        "ply\nformat binary_little_endian 1.0\nelement camera 1\nproperty list uchar "
        "float view\nelement vertex 8\nproperty uchar red\nproperty double x\nproperty "
        "double y\nproperty double z\nelement face 12\nproperty list uchar float uv\n"
        "property list ushort uint vertex_index\nproperty short flags\nend_header\n"
    )
    content = header.encode() + struct.pack("<B2f", 2, 1.0, 2.0)
    for vertex in BOX.vertices:
        content += struct.pack("<B3d", 7, *vertex)
    for number, face in enumerate(BOX.faces.tolist()):
        uv = [0.5] * (number % 3)
        content += struct.pack(f"<B{len(uv)}f", len(uv), *uv)
        content += struct.pack("<H3Ih", 3, *face, -1)
    assert is_box(read(tmp_path, "a.ply", content))


def test_relative_indices_between_the_vertices_of_an_obj(tmp_path):
    """They count back from the last vertex above."""
    text = (
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 5 5 0\nv 6 5 0\nv 6 6 0\nf -3 -2 -1\n"
    )
    mesh = read(tmp_path, "a.obj", text.encode())
    assert mesh.area == pytest.approx(1.0)
    with pytest.raises(InputError, match="out of range: -4"):
        read(tmp_path, "a.obj", text.replace("f -3", "f -4", 1).encode())


@pytest.mark.parametrize(
    ("unit", "metres"), [("millimeter", 1e-3), ("inch", 0.0254), (None, 1e-3)]
)
def test_3mf(tmp_path, unit, metres):
    """Two bodies in their places; the file's unit is told, and the user's counts."""
    scene = trimesh.Scene()
    for name, x in (("left", 0.0), ("right", 10.0)):
        box = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
        place = trimesh.transformations.translation_matrix((x, 0.0, 0.0))
        scene.add_geometry(box, node_name=name, geom_name=name, transform=place)
    path = tmp_path / "a.3mf"
    content = io.BytesIO(exported(scene, "3mf"))
    stated = f'unit="{unit}"' if unit else ""
    with zipfile.ZipFile(content) as plain, zipfile.ZipFile(path, "w") as changed:
        for name in plain.namelist():
            text = plain.read(name).decode()
            changed.writestr(name, re.sub('unit="[a-z]+"', stated, text))
    assert read_mesh(path, read_contents(path)).metres_per_unit == metres
    meshes = jt.load_parts(path, unit="mm")
    assert sorted(name.split("/")[1] for name in meshes) == ["left", "right"]
    whole = load_mesh(path, unit="mm")
    assert whole.volume == pytest.approx(12e-9)
    assert np.ptp(whole.bounds, axis=0) == pytest.approx(np.multiply(1e-3, (11, 2, 3)))


def dae(vcount="4 4 4 4 4 4", numbers=24):
    """A box of 1 x 2 x 3 of quadrilaterals, in a node that doubles it along x."""
    corners = " ".join(f"{x} {y} {z}" for x in (0, 1) for y in (0, 2) for z in (0, 3))
    quads = "0 1 3 2 4 6 7 5 0 4 5 1 2 3 7 6 0 2 6 4 1 5 7 3"
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="case"><mesh>
<source id="p"><float_array id="p-array" count="{numbers}">{corners}</float_array>
<technique_common><accessor source="#p-array" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="6"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>{vcount}</vcount><p>{quads}</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n" name="outer">
<scale>2 1 1</scale><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
""".encode()


def test_dae(tmp_path):
    mesh = read(tmp_path, "a.dae", dae())
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(12.0)
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx([2.0, 2.0, 3.0])
    assert list(jt.load_parts(tmp_path / "a.dae", unit="m")) == ["outer/case/-"]
    in_inches = read_mesh(tmp_path / "a.dae", read_contents(tmp_path / "a.dae"))
    assert in_inches.metres_per_unit == pytest.approx(0.0254)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (dae(vcount="4 4 4 4 4"), "announces 6 polygons, 5"),
        (dae(vcount="4 4 4 4 4 5"), "have 25 corners, 24"),
        (dae(numbers=27), "announces 27 numbers, 24"),
        (dae().replace(b'url="#g"', b'url="#h"'), "h"),
        (dae()[:-300], "damaged"),
    ],
)
def test_damaged_dae(tmp_path, content, reason):
    with pytest.raises(InputError, match=reason) as caught:
        read(tmp_path, "a.dae", content)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("suffix", "package"), [("3mf", "lxml"), ("3mf", "networkx"), ("dae", "collada")]
)
def test_formats_name_the_package_they_need(tmp_path, monkeypatch, suffix, package):
    monkeypatch.setattr(file_mesh, "is_installed", lambda name: name != package)
    expected = f"{suffix.upper()} files need the package {package}"
    with pytest.raises(InputError, match=expected) as caught:
        read(tmp_path, f"a.{suffix}", b"content")
    assert "make env EXTRAS=formats" in str(caught.value)
