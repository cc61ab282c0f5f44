"""The pose of a camera is found from a frame's outlines alone, as well as it says."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from calibrate.problem.outlines import fit_outlines
from jaxthermo.image.pose.coverage import coverage
from jaxthermo.image.surface.visible import WorldMesh


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
    return tuple(
        WorldMesh(turned + shift, mesh.faces) for shift in ([0, 0, 0], [-0.1, 0.05, 0])
    )


@pytest.fixture(scope="module")
def covered(bodies):
    """Covered fractions in the pose of the camera as given."""
    return coverage(bodies, CAMERA, 16).fraction


def _frame(covered):
    """Radiances that differ over body and background."""
    row, column = np.mgrid[:48, :64]
    body = 60 + 0.2 * row - 0.1 * column
    behind = 30 + 0.05 * row
    return covered * body + (1 - covered) * behind


def _fitted(bodies, frame, compared=None, count=6):
    numbers = np.arange(count)
    compared = np.ones(frame.shape, bool) if compared is None else compared
    start = np.zeros(6)
    start[numbers] = (START * UNIT)[numbers]
    return fit_outlines(
        bodies,
        camera=CAMERA,
        radiance=frame,
        compared=compared,
        pose=start,
        numbers=numbers,
        unit=UNIT[numbers],
    )


def test_a_pose_is_found_to_a_small_part_of_a_pixel(bodies, covered):
    outlines = _fitted(bodies, _frame(covered))
    assert outlines is not None
    assert np.abs(outlines.numbers / UNIT).max() < 0.05


def test_what_is_not_known_is_not_compared(bodies, covered):
    """Half of the frame shows something else."""
    frame = _frame(covered)
    compared = np.ones((48, 64), bool)
    frame[:, 32:] = 1e3
    compared[:, 32:] = False
    outlines = _fitted(bodies, frame=frame, compared=compared, count=3)
    assert outlines is not None
    assert np.abs(outlines.numbers / UNIT[:3]).max() < 0.05
    nothing = np.zeros((48, 64), bool)
    assert _fitted(bodies, frame, nothing) is None


@pytest.mark.slow
@pytest.mark.slice
def test_the_spread_over_noise_is_the_one_reported(bodies, covered):
    """Of two numbers, with noise of a twentieth of the contrast."""
    deviations = []
    for seed in range(12):
        noise = 1.5 * np.random.default_rng(seed).standard_normal((48, 64))
        fit = _fitted(bodies, frame=_frame(covered) + noise, compared=None, count=2)
        assert fit is not None
        deviations.append(fit)
    poses = np.stack([fit.numbers for fit in deviations])
    reported = np.mean([np.linalg.inv(fit.information) for fit in deviations], axis=0)
    ratio = poses.std(axis=0) / np.sqrt(np.diag(reported))
    print("spread over reported error", ratio)
    assert (ratio > 0.6).all()
    assert (ratio < 1.7).all()
