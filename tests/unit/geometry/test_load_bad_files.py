"""Every mistake in a file is one line: what, where, what to do; never a traceback."""

import os
import struct

import numpy as np
import pytest
import trimesh

from jaxthermo.errors import InputError
from jaxthermo.geometry.files.read import FORMATS
from jaxthermo.geometry.load import load_mesh


SUFFIXES = [suffix[1:] for suffix in FORMATS]


def refusal(path, capfd, **options):
    """The one line with which a file is refused."""
    options = options or {"unit": "m"}
    with pytest.raises(InputError) as caught:
        load_mesh(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    assert capfd.readouterr() == ("", "")
    return message


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def exported(suffix, mesh=None, **options):
    mesh = mesh or trimesh.creation.icosphere(subdivisions=2)
    data = mesh.export(file_type=suffix, **options)
    return data if isinstance(data, bytes) else str(data).encode()


def test_missing_file(tmp_path, capfd):
    assert "no such file" in refusal(tmp_path / "none.obj", capfd)


def test_folder(tmp_path, capfd):
    assert "folder" in refusal(tmp_path, capfd)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_pipe_is_not_waited_for(tmp_path, capfd, suffix):
    os.mkfifo(tmp_path / f"pipe.{suffix}")
    assert "a pipe or a device" in refusal(tmp_path / f"pipe.{suffix}", capfd)


def test_unreadable(tmp_path, capfd, monkeypatch):
    path = written(tmp_path, "locked.obj", exported("obj"))

    def refuse(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "read_bytes", refuse)
    assert "Permission denied" in refusal(path, capfd)


@pytest.mark.parametrize("name", ["mesh.fbx", "mesh", "mesh.obj.gz"])
def test_unknown_ending(tmp_path, capfd, name):
    message = refusal(written(tmp_path, name, "x"), capfd)
    assert all(suffix in message for suffix in FORMATS)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("content", [b"", b" \n\n", b"\0" * 200])
def test_empty_file(tmp_path, capfd, suffix, content):
    assert "empty" in refusal(written(tmp_path, f"a.{suffix}", content), capfd)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_junk(tmp_path, capfd, suffix):
    junk = np.random.default_rng(7).integers(0, 256, 5000, np.uint8).tobytes()
    refusal(written(tmp_path, f"junk.{suffix}", junk), capfd)
    refusal(written(tmp_path, f"text.{suffix}", "lorem ipsum dolor\n" * 40), capfd)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
@pytest.mark.parametrize(
    "suffix", ["stl", "stl_ascii", "ply", "ply_ascii", "glb", "off"]
)
def test_cut_short(tmp_path, capfd, suffix, share):
    encoding = {"encoding": "ascii"} if suffix == "ply_ascii" else {}
    data = exported("ply" if suffix == "ply_ascii" else suffix, **encoding)
    cut = data[: int(len(data) * share)]
    refusal(written(tmp_path, f"cut.{suffix.split('_')[0]}", cut), capfd)


def test_parser_noise_is_silenced(tmp_path, capfd, caplog):
    facet = "facet normal {} 0 1\nouter loop\n" + "vertex 0 {} 1\n" * 3
    text = "solid a\n" + (facet + "endloop\nendfacet\n").format("x", 1, 2, 3)
    refusal(written(tmp_path, "noisy.stl", text + "endsolid a\n"), capfd)
    assert caplog.records == []


@pytest.mark.parametrize(
    "cut", ["v 0 0 0\nv 1 0 0\nv 0 1", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2"]
)
def test_obj_cut_inside_a_line(tmp_path, capfd, cut):
    refusal(written(tmp_path, "cut.obj", cut), capfd)


def test_obj_cut_before_its_faces(tmp_path, capfd):
    data = exported("obj")
    cut = data[: data.index(b"\nf ")]
    assert "no faces" in refusal(written(tmp_path, "cut.obj", cut), capfd)


@pytest.mark.parametrize("suffix", ["ply", "glb", "obj"])
def test_point_cloud(tmp_path, capfd, suffix):
    cloud = trimesh.PointCloud(np.eye(3))
    if suffix == "glb":
        cloud = trimesh.Scene(cloud)
    path = written(tmp_path, f"cloud.{suffix}", exported(suffix, cloud))
    assert "no faces" in refusal(path, capfd)


def test_no_faces_in_off_and_stl(tmp_path, capfd):
    off = written(tmp_path, "a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n")
    refusal(off, capfd)
    ascii_stl = written(tmp_path, "a.stl", "solid a\nendsolid a\n" + " " * 90)
    refusal(ascii_stl, capfd)
    binary = b"\x01" * 80 + struct.pack("<I", 0)
    assert "no faces" in refusal(written(tmp_path, "b.stl", binary), capfd)


def triangle_text(suffix, rows, face=(0, 1, 2)):
    """A file in a text format with one triangle; indices count from 0."""
    indices = " ".join(map(str, face))
    if suffix == "obj":
        vertices = "".join(f"v {row}\n" for row in rows)
        return vertices + "f " + " ".join(str(index + 1) for index in face) + "\n"
    if suffix == "off":
        return "\n".join(["OFF", "3 1 0", *rows, f"3 {indices}"]) + "\n"
    if suffix == "stl":
        vertices = "".join(f"vertex {row}\n" for row in rows)
        facet = f"facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n"
        return f"solid a\n{facet}endsolid a\n"
    head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*head, *rows, f"3 {indices}"]) + "\n"


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e300"])
@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl"])
def test_not_finite(tmp_path, capfd, suffix, number):
    text = triangle_text(suffix, [f"0 0 {number}", "1 0 0", "0 1 0"])
    message = refusal(written(tmp_path, f"a.{suffix}", text), capfd)
    assert "1 of 3 vertices are NaN or infinite, or beyond 1e+50" in message


@pytest.mark.parametrize("index", [-1, 3, 99])
@pytest.mark.parametrize("suffix", ["obj", "off", "ply"])
def test_index_out_of_range(tmp_path, capfd, suffix, index):
    # OBJ counts from 1, and there -1 rightly means the last vertex.
    text = triangle_text(suffix, ["0 0 0", "1 0 0", "0 1 0"], face=(0, 1, index))
    message = refusal(written(tmp_path, f"a.{suffix}", text), capfd)
    assert "range" in message or "out of bounds" in message


@pytest.mark.parametrize(
    "corners", [["1 2 3"] * 3, ["0 0 0", "1 1 1", "2 2 2"]], ids=["point", "line"]
)
@pytest.mark.parametrize("suffix", ["obj", "off", "ply"])
def test_all_faces_degenerate(tmp_path, capfd, suffix, corners):
    path = written(tmp_path, f"a.{suffix}", triangle_text(suffix, corners))
    assert "zero area" in refusal(path, capfd)


@pytest.mark.parametrize("name", ["unit", "height"])
@pytest.mark.parametrize("value", [0, 0.0, -1.0, float("nan"), float("inf")])
def test_bad_length(tmp_path, name, value):
    path = written(tmp_path, "a.obj", exported("obj"))
    with pytest.raises(InputError, match=f"{name}=.*positive"):
        load_mesh(path, **{name: value})


def test_unit_or_height_and_not_both(tmp_path, capfd):
    path = written(tmp_path, "a.obj", exported("obj"))
    assert "not both" in refusal(path, capfd, unit="mm", height=1.0)
    with pytest.raises(InputError, match="neither"):
        load_mesh(path)


def test_unknown_unit_and_axis(tmp_path):
    path = written(tmp_path, "a.obj", exported("obj"))
    with pytest.raises(InputError, match="unit 'furlong' is not known"):
        load_mesh(path, unit="furlong")
    with pytest.raises(InputError, match="up='w'"):
        load_mesh(path, unit="m", up="w")  # type: ignore


def test_height_of_a_flat_mesh(tmp_path, capfd):
    path = written(tmp_path, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "flat along up" in refusal(path, capfd, height=1.0)
