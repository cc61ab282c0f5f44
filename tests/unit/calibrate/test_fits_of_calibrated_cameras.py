"""Poses of cameras with a lens: found by outlines, and by a fit of whole frames."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from calibrate.config.loader import load_calibration
from calibrate.problem.outlines import fit_outlines
from jaxthermo.image.pose.coverage import coverage
from jaxthermo.image.surface.visible import WorldMesh
from tests.calibrating import assert_poses_are_the_truth, values_of_aligned_fit


CONFIG = Path(__file__).parents[3] / "configs" / "calibration" / "camera-pose.yaml"
K = ((131.0, 0.0, 33.4), (0.0, 128.0, 21.1), (0.0, 0.0, 1.0))
DISTORTION = (-1.2, 1.0, 0.004, -0.003)
POSE = {"position": (0.5, -0.3, 0.25), "look_at": (0.0, 0.05, 0.04)}
PIXEL = 1 / 130
UNIT = np.array([PIXEL, PIXEL, 4 * PIXEL])
START = np.array([0.6, -0.5, 0.3])
"""Turns [pixels]; moves would look much the same in so few pixels."""


def _away(camera, bodies, frame) -> float:
    """Error of the turns that the outlines of a frame give, about in pixels."""
    outlines = fit_outlines(
        bodies,
        camera=camera,
        radiance=frame,
        compared=np.ones(frame.shape, bool),
        pose=np.append(START * UNIT, np.zeros(3)),
        numbers=np.arange(3),
        unit=UNIT,
    )
    return np.inf if outlines is None else float(np.abs(outlines.numbers / UNIT).max())


def test_outlines_give_the_pose_of_a_camera_with_a_lens():
    mesh = jt.shapes.box((0.08, 0.06, 0.1))
    turned = Rotation.from_rotvec((0.2, 0.7, 0.1)).apply(mesh.vertices)
    bodies = tuple(
        WorldMesh(turned + shift, mesh.faces) for shift in ([0, 0, 0], [-0.1, 0.05, 0])
    )
    camera = jt.Camera.calibrated(K, 64, 48, DISTORTION, **POSE)
    fraction = coverage(bodies, camera, 16).fraction
    row, column = np.mgrid[:48, :64]
    body = 60 + 0.2 * row - 0.1 * column
    frame = fraction * body + (1 - fraction) * (30 + 0.05 * row)
    assert _away(camera, bodies, frame) < 0.03
    # Without its lens the camera is found elsewhere.
    plain = jt.Camera.calibrated(K, 64, 48, **POSE)
    assert _away(plain, bodies, frame) > 0.3


@pytest.mark.slow
def test_a_fit_finds_poses_and_properties_behind_a_lens():
    """As without a lens: poses to 0.1 degrees and 0.5 mm."""
    matrix = "[[431, 0, 163.1], [0, 426, 117.2], [0, 0, 1]]"
    lens = "[-0.4, 0.15, 0.002, -0.001, 0.01]"
    views = [
        f"{{position: {position}, look_at: [0, 0, 0.25], width: 320, height: 240, "
        f"K: {matrix}, distortion: {lens}}}"
        for position in ("[-0.8, 0.4, 0.7]", "[0.7, -0.55, 0.7]")
    ]
    config = load_calibration(CONFIG, (f"reference.views=[{', '.join(views)}]",))
    values = values_of_aligned_fit(config)
    assert_poses_are_the_truth(values)
    assert values["material.conductivity"] == pytest.approx(20.0, rel=0.01)
    assert values["material.emissivity"] == pytest.approx(0.85, rel=0.005)
