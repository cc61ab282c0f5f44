"""`jaxthermo export`: files that meshio, trimesh and other readers open."""

import json
import struct
import xml.etree.ElementTree as ElementTree

import meshio
import numpy as np
import pytest
import trimesh
from cli_runs import files, refused, run, scene_file, sets, succeed
from PIL import Image

from jaxthermo.image.colour.palette import palette_table
from jaxthermo.image.files.exr import read_exr
from jaxthermo.image.files.surfaces import _vertex_mesh
from jaxthermo.integrate.run.solution_file import load_solution
from tests.shallow import SHALLOW


def exported(finished, out, format, *options):
    text = succeed("export", finished, "--format", format, "--out", out, *options)
    return text


@pytest.fixture(scope="module")
def vertices(finished):
    """Mesh of the block and its temperatures at the last saved time."""
    stored = load_solution(finished / "solution.npz")
    mesh = _vertex_mesh(stored.surfaces[0].geometry)
    return mesh, mesh.values(np.asarray(stored.surface_temperature[-1]))


def test_meshio_reads_every_time(finished, tmp_path, vertices):
    assert exported(finished, tmp_path, "vtu") == f"4 files in {tmp_path}\n"
    entries = ElementTree.parse(tmp_path / "surface.pvd").findall(".//DataSet")
    assert [float(entry.attrib["timestep"]) for entry in entries] == [5, 12, 20]
    read = meshio.read(tmp_path / entries[-1].attrib["file"])
    mesh, kelvin = vertices
    np.testing.assert_allclose(read.points, mesh.vertices, atol=1e-8)
    np.testing.assert_array_equal(read.cells_dict["triangle"], mesh.faces)
    np.testing.assert_array_equal(read.point_data["temperature_K"], kelvin)
    np.testing.assert_allclose(read.point_data["Normals"], mesh.normals, atol=1e-7)
    assert np.ptp(read.point_data["emissivity"]) < 1e-6
    (body,) = read.cell_data["body"]
    assert body.shape == (len(mesh.faces),) and not body.any()


MOVING = """
bodies:
  - name: cart
    shape: {kind: box, size: [10 cm, 10 cm, 10 cm]}
    pitch: 5 cm
    material: copper
    temperature: 300
    pose:
      times: [0, 20]
      poses: [{translation: [0, 0, 1]}, {translation: [0, 2, 1]}]
  - name: floor
    shape: {kind: rectangle, width: 10 cm, length: 10 cm}
    sheet: {layers: [{material: copper, thickness: 5 mm}], pitch: 5 cm}
    temperature: 280
terms:
  - {kind: heat_flux, heat_flux: 100, on: {part: cart}}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
surface_outputs: [heat_flux, heat_transfer_coefficient]
time: {end: 20, save_at: [10, 20]}
camera: {width: 16, height: 16}
"""


@pytest.mark.slow
@SHALLOW
def test_a_series_has_places_fluxes_and_coefficients_of_what_moves(tmp_path):
    scene = scene_file(tmp_path, MOVING)
    succeed("simulate", scene, "--out", tmp_path / "run", "--quiet")
    exported(tmp_path / "run", tmp_path / "vtu", "vtu")
    collection = ElementTree.parse(tmp_path / "vtu" / "surface.pvd")
    entries = collection.findall(".//DataSet")
    assert [float(entry.attrib["timestep"]) for entry in entries] == [10, 20]
    for entry, shift in zip(entries, (1.0, 2.0), strict=True):
        read = meshio.read(tmp_path / "vtu" / entry.attrib["file"])
        (body,) = read.cell_data["body"]
        cart = np.unique(read.cells_dict["triangle"][body == 0])
        floor = np.unique(read.cells_dict["triangle"][body == 1])
        low = read.points[cart].min(axis=0)
        high = read.points[cart].max(axis=0)
        np.testing.assert_allclose((low + high) / 2, [0, shift, 1], atol=1e-6)
        np.testing.assert_allclose(high - low, 0.1, atol=1e-6)
        assert np.ptp(read.points[floor][:, 2]) < 1e-9
        # By the balance of the surface, with the temperature of the same points.
        values = read.point_data
        kelvin = values["temperature_K"]
        coefficient = values["heat_transfer_coefficient_W_m2K"]
        np.testing.assert_allclose(coefficient, 10.0, rtol=1e-5)
        flux = 10.0 * (290.0 - kelvin)
        flux[cart] += 100.0
        np.testing.assert_allclose(values["heat_flux_W_m2"], flux, rtol=2e-4)
        back = 10.0 * (290.0 - values["temperature_back_K"][floor])
        np.testing.assert_allclose(
            values["heat_flux_back_W_m2"][floor], back, rtol=2e-4
        )


def glb_array(path, attribute):
    """An attribute of the first mesh, and the whole tree, without a library."""
    content = path.read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    tree = json.loads(content[20 : 20 + length])
    data = content[28 + length :]
    index = tree["meshes"][0]["primitives"][0]["attributes"][attribute]
    accessor = tree["accessors"][index]
    start = tree["bufferViews"][accessor["bufferView"]]["byteOffset"]
    columns = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
    values = np.frombuffer(data, "<f4", accessor["count"] * columns, start)
    return values.reshape(-1, columns), tree


def test_trimesh_reads_vertices_and_colours(finished, tmp_path, vertices):
    exported(finished, tmp_path, "glb", "--set", "image.frames=[20]")
    assert files(tmp_path) == {"t000020.00s.glb"}
    path = tmp_path / "t000020.00s.glb"
    scene = trimesh.load_scene(path, process=False)
    (read,) = scene.geometry.values()
    mesh, kelvin = vertices
    np.testing.assert_array_equal(read.faces, mesh.faces)
    np.testing.assert_array_equal(
        read.vertex_attributes["_TEMPERATURE"].ravel(), kelvin
    )
    # Y is up there: the block stands on its end of 10 cm.
    np.testing.assert_allclose(scene.extents, [0.05, 0.1, 0.04], atol=1e-6)
    linear, tree = glb_array(path, "COLOR_0")
    notes = tree["scenes"][0]["extras"]
    assert notes["time_s"] == 20 and notes["palette"] == "iron"
    # A viewer encodes linear colours as sRGB: then they are the palette's.
    encoded = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
    )
    share = (kelvin - notes["low_K"]) / (notes["high_K"] - notes["low_K"])
    colours = palette_table("iron")[np.rint(255 * np.clip(share, 0, 1)).astype(int)]
    np.testing.assert_allclose(255 * encoded, colours, atol=0.01)


def test_a_scale_can_be_given(finished, tmp_path):
    changes = sets("image.frames=[5]", "image.low=250", "image.high=350")
    exported(finished, tmp_path, "glb", *changes)
    _, tree = glb_array(tmp_path / "t000005.00s.glb", "COLOR_0")
    extras = tree["scenes"][0]["extras"]
    assert (extras["low_K"], extras["high_K"]) == (250, 350)


def test_a_texture_with_its_mesh(finished, tmp_path, vertices):
    exported(finished, tmp_path, "texture", "--set", "image.frames=[20]")
    name = "body0_box_t000020.00s"
    notes = json.loads((tmp_path / "textures.json").read_text())
    (body,) = notes["bodies"]
    assert body["textures"][0]["time_s"] == 20
    images = [f"{name}.{ending}" for ending in ("png", "exr", "glb")]
    listed = {*images, f"{name}_heat.png", "body0_box.obj", "textures.json"}
    assert files(tmp_path) == listed
    kelvin = read_exr(tmp_path / f"{name}.exr")[0]["Y"]
    assert kelvin.shape == (body["height"], body["width"])
    grey = Image.open(tmp_path / f"{name}.png")
    assert grey.mode == "I;16"
    np.testing.assert_allclose(np.asarray(grey) * 0.01, kelvin, atol=0.0051)
    heat = np.asarray(Image.open(tmp_path / f"{name}_heat.png"), float)
    back = notes["low_K"] + heat / 255 * (notes["high_K"] - notes["low_K"])
    np.testing.assert_allclose(
        back, kelvin, atol=(notes["high_K"] - notes["low_K"]) / 500
    )
    # The mesh of the body, with coordinates within the image.
    mesh = trimesh.load_mesh(tmp_path / "body0_box.obj", process=False)
    np.testing.assert_allclose(mesh.extents, [0.05, 0.04, 0.1], atol=1e-7)
    visual = trimesh.load_scene(tmp_path / f"{name}.glb").geometry["body0_box"].visual
    assert visual.kind == "texture" and visual.uv is not None
    # Each corner of the OBJ is drawn at its vertex's temperature.
    lines = (tmp_path / "body0_box.obj").read_text().splitlines()

    def rows(key):
        return [line.split()[1:] for line in lines if line.startswith(f"{key} ")]

    points = np.array(rows("v"), float)
    uv = np.array(rows("vt"), float)
    corners = [list(map(int, c.split("/"))) for face in rows("f") for c in face]
    column = (uv[:, 0] * kelvin.shape[1]).astype(int)
    row = ((1 - uv[:, 1]) * kelvin.shape[0]).astype(int)
    fine, values = vertices
    for vertex, texture, _ in corners:
        is_vertex = np.isclose(fine.vertices, points[vertex - 1], atol=1e-7).all(axis=1)
        drawn = kelvin[row[texture - 1], column[texture - 1]]
        assert np.abs(values[is_vertex] - drawn).min() < 1e-3


def test_by_default_it_is_beside_the_run(finished, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for name in ("config.yaml", "solution.npz"):
        (folder / name).write_bytes((finished / name).read_bytes())
    code, out, _ = run("export", folder, "--format", "glb")
    assert code == 0 and out == f"3 files in {folder / 'glb'}\n"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--format", "stl"), "choose vtu, glb, texture"),
        (("--format", "vtu", "--set", "image.frames=[3]"), "not a saved time"),
        (("--format", "vtu", "--set", "time.end=3"), "only camera and image"),
        ((), "--format"),
    ],
)
def test_mistakes_are_one_line(finished, tmp_path, options, words):
    err = refused("export", finished, "--out", tmp_path / "new", *options)
    assert words in err and not (tmp_path / "new").exists()


def test_a_folder_without_a_run(tmp_path):
    code, _, err = run("export", tmp_path, "--format", "vtu")
    assert code == 2 and "no config.yaml" in err
