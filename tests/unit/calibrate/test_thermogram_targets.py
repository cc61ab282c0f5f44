"""Frames: what a pixel shows goes with every value; data must fit the camera."""

import jax
import numpy as np
import PIL.Image
import pytest
from pydantic import ValidationError

import jaxthermo as jt
from calibrate.config.schema import MeasuredFrames
from calibrate.problem.frame_files import read_measured
from calibrate.problem.frame_quantity import FrameQuantity
from calibrate.problem.frame_source import _detected
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from calibrate.problem.targets import body_mask
from jaxthermo.image.files.exr import write_channels
from jaxthermo.image.pose.coverage import coverage
from jaxthermo.image.radiance.band import LONG_WAVE
from jaxthermo.image.surface.view import compute_view
from jaxthermo.image.surface.visible import world_meshes
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import blocks
from tests.calibrating import camera_of_block, frames_of, seen_block, target_of


SAVES = (4.0, 8.0)
CAMERA = camera_of_block(14, 12)
FITTED = ParameterSet(
    (
        Parameter("material.conductivity", (16.0,), 0.0),
        Parameter("convection.heat_transfer_coefficient", (30.0,), 0.0),
        Parameter(name="material.emissivity", start=(0.8,), lower=0.0, upper=1.0),
        Parameter(name="weights.within", start=(1.0,), lower=0.01, upper=100.0),
    )
)


@pytest.fixture(scope="module")
def scene():
    return seen_block(temperature=300.0, surroundings=260.0)


@pytest.fixture(scope="module")
def view(scene):
    return compute_view(compile_scene(scene, 1, 1.0).surfaces, scene.terms, CAMERA)


# By default apparent temperatures have theirs, in test_render.
@pytest.mark.slow
@pytest.mark.slice
def test_a_pixels_radiance_has_the_gradient_of_its_differences(scene, view):
    """By k, h, emissivity and a weight, to 1e-6 of the largest."""
    run = ParametricRun(SAVES)
    table = run.divided(run.fewest_steps(scene), float(run.longest_step(scene)) / 2)
    row, column = (int(n) for n in np.argwhere(body_mask(view))[20])

    def radiance(z):
        changed = FITTED.insert(scene, z)
        solution = run(changed, table)
        frame_quantity = FrameQuantity("radiance")
        frames = frame_quantity.frames(view, changed, solution=solution, times=SAVES)
        return frames[1, row, column]

    value_and_jacobian = jax.jit(lambda z: (radiance(z), jax.jacfwd(radiance)(z)))
    step = 1e-4
    for slope, z in zip(
        value_and_jacobian(np.zeros(4))[1], step * np.eye(4), strict=True
    ):
        difference = float(value_and_jacobian(z)[0] - value_and_jacobian(-z)[0]) / (
            2 * step
        )
        assert slope == pytest.approx(difference, rel=1e-6, abs=1e-9)
        assert abs(slope) > 1e-4


@pytest.mark.slow
@pytest.mark.slice
def test_a_pixel_of_a_detector_shows_the_mean_of_its_rays():
    """A body of 300 K before 293.15 K: the radiances, by what the body covers."""
    metal = jt.Material(16.0, 8000.0, 500.0, emissivity=1.0)
    structure = jt.ShellOverCore(blocks(np.ones((6, 6, 6), bool), 0.01), factor=2)
    scene = jt.Scene((jt.Body(structure, metal, temperature=300.0),), dtype="float64")
    run = ParametricRun((1.0,))
    solution = run(scene, run.step_table(scene))
    (frames,) = _detected(
        CAMERA,
        scene=scene,
        solution=solution,
        times=(1.0,),
        samples=3,
        frame_quantity=FrameQuantity("temperature", LONG_WAVE),
    )
    covered = coverage(world_meshes(solution.surfaces), CAMERA, 3).fraction
    body, behind = (float(LONG_WAVE.radiance(kelvin)) for kelvin in (300.0, 293.15))
    mixed = covered * body + (1 - covered) * behind
    np.testing.assert_allclose(frames, LONG_WAVE.temperature(mixed), atol=1e-3)
    assert ((covered > 0) & (covered < 1)).sum() > 10


def test_residuals_count_standard_deviations(scene, view):
    """Data off by one standard deviation everywhere: the squares sum to 1."""
    run = ParametricRun(SAVES)
    solution = run(scene, run.step_table(scene))
    frames = frames_of(view, scene, solution, SAVES, "radiance")
    target = target_of(view, frames + 0.05, SAVES, "radiance")
    rows = np.asarray(target.residual(scene, solution))
    assert (rows**2).sum() == pytest.approx(1.0)
    assert target.known_sd == pytest.approx(1 / np.sqrt(rows.size))
    assert target.mask(0).sum() == rows.shape[1] == body_mask(view).sum()
    problem = Problem(FITTED, (Case(name="one", scene=scene, run=run, target=target),))
    assert problem.known_sd == pytest.approx(target.known_sd)


@pytest.mark.parametrize(
    ("frames", "mask", "message"),
    [
        (np.ones((2, 12, 13)), None, "13 x 12 pixels and a camera of 14 x 12"),
        (np.ones((3, 12, 14)), None, "3 frames for 2 saved times"),
        (np.full((2, 12, 14), np.nan), None, "are not finite"),
        (np.ones((2, 12, 14)), np.zeros((12, 14), bool), "no pixel of a body"),
        (np.full((2, 12, 14), 20.0), None, "are below 150 K: 20 K at row"),
        (np.full((2, 12, 14), 6e4), None, "are above 6000 K: 60000 K at row"),
    ],
)
def test_frames_that_do_not_fit_are_refused(view, frames, mask, message):
    with pytest.raises(jt.InputError, match=message):
        target_of(view, frames, SAVES, masks=[mask])


def test_extreme_frames_are_allowed_by_the_scene_alone(view):
    """Temperatures below 150 K, and radiances of black surfaces below 150 K."""
    cold = np.full((2, 12, 14), 100.0)
    assert target_of(view, cold, SAVES, allow=True).pixel_count
    # sigma T^4 / pi of 149 and 151 K.
    for radiance, is_refused in ((8.896, True), (9.384, False)):
        frames = np.full((2, 12, 14), radiance)
        assert target_of(view, frames, SAVES, "radiance", allow=True).pixel_count
        if is_refused:
            with pytest.raises(jt.InputError, match=r"below 9.13\d+ W/\(m\^2 sr\)"):
                target_of(view, frames, SAVES, "radiance")
        else:
            assert target_of(view, frames, SAVES, "radiance").pixel_count
    with pytest.raises(jt.InputError, match="below 0 K"):
        target_of(view, -cold, SAVES, allow=True)


def test_only_compared_pixels_are_checked(view):
    frames = np.full((2, 12, 14), 300.0)
    frames[:, ~body_mask(view)] = 0.0
    assert target_of(view, frames, SAVES).pixel_count
    row, column = np.argwhere(body_mask(view))[7]
    frames[1, row, column] = np.nan
    place = f"1 compared pixels are not finite: nan K at row {row}, column {column} at"
    with pytest.raises(jt.InputError, match=place):
        target_of(view, frames, SAVES)
    mask = np.ones((12, 14), bool)
    mask[row, column] = False
    assert target_of(view, frames, SAVES, masks=[mask]).pixel_count


def test_frames_of_cameras_are_read_in_their_unit(scene, view, tmp_path):
    """The same temperatures from counts, a grey PNG, and the channel of our files."""
    kelvin = np.linspace(290.0, 320.0, 12 * 14).reshape(12, 14)
    flir = jt.FlirCalibration()
    counts = np.rint(np.asarray(flir.counts(kelvin))).astype(np.uint16)
    PIL.Image.fromarray(counts).save(tmp_path / "raw.png")
    hundredths = np.rint(100 * kelvin).astype(np.uint16)
    PIL.Image.fromarray(hundredths).save(tmp_path / "grey.png")
    write_channels(tmp_path / "own.exr", {"apparent_temperature_K": kelvin})
    constants = {name: getattr(flir, name) for name in ("r1", "b", "f", "o", "r2")}
    for file, units in (
        ("raw.png", {"unit": "counts", "flir": constants}),
        ("grey.png", {"unit": "centikelvin"}),
        ("own.exr", {}),
    ):
        frames = [{"case": "one", "files": [str(tmp_path / file)]}]
        settings = MeasuredFrames.model_validate({"frames": frames, **units})
        (read,) = read_measured("one", settings, FrameQuantity("temperature")).frames
        np.testing.assert_allclose(read[0], kelvin, atol=0.01)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"unit": "counts"}, "goes with `unit: counts`"),
        ({"unit": "celsius", "quantity": "radiance"}, "is of temperatures"),
    ],
)
def test_units_that_do_not_fit_are_refused(settings, message, tmp_path):
    file = tmp_path / "a.npy"
    np.save(file, np.zeros((2, 2)))
    frames = [{"case": "one", "files": [str(file)]}]
    with pytest.raises(ValidationError, match=message):
        MeasuredFrames.model_validate({"frames": frames, **settings})
