"""Part numbers of pixels: of the part on which each lies, through all files."""

import json

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.files.exr import read_exr
from jaxthermo.image.radiance.image import coarsen
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.solution_file import load_solution


CAMERA = jt.OrthographicCamera(
    (0.0, -1.0, 0.0), (0.0, 0.0, 0.0), view_height=0.1, width=100, height=50
)


@pytest.fixture(scope="module")
def knife():
    """A blade at positive x and a grip at negative x, beside a body without parts."""
    blade = jt.shapes.box((0.04, 0.01, 0.01)).moved((0.02, 0.0, 0.0))
    meshes = {"blade": blade, "grip": blade.moved((-0.04, 0.0, 0.0))}
    grid = jt.voxelize(jt.shapes.box((0.08, 0.01, 0.01)), pitch=0.005)
    materials = {"blade": jt.materials["copper"], "grip": jt.materials["brick"]}
    labels = jt.materials_by_part(grid, meshes, materials)
    knife = jt.Body(jt.FullVolume(grid), labels, temperature=300.0)
    ball = jt.Body(
        jt.FullVolume(jt.voxelize(jt.shapes.sphere(0.01), 0.005)),
        jt.materials["brick"],
        temperature=310.0,
        pose=jt.Pose((0.0, 0.0, 0.03)),
    )
    return jt.simulate(jt.Scene((ball, knife)), 0.0)


def test_each_pixel_has_its_part(knife):
    image = jt.render(knife, CAMERA)
    assert image.part_names == ((), ("blade", "grip"))
    part_id = np.asarray(image.part_id)
    body = np.asarray(image.object_id)
    assert (part_id[body < 1] == -1).all()
    _, column = np.nonzero(body == 1)
    # 2 mm a pixel; x grows to the right.
    np.testing.assert_array_equal(part_id[body == 1], np.where(column >= 50, 0, 1))


def test_samples_and_blocks_have_parts_too(knife):
    fine = jt.render(knife, CAMERA, samples=2)
    np.testing.assert_array_equal(fine.part_id, jt.render(knife, CAMERA).part_id)
    assert coarsen(fine, 2).part_names == fine.part_names
    blocks = jt.render(knife, CAMERA, smooth=False)
    np.testing.assert_array_equal(blocks.part_id, fine.part_id)


def test_files_have_parts_and_names(knife, tmp_path):
    knife.save(tmp_path)
    surfaces = load_solution(tmp_path / "solution.npz").surfaces
    assert surfaces[1].geometry.part_names == ("blade", "grip")
    view = compute_view(surfaces, (), CAMERA)
    image = jt.render(knife, CAMERA)
    expected = np.asarray(image.part_id).ravel()[view.pixel]
    np.testing.assert_array_equal(view.part_id, expected)
    jt.write_exr(tmp_path / "frame.exr", image)
    channels, header = read_exr(tmp_path / "frame.exr")
    np.testing.assert_array_equal(channels["part_id"], image.part_id)
    assert json.loads(header["parts"]) == {"0": [], "1": ["blade", "grip"]}


def test_without_parts_nothing_is_added(tmp_path):
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    image = jt.render(jt.simulate(jt.Scene((body,)), 0.0), CAMERA)
    assert image.part_id is None
    jt.write_exr(tmp_path / "frame.exr", image)
    channels, header = read_exr(tmp_path / "frame.exr")
    assert "part_id" not in channels and "parts" not in header
