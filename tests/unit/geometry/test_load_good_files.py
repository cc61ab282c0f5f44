"""Every format comes back in metres, z up, with its shape and its sense."""

import numpy as np
import pytest
import trimesh

from jaxthermo.geometry import shapes
from jaxthermo.geometry.load import _axes_for_up, _axes_rotation, load_mesh


KINDS = ["obj", "ply", "ply_ascii", "stl", "stl_ascii", "glb", "off"]
SIDES = (2.0, 3.0, 5.0)


def save(folder, mesh, file_format="obj"):
    exported = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    options = {"encoding": "ascii"} if file_format == "ply_ascii" else {}
    data = exported.export(
        file_type=file_format if file_format != "ply_ascii" else "ply", **options
    )
    path = folder / f"solid.{file_format.split('_')[0]}"
    path.write_bytes(data if isinstance(data, bytes) else str(data).encode())
    return path


@pytest.mark.parametrize("file_format", KINDS)
def test_round_trip_with_unit(tmp_path, file_format):
    mesh = load_mesh(save(tmp_path, shapes.box(SIDES), file_format), unit="mm")
    assert mesh.is_watertight
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert mesh.volume == pytest.approx(30.0e-9, rel=1e-6)
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx(np.array(SIDES) * 1e-3)
    assert mesh.name == "solid"
    assert mesh.axes == ("x", "y", "z")


@pytest.mark.parametrize("file_format", KINDS)
def test_round_trip_with_height(tmp_path, file_format):
    mesh = load_mesh(
        save(tmp_path, shapes.box(SIDES), file_format), height=0.25, up="y"
    )
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx([0.5 / 3, 1.25 / 3, 0.25])
    assert mesh.volume > 0.0


@pytest.mark.parametrize("file_format", ["ply", "ply_ascii", "stl_ascii", "off", "obj"])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_names_and_comments_beyond_ascii(tmp_path, file_format, encoding):
    """As older programs of many countries write them."""
    path = save(tmp_path, shapes.box(SIDES), file_format)
    name = "Gehäuse Größe 5 µm"
    sign, first, end = {
        "ply": (b"comment ", b"ply\nformat binary_little_endian 1.0\n", b""),
        "ply_ascii": (b"comment ", b"ply\nformat ascii 1.0\n", b""),
        "stl_ascii": (b"", b"solid ", b"\n"),
        "off": (b"# ", b"OFF\n", b""),
        "obj": (b"o ", b"", b""),
    }[file_format]
    content = path.read_bytes()
    if file_format == "stl_ascii":
        content = content.split(b"\n", 1)[1]
    named = first + sign + name.encode(encoding) + (end or b"\n")
    path.write_bytes(named + content.removeprefix(first))
    mesh = load_mesh(path, unit="mm")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(30.0e-9, rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("m", 1.0), ("cm", 1e-2), ("MM", 1e-3), ("um", 1e-6), ("in", 0.0254)]
    + [("ft", 0.3048), (0.5, 0.5), (2, 2.0)],
)
def test_units(tmp_path, unit, metres):
    mesh = load_mesh(save(tmp_path, shapes.box(1.0)), unit=unit)
    assert mesh.area == pytest.approx(6.0 * metres**2)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_up_is_a_proper_rotation(tmp_path, up):
    matrix = _axes_rotation(_axes_for_up(up))
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    assert matrix @ axis == pytest.approx([0.0, 0.0, 1.0])
    mesh = load_mesh(save(tmp_path, shapes.box(SIDES)), unit="m", up=up, repair=False)
    assert mesh.volume == pytest.approx(30.0)
    assert np.ptp(mesh.bounds[:, 2]) == pytest.approx(SIDES["xyz".index(up[-1])])
    assert mesh.axes == _axes_for_up(up)


def test_y_up_is_as_documented():
    assert _axes_for_up("y") == ("x", "-z", "y")
    turned = _axes_rotation(_axes_for_up("y")) @ np.array([1.0, 2.0, 3.0])
    assert turned.tolist() == [1.0, -3.0, 2.0]


def test_scene_is_merged_with_its_transforms(tmp_path):
    scene = trimesh.Scene()
    cube = trimesh.creation.box()
    scene.add_geometry(cube)
    far = trimesh.transformations.translation_matrix([10.0, 0.0, 0.0])
    scene.add_geometry(cube, transform=far @ np.diag([2.0, 2.0, 2.0, 1.0]))
    path = tmp_path / "two.glb"
    scene.export(str(path))
    mesh = load_mesh(path, unit="m")
    assert mesh.volume == pytest.approx(9.0)
    assert mesh.bounds.tolist() == [[-0.5, -1.0, -1.0], [11.0, 1.0, 1.0]]


def test_obj_dialects(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(
        "mtllib none.mtl\r\no one\r\nv\t0 0 0\r\nv 1 0 0 1 0 0\r\nv 1 1 0\r\nv 0 1 0"
        "\r\nvt 0 0\r\nvn 0 0 1\r\nusemtl red\r\nf 1/1/1 2/1/1 3/1/1 4/1/1\r\n"
        "usemtl blue\r\nf -4//1 -1//1 -2//1\r\n"
    )
    mesh = load_mesh(path, unit="m", repair=False)
    assert mesh.area == pytest.approx(1.5)


def test_obj_polygons_comments_and_continued_lines(tmp_path):
    path = tmp_path / "a.obj"
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    rows = [
        f"v {x} {y} 0 # here" for x, y in zip(np.cos(angle), np.sin(angle), strict=True)
    ]
    path.write_text("\n".join(rows) + "\nf 1 2 3 \\\n 4 5")
    mesh = load_mesh(path, unit="m", repair=False)
    assert mesh.area == pytest.approx(2.5 * np.sin(2.0 * np.pi / 5.0))


def test_ply_with_triangles_and_quads(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\ncomment ours\nelement vertex 5\nproperty float x\n"
        "property float y\nproperty float z\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0.5 2 0\n4 0 1 2 3\n3 3 2 4\n"
    )
    assert load_mesh(path, unit="m", repair=False).area == pytest.approx(1.5)


def test_upper_case_ending_and_no_repair(tmp_path):
    path = save(tmp_path, shapes.box(1.0), "stl").rename(tmp_path / "BOX.STL")
    assert len(load_mesh(path, unit="m", repair=False).vertices) == 36
    assert load_mesh(path, unit="m").repairs == {"merged_vertices": 28}


@pytest.mark.parametrize(
    ("name", "watertight", "faces"),
    [
        ("max-planck.obj", True, 19_996),
        ("happy-buddha.obj", True, 99_994),
        ("stanford-bunny.obj", False, 69_451),
    ],
)
def test_real_meshes(real_mesh, name, watertight, faces):
    mesh = load_mesh(real_mesh(name), height=0.25, up="y")
    assert np.ptp(mesh.bounds[:, 2]) == pytest.approx(0.25)
    assert mesh.is_watertight == watertight
    assert len(mesh.faces) == faces
    assert mesh.volume > 0.0
