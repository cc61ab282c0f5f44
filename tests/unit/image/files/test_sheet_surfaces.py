"""VTU, GLB and textures of thin walls, whose sides have their own temperatures."""

from typing import Any

import meshio
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.image.files.exr import read_exr
from jaxthermo.image.files.textures import BodyTextures, write_textures
from jaxthermo.live.surface_points import surface_points


FOAM = jt.Material(0.03, 40.0, specific_heat=1400.0, emissivity=0.9)


@pytest.fixture(scope="module")
def pair():
    """A solid cube, and above it a wall that is warm at its front, cold at its back."""
    cube = jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [0, 0.5, 0]])
    mesh = jt.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    sheet = jt.Sheet(mesh, (jt.Layer(FOAM, 0.1),), 0.1, cells=2)

    def by_layer(position):
        return np.repeat([400.0, 300.0], len(position) // 2)

    bodies = (
        jt.Body(jt.FullVolume(cube), FOAM, temperature=350.0),
        jt.Body(sheet, temperature=by_layer, pose=jt.Pose((0.0, 0.0, 1.0))),
    )
    return jt.simulate(jt.Scene(bodies, dtype="float64"), 0.0)


def test_vtu_has_a_wall_once_with_both_temperatures(pair, tmp_path):
    jt.write_vtu(tmp_path / "pair.vtu", pair)
    read = meshio.read(tmp_path / "pair.vtu")
    (body,) = read.cell_data["body"]
    cells = read.cells_dict["triangle"]
    wall = np.unique(cells[body == 1])
    cube = np.unique(cells[body == 0])
    values = read.point_data
    assert_allclose(values["temperature_K"][wall], 400.0)
    assert_allclose(values["temperature_back_K"][wall], 300.0)
    assert_allclose(values["temperature_back_K"][cube], 350.0)
    assert_allclose(values["emissivity_back"], 0.9, rtol=1e-6)
    assert_allclose(values["Normals"][wall], np.tile([0.0, 0.0, 1.0], (len(wall), 1)))
    corners = read.points[cells[body == 1]]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert area.sum() / 2 == pytest.approx(0.5, rel=1e-6)


def test_glb_has_each_side_with_its_winding(pair, tmp_path):
    jt.write_glb(tmp_path / "pair.glb", pair, names=("cube", "wall"))
    scene = trimesh.load_scene(tmp_path / "pair.glb", process=False)
    wall = scene.geometry["wall"]
    assert wall.area == pytest.approx(1.0, rel=1e-6)
    kelvin = wall.vertex_attributes["_TEMPERATURE"][wall.faces].mean(axis=1)
    # Z of the body is up in its own frame; the root node turns the scene.
    up = wall.face_normals[:, 2] > 0
    assert up.sum() == (~up).sum()
    assert_allclose(kelvin[up], 400.0)
    assert_allclose(kelvin[~up], 300.0)


def test_textures_have_texels_for_both_sides(pair, tmp_path):
    _, wall = (surface.geometry for surface in pair.surfaces)
    rows = slice(len(pair.surfaces[0].geometry.fragment_area), None)
    kelvin = np.asarray(pair.surface_temperature[-1])[rows]
    body = BodyTextures("wall", wall, 300.0, 400.0)
    files = write_textures(tmp_path, body, [("end", kelvin)], "iron")
    assert "wall_end.glb" in files["textures"][0]["files"]
    mesh = trimesh.load_mesh(tmp_path / "wall.obj", process=False)
    assert mesh.area == pytest.approx(1.0, rel=1e-6)
    visual: Any = mesh.visual
    uv = visual.uv[mesh.faces].mean(axis=1)
    channels, _ = read_exr(tmp_path / "wall_end.exr")
    image = channels["Y"]
    height, width = image.shape
    row = ((1 - uv[:, 1]) * height).astype(int)
    column = (uv[:, 0] * width).astype(int)
    expected = np.where(mesh.face_normals[:, 2] > 0, 400.0, 300.0)
    assert_allclose(image[row, column], expected)


def test_live_points_of_each_side_are_on_that_side(pair):
    points = surface_points(pair.surfaces, 4000)
    kelvin = points.temperature(np.asarray(pair.surface_temperature[-1]))
    wall = points.rows[1]
    above = points.position[1][:, 2] > 0
    assert above.sum() == (~above).sum()
    assert_allclose(kelvin[wall], np.where(above, 400.0, 300.0), rtol=1e-6)
