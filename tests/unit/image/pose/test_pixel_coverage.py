"""Covered fractions of pixels are areas; their slopes are those of moved cameras."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.image.pose.coverage import coverage, coverage_slopes
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.surface.visible import WorldMesh


CAMERAS = {
    "pinhole": jt.Camera(
        (0.5, -0.3, 0.25), (0.0, 0.0, 0.0), field_of_view=0.36, width=32, height=24
    ),
    "orthographic": jt.OrthographicCamera(
        (0.5, -0.3, 0.25), (0.0, 0.0, 0.0), 0.22, width=32, height=24
    ),
}
STEPS = np.array([2e-3, 2e-3, 2e-2, 1.2e-3, 1.2e-3, 1.2e-2])
"""Turns and moves by about a seventh of a pixel at the outline."""
POSE = np.array([0.02, -0.015, 0.03, 0.004, -0.006, 0.01])


def _box(*size):
    mesh = jt.shapes.box(size)
    return WorldMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def test_fractions_are_the_areas_of_a_box():
    """Edges at quarters of a pixel: 16 rays tell them exactly."""
    front = jt.OrthographicCamera((0, -1, 0), (0, 0, 0), 0.12, width=16, height=12)
    covered_pixels = coverage((_box(0.115, 0.02, 0.055),), front, 16)
    covered = np.full(12, 0.0)
    covered[3] = 0.75
    covered[4:8] = 1.0
    covered[8] = 0.75
    across = np.zeros(16)
    across[2] = 0.75
    across[3:13] = 1.0
    across[13] = 0.75
    np.testing.assert_allclose(covered_pixels.fraction, np.outer(covered, across))
    # To the right a pixel gains at its left edge what it loses at its right one.
    np.testing.assert_allclose(covered_pixels.slope[0, 5, :4], [0, 0, -1, 0])
    np.testing.assert_allclose(covered_pixels.slope[1, 7:10, 8], [0, 1, 0])


@pytest.mark.parametrize("name", CAMERAS)
def test_slopes_are_those_of_moved_cameras(name):
    """By all six numbers, to the resolution of the rays."""
    camera = CAMERAS[name]
    box = _box(0.08, 0.06, 0.1)
    turn = Rotation.from_rotvec((0.2, 0.7, 0.1))
    body = box._replace(vertices=turn.apply(box.vertices))
    all_pixels = np.arange(32 * 24)

    def at(pose):
        return coverage((body,), moved_camera(camera, pose), 24)

    slopes = coverage_slopes(at(POSE), camera=camera, pose=POSE, pixels=all_pixels)
    for number in range(6):
        step = STEPS[number] * np.eye(6)[number]
        ends = [at(POSE + sign * step).fraction for sign in (1, -1)]
        difference = (ends[0] - ends[1]).ravel() / (2 * STEPS[number])
        off = slopes[:, number] - difference
        # Along the view a point moves by its position in the image, whose mean over a
        # pixel is not on the outline.
        limit = 0.12 if number == 5 else 0.06
        assert np.sqrt((off**2).mean()) < limit * np.sqrt((difference**2).mean())
