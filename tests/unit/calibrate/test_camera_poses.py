"""Poses of cameras as fitted values: residuals, names, mistakes, and a fit of all."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxthermo as jt
from calibrate.config.frame_names import check_frame_names, pose_numbers
from calibrate.config.loader import load_calibration
from calibrate.config.schema import shown_unit_of, value_in_si
from calibrate.problem.alignment import Aligned
from calibrate.problem.frame_data import FitsPoses
from calibrate.problem.frame_files import _read_mask
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.scene.compile.compile import compile_scene
from tests.calibrating import (
    assert_poses_are_the_truth,
    camera_of_block,
    frames_of,
    seen_block,
    target_of,
    values_of_aligned_fit,
)


CONFIG = Path(__file__).parents[3] / "configs" / "calibration" / "camera-pose.yaml"
SAVES = (20.0, 60.0)
CAMERA = camera_of_block(40, 32)
FITTED = ParameterSet(
    (
        Parameter(name="material.emissivity", start=(0.8,), lower=0.1, upper=1.0),
        Parameter("reflected_temperature", (230.0,), 150.0, 6000.0),
        Parameter(
            name="cameras.0.rotation",
            start=(0.01, 0.0, 0.0),
            lower=-0.1,
            upper=0.1,
            is_scalar=False,
        ),
        Parameter(
            name="cameras.0.translation.2", start=(0.002,), lower=-0.02, upper=0.02
        ),
    )
)


@pytest.fixture(scope="module")
def problem():
    """A block that is warm on one side, and a camera that is not where it is given."""
    scene = seen_block(temperature=350.0, surroundings=220.0)
    run = ParametricRun(SAVES, jt.ForwardEuler(dt=2.0))
    surfaces = compile_scene(scene, 1, 1.0).surfaces
    view = compute_view(surfaces, scene.terms, CAMERA)
    solution = run(scene, run.step_table(scene))
    frames = frames_of(view, scene, solution, SAVES)
    moving = FitsPoses(
        surfaces=surfaces,
        terms=scene.terms,
        poses=FITTED.start_poses(1),
        margin=2.0,
    )
    target = target_of(view, frames, SAVES, moving=moving)
    return Problem(FITTED, (Case(name="one", scene=scene, run=run, target=target),))


@pytest.fixture(scope="module")
def rows(problem):
    """Residuals by values and views, compiled."""
    tables = problem.step_tables_at(problem.start())
    return jax.jit(lambda z, views: problem.residuals(z, tables, views)[0])


# By default the derivative by a pose is that of frames, in test_pose_derivative.
@pytest.mark.slow
@pytest.mark.slice
def test_residuals_have_the_slopes_of_frames_rendered_again(problem, rows):
    """Along two ways, of properties and of the pose, to 1e-6 of the largest."""
    z = np.asarray(problem.start())
    slopes = np.asarray(jax.jit(jax.jacfwd(rows))(z, problem.views_at(z)))
    assert (np.abs(slopes).max(axis=0) > 0).all()
    step = 1e-6
    # Every number by a share of its own; a view of other pixels is another program.
    way = np.array([0.6, -0.8, 0.5, -0.4, 0.6, 0.45])
    of_pose = np.arange(len(z)) >= 2
    for change in (way * of_pose, way * ~of_pose):
        ends = [z + step * change, z - step * change]
        backward, forward = (
            np.asarray(rows(end, problem.views_at(end))) for end in ends
        )
        off = np.abs((backward - forward) / (2 * step) - slopes @ change)
        assert (off < 1e-6 * np.abs(slopes).max()).mean() > 0.99


def test_outlines_weigh_by_their_errors_and_those_of_the_data(problem, monkeypatch):
    """Rows of sqrt(effect) W (pose - found), whose variance in a gradient is known."""
    z = problem.start()
    whiten = np.array([[200.0, 30.0], [0.0, 500.0]])
    pose = np.array([0.01, 0, 0, 0, 0, 0.001])
    numbers = np.array([0, 5])
    aligned = {0: Aligned(pose, numbers, whiten, effect=9.0)}
    drawn = replace(problem, aligned=aligned)
    # The camera starts turned as found, and 1 mm beyond it.
    np.testing.assert_allclose(drawn._outline_rows(z), [0.09, 1.5], rtol=1e-6)
    assert problem._outline_rows(z).shape == (0,)
    monkeypatch.setattr("calibrate.problem.clusters._SQUARE", 8)
    count = len(problem.clusters())
    rows = np.zeros((1, count + 2))
    rows[0, -2:] = 3.0, 4.0
    scatter = drawn.scatter(rows, np.ones(count + 2))
    np.testing.assert_allclose(scatter, 25 * 9 * problem.known_sd**2)
    # Some squares of the image do not tell about fifty numbers.
    assert drawn.scatter(np.ones((50, count + 2)), np.ones(count + 2)) is None


def test_a_pose_that_sees_no_body_is_refused_by_its_residuals(problem, rows):
    z = problem.start()
    far = FITTED.coordinates(
        {**FITTED.values(z), "cameras.0.rotation": np.array([0.0999, 0.0999, 0.0])}
    )
    residual = np.asarray(rows(far, problem.views_at(far)))
    assert not np.isfinite(residual).any()


def test_names_of_poses_have_units_and_are_checked():
    assert pose_numbers("cameras.1.translation") == (1, (3, 4, 5))
    assert pose_numbers("cameras.0.rotation.2") == (0, (2,))
    assert value_in_si("2 deg", "cameras.0.rotation") == pytest.approx(np.pi / 90)
    assert shown_unit_of("cameras.0.translation.1") == ("mm", 1e-3)
    assert shown_unit_of("reflected_temperature") == ("K", 1.0)


@pytest.mark.parametrize(
    ("names", "cameras", "message"),
    [
        (["cameras.0.roll"], 1, "name the pose of a camera"),
        (["cameras.2.rotation"], 2, "there is 2 views, counted from 0"),
        (["cameras.0.rotation", "cameras.0.rotation.1"], 1, "is part of"),
        (["reflected_temperature"], 0, "there are no frames"),
    ],
)
def test_names_that_frames_do_not_have_are_refused(names, cameras, message):
    with pytest.raises(jt.InputError, match=message) as raised:
        check_frame_names(names, cameras)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("fit.method=lbfgs", "poses of cameras need levenberg_marquardt"),
        ("fit.starts=3", "poses of cameras are fitted from one start"),
        ("parameters.3.start=[1 mm, 0, 0]", "an angle"),
    ],
)
def test_mistakes_with_poses_are_one_line(change, message):
    with pytest.raises(jt.InputError, match=message) as raised:
        load_calibration(CONFIG, (change,))
    assert "\n" not in str(raised.value)


def test_masks_are_read_from_arrays(tmp_path):
    np.save(tmp_path / "mask.npy", np.array([[1.0, 0.0], [np.nan, 2.0]]))
    mask = _read_mask(tmp_path / "mask.npy")
    assert mask is not None and mask.tolist() == [[True, False], [False, True]]
    (tmp_path / "bad.npy").write_bytes(b"no array")
    with pytest.raises(jt.InputError, match=r"no array that"):
        _read_mask(tmp_path / "bad.npy")


@pytest.mark.slow
def test_poses_and_properties_are_found_of_frames_of_half_the_pitch():
    """Poses to 0.1 degrees and 0.5 mm; the coarser model's bias bounds the rest."""
    config = load_calibration(CONFIG)
    values = values_of_aligned_fit(config)
    assert_poses_are_the_truth(values)
    # Thin sleeves have other volumes in coarse voxels: h is 5.2 % off.
    assert values["material.conductivity"] == pytest.approx(20.0, rel=0.01)
    assert values["material.emissivity"] == pytest.approx(0.85, rel=0.005)
    h = values["convection.heat_transfer_coefficient"]
    assert h == pytest.approx(11.0, rel=0.07)
