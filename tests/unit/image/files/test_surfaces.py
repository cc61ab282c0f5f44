"""VTU and GLB of a solution in Python: several bodies, poses in time, all outputs."""

from typing import Any

import meshio
import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.image.files.surfaces import temperature_scale


@pytest.fixture(scope="module")
def moving():
    """A box that rests, and a warm one that moves and turns."""
    grid = jt.voxelize(jt.shapes.box((0.04, 0.02, 0.02)), 0.01)
    steel = jt.materials["stainless_steel"]
    turned = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    poses = (jt.Pose((0.1, 0.0, 0.0)), jt.Pose((0.1, 0.2, 0.0), turned))
    motion = jt.Motion(jt.PoseTable((0.0, 10.0), poses))
    rests = jt.Body(jt.FullVolume(grid), steel, temperature=300.0)
    moves = jt.Body(jt.FullVolume(grid), steel, temperature=340.0, pose=motion)
    terms = (jt.Convection(10.0, 290.0),)
    outputs = ("heat_flux", "heat_transfer_coefficient")
    scene = jt.Scene((rests, moves), terms, surface_outputs=outputs)
    return jt.simulate(scene, 10.0, save_at=[1.0, 10.0])


def test_bodies_are_at_their_places_with_all_outputs(moving, tmp_path):
    jt.write_vtu(tmp_path / "end.vtu", moving)
    read = meshio.read(tmp_path / "end.vtu")
    (body,) = read.cell_data["body"]
    cells = read.cells_dict["triangle"]
    places = [read.points[np.unique(cells[body == n])] for n in (0, 1)]
    np.testing.assert_allclose(np.ptp(places[0], axis=0), [0.04, 0.02, 0.02], atol=1e-7)
    np.testing.assert_allclose(np.ptp(places[1], axis=0), [0.02, 0.04, 0.02], atol=1e-7)
    middle = (places[1].min(axis=0) + places[1].max(axis=0)) / 2
    np.testing.assert_allclose(middle, [0.1, 0.2, 0.0], atol=1e-7)
    warm = np.unique(cells[body == 1])
    values = read.point_data
    assert (values["temperature_K"][warm] > 330).all()
    np.testing.assert_allclose(values["heat_transfer_coefficient_W_m2K"], 10, rtol=1e-5)
    # Newton's law at each vertex, both sides interpolated with the same weights.
    lost = 10 * (290 - values["temperature_K"])
    np.testing.assert_allclose(values["heat_flux_W_m2"], lost, rtol=2e-3)
    # Normals point outwards.
    away = read.points[warm] - middle
    assert (np.einsum("vi,vi->v", away, values["Normals"][warm]) > 0).all()


def test_names_are_in_both_files(moving, tmp_path):
    jt.write_vtu(tmp_path / "end.vtu", moving, names=("tyre", "Dach ü"))
    read = meshio.read(tmp_path / "end.vtu")
    assert read.field_data == {"tyre": [0], "Dach ü": [1], "TimeValue": [10.0]}
    jt.write_vtu(tmp_path / "plain.vtu", moving)
    read = meshio.read(tmp_path / "plain.vtu")
    assert read.field_data.keys() == {"body0", "body1", "TimeValue"}
    jt.write_glb(tmp_path / "plain.glb", moving)
    scene = trimesh.load_scene(tmp_path / "plain.glb", process=False)
    assert {*scene.graph.nodes_geometry} == {"body0", "body1"}


def test_glb_has_the_pose_of_its_time(moving, tmp_path):
    for index, middle in ((0, 0.02), (1, 0.2)):
        jt.write_glb(tmp_path / "one.glb", moving, index, names=("rests", "moves"))
        scene = trimesh.load_scene(tmp_path / "one.glb", process=False)
        pose, _ = scene.graph["moves"]
        # World y is -z of glTF.
        np.testing.assert_allclose(pose[:3, 3], [0.1, 0.0, -middle], atol=1e-7)


def test_a_scale_of_what_is_seen_or_given(moving):
    low, high = temperature_scale(moving, [0, 1])
    kelvin = np.asarray(moving.surface_temperature)
    assert (low, high) == (kelvin.min(), kelvin.max())
    assert temperature_scale(moving, [0], low=400.0) == (400.0, 400.1)
    with pytest.raises(jt.InputError, match="lower one first"):
        temperature_scale(moving, [0], low=300.0, high=300.0)
    unknown: Any = "irn"
    with pytest.raises(jt.InputError, match="palette"):
        jt.write_glb("never.glb", moving, palette=unknown)


def test_a_folder_that_is_not_there(moving, tmp_path):
    for write in (jt.write_vtu, jt.write_glb):
        with pytest.raises(jt.InputError, match="cannot write"):
            write(tmp_path / "nowhere" / "file", moving)
