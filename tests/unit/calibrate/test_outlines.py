"""The pose of a camera is found from a frame's outlines alone, as well as it says."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from calibrate.problem.outlines import fit_outlines
from jaxthermo.image.pose.coverage import coverage


CAMERA = jt.Camera(
    (0.5, -0.3, 0.25), (0.0, 0.0, 0.0), field_of_view=0.36, width=64, height=48
)
PIXEL = 0.36 / 48
UNIT = np.array([PIXEL, PIXEL, 4 * PIXEL, 0.65 * PIXEL, 0.65 * PIXEL, 2.6 * PIXEL])
START = np.array([0.6, -0.5, 0.3, -0.4, 0.6, -0.5])
"""Pixels off."""


@pytest.fixture(scope="module")
def bodies():
    """A turned block and one behind it."""
    mesh = jt.shapes.box((0.08, 0.06, 0.1))
    turned = Rotation.from_rotvec((0.2, 0.7, 0.1)).apply(mesh.vertices)
    return tuple((turned + place, mesh.faces) for place in ([0, 0, 0], [-0.1, 0.05, 0]))


@pytest.fixture(scope="module")
def covered(bodies):
    """Covered fractions in the pose of the camera as given."""
    return coverage(bodies, CAMERA, 16).fraction


def _frame(covered):
    """Radiances that differ over body and background."""
    row, column = np.mgrid[:48, :64]
    body, behind = 60 + 0.2 * row - 0.1 * column, 30 + 0.05 * row
    return covered * body + (1 - covered) * behind


def _fitted(bodies, frame, known=None, count=6):
    numbers = np.arange(count)
    known = np.ones(frame.shape, bool) if known is None else known
    start = np.zeros(6)
    start[numbers] = (START * UNIT)[numbers]
    given = bodies, CAMERA, frame, known, start, numbers, UNIT[numbers]
    return fit_outlines(*given)


def test_a_pose_is_found_to_a_small_part_of_a_pixel(bodies, covered):
    found = _fitted(bodies, _frame(covered))
    assert found is not None
    assert np.abs(found.numbers / UNIT).max() < 0.05


def test_what_is_not_known_is_not_compared(bodies, covered):
    """Half of the frame shows something else."""
    frame, known = _frame(covered), np.ones((48, 64), bool)
    frame[:, 32:], known[:, 32:] = 1e3, False
    found = _fitted(bodies, frame, known, 3)
    assert found is not None
    assert np.abs(found.numbers / UNIT[:3]).max() < 0.05
    nothing = np.zeros((48, 64), bool)
    assert _fitted(bodies, frame, nothing) is None


@pytest.mark.slow
@pytest.mark.slice
def test_the_spread_over_noise_is_the_one_reported(bodies, covered):
    """Of two numbers, with noise of a twentieth of the contrast."""
    found = []
    for seed in range(12):
        noise = 1.5 * np.random.default_rng(seed).standard_normal((48, 64))
        fit = _fitted(bodies, _frame(covered) + noise, None, 2)
        assert fit is not None
        found.append(fit)
    poses = np.stack([fit.numbers for fit in found])
    reported = np.mean([np.linalg.inv(fit.information) for fit in found], axis=0)
    ratio = poses.std(axis=0) / np.sqrt(np.diag(reported))
    print("spread over reported error", ratio)
    assert (ratio > 0.6).all()
    assert (ratio < 1.7).all()
