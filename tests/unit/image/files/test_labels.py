"""Labels: boxes, run lengths, and matrices that project as the camera does."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.files.labels import camera_matrices, instances, run_lengths
from jaxthermo.image.files.raster_files import centikelvin, grey_levels
from jaxthermo.image.surface.visible import WorldMesh, visible_points


NUMBER = np.array(
    [
        [-1, -1, 2, 2, -1],
        [-1, 0, 2, 0, -1],
        [-1, 0, 0, 0, -1],
        [-1, -1, -1, -1, -1],
    ]
)


def decoded(code):
    """Mask of uncompressed run lengths, as pycocotools reads them."""
    flat = np.concatenate(
        [np.full(count, k % 2) for k, count in enumerate(code["counts"])]
    )
    return flat.reshape(code["size"], order="F").astype(bool)


def test_boxes_are_as_small_as_possible():
    first, second = instances(NUMBER)
    assert (first.number, first.box, first.area) == (0, (1, 1, 3, 2), 5)
    assert (second.number, second.box, second.area) == (2, (2, 0, 2, 2), 3)
    assert not first.is_cut and second.is_cut
    assert instances(np.full((2, 3), -1)) == []


@pytest.mark.parametrize("seed", range(4))
def test_run_lengths_are_decoded_to_the_mask(seed):
    mask = np.random.default_rng(seed).random((5, 7)) < 0.5
    for pixels in (mask, ~mask, np.ones((2, 3), bool), np.zeros((2, 3), bool)):
        np.testing.assert_array_equal(decoded(run_lengths(pixels)), pixels)


CAMERAS = {
    "pinhole": jt.Camera((0.5, -0.4, 0.3), (0.0, 0.0, 0.01), width=41, height=30),
    "parallel": jt.OrthographicCamera(
        (0.5, -0.4, 0.3), (0.0, 0.0, 0.01), view_height=0.2, width=41, height=30
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_matrices_project_points_to_their_pixels(name):
    camera = CAMERAS[name]
    mesh = jt.shapes.box((0.06, 0.08, 0.05))
    seen = visible_points((WorldMesh(mesh.vertices, mesh.faces),), camera)
    matrices = camera_matrices(camera)
    extrinsic = np.array(matrices["world_to_camera"])
    local = seen.position @ extrinsic[:, :3].T + extrinsic[:, 3]
    np.testing.assert_allclose(local[:, 2], seen.depth, atol=1e-12)
    if name == "pinhole":
        projected = local @ np.array(matrices.get("K")).T
        column, row = (projected[:, :2] / projected[:, 2:]).T
    else:
        scaled = local[:, :2] * matrices.get("pixels_per_metre", np.nan)
        column, row = (scaled + matrices.get("centre_pixel", [])).T
    np.testing.assert_allclose(column, seen.pixel % 41, atol=1e-9)
    np.testing.assert_allclose(row, seen.pixel // 41, atol=1e-9)


def test_grey_numbers_end_at_both_sides():
    kelvin = np.array([[0.0, 273.154, 655.35, 9000.0]])
    assert centikelvin(kelvin).tolist() == [[0, 27315, 65535, 65535]]
    assert grey_levels(kelvin, 273.154, 655.35).tolist() == [[0, 0, 255, 255]]
