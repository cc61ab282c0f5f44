"""Measured frames: every way into a fit keeps unit, settings, masks and limits."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

import jaxthermo as jt
from calibrate.config.loader import load_calibration
from calibrate.config.schema import MeasuredFrames
from calibrate.problem.build import build
from calibrate.problem.frame_files import check_stated, read_measured
from calibrate.problem.frame_quantity import FrameQuantity
from calibrate.problem.targets import FrameTarget
from calibrate.solvers.fit import Fitting
from jaxthermo.image.files.exr import write_channels
from jaxthermo.image.radiance.band import LONG_WAVE
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.temperatures import ALLOW_EXTREME
from tests.calibrating import seen_block
from tests.flir_jpeg import flir_jpeg


DATA = Path(__file__).parents[2] / "data" / "frames_and_api"
QUANTITY = FrameQuantity("temperature", LONG_WAVE)
CONSTANTS = {"r1": 15900.0, "b": 1415.0, "f": 1.0, "o": -4400.0, "r2": 0.0145}
FLIR = jt.FlirCalibration(**CONSTANTS)
SETTINGS = {
    "emissivity": 1.0,
    "reflected_temperature": 293.15,
    "distance": 0.0,
    "air_temperature": 293.15,
    "relative_humidity": 0.5,
    "window_transmissivity": 1.0,
    "window_temperature": 293.15,
}
KELVIN = np.linspace(285.0, 320.0, 48).reshape(6, 8)


def silent(stage: str) -> None:
    """No log."""


def target(folder: str, *overrides: str) -> FrameTarget:
    """The data of an input."""
    config = load_calibration(DATA / folder / "calibration.yaml", overrides)
    built = build(config, silent).train.cases[0].target
    assert isinstance(built, FrameTarget)
    return built


@pytest.fixture(scope="module")
def control() -> FrameTarget:
    return target("00-works-celsius-tiff")


@pytest.mark.parametrize(
    ("folder", "tolerance"),
    [
        ("01-exr-unit-celsius", 1e-4),
        # A count is some 10 mK, and the window lets 0.85 of it through.
        ("03-cold-pixel-masked-out", 0.02),
        ("04-jpg-behind-window", 0.02),
    ],
)
def test_all_files_of_the_control_are_the_same_data(control, folder, tolerance):
    """What a fit then finds is that of the control."""
    data = target(folder)
    np.testing.assert_array_equal(data.indices[0], control.indices[0])
    np.testing.assert_allclose(data.data[0], control.data[0], atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize(
    "folder",
    [
        "00-works-celsius-tiff",
        "01-exr-unit-celsius",
        "03-cold-pixel-masked-out",
        "04-jpg-behind-window",
    ],
)
def test_fits_find_the_values_of_the_control(folder):
    """k 19.84 W/(m K) and h 29.52 W/(m^2 K), made with 20 and 30 and 50 mK of noise."""
    config = load_calibration(DATA / folder / "calibration.yaml")
    problem = build(config, silent).train
    fit = Fitting(problem, config.fit).run()
    values = [float(value) for value in problem.parameters.values(fit.z).values()]
    assert values == pytest.approx([19.84, 29.52], rel=0.01)


def refusal(call, *arguments, **options) -> str:
    with pytest.raises(jt.InputError) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_dead_pixels_are_counted_with_their_place():
    message = refusal(target, "02-dead-pixels-zero")
    assert "4 of " in message and "compared pixels are below 150 K" in message
    assert (
        "0 K at row 11, column 15 at 60 s, 0 K at row 13, column 17 at 60 s" in message
    )
    assert "mask them" in message


@pytest.mark.parametrize(
    ("unit", "likely"),
    [
        ("kelvin", "celsius"),
        ("centikelvin", "celsius"),
        ("{scale: 0.04 K, offset: 100 K}", "celsius"),
    ],
)
def test_a_wrong_unit_is_told_with_the_likely_one(unit, likely):
    message = refusal(target, "00-works-celsius-tiff", f"reference.unit={unit}")
    assert f"give the unit of the file, probably {likely}" in message
    assert "allow_extreme_temperatures" in message


def written(folder: Path, ending: str, numbers: np.ndarray) -> Path:
    path = folder / f"frame{ending}"
    match ending:
        case ".exr":
            write_channels(path, {"apparent_temperature": numbers})
        case ".tiff":
            tifffile.imwrite(path, numbers.astype(np.float32))
        case ".png":
            Image.fromarray(np.rint(numbers).astype(np.uint16)).save(path)
        case ".csv":
            np.savetxt(path, numbers, delimiter=";")
        case _:
            np.save(path, numbers)
    return path


def read(path: Path, allow: bool = False, **settings) -> np.ndarray:
    frames = [{"case": "one", "files": [str(path)]}]
    config = MeasuredFrames.model_validate(
        {"frames": frames, **settings}, context={ALLOW_EXTREME: allow}
    )
    views = read_measured(
        "one", config, QUANTITY, allow_extreme_temperatures=allow
    ).frames
    return views[0][0]


@pytest.mark.parametrize("ending", [".exr", ".tiff", ".png", ".csv", ".npy"])
@pytest.mark.parametrize(
    ("unit", "scale", "offset"),
    [
        ("kelvin", 1.0, 0.0),
        ("K", 1.0, 0.0),
        ("celsius", 1.0, 273.15),
        ("degC", 1.0, 273.15),
        ("centikelvin", 0.01, 0.0),
        ({"scale": "0.04 K", "offset": "0 K"}, 0.04, 0.0),
        ({"scale": 0.04}, 0.04, 0.0),
        ({"scale": "10 mK", "offset": "-20 degC"}, 0.01, 253.15),
    ],
)
def test_every_kind_of_file_has_every_unit(tmp_path, ending, unit, scale, offset):
    """In a fit as in Python, with the temperatures of the formula."""
    path = written(tmp_path, ending, (KELVIN - offset) / scale)
    tolerance = 0.51 * scale if ending == ".png" else 2e-5
    np.testing.assert_allclose(read(path, unit=unit), KELVIN, atol=tolerance)
    if isinstance(unit, dict):
        unit = {"scale": scale, "offset": offset}
    channel = "apparent_temperature"
    kelvin = jt.read_thermogram(path, unit, channel=channel)
    np.testing.assert_allclose(kelvin, KELVIN, atol=tolerance)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"unit": {"scale": 0.0}}, "must be more than 0"),
        ({"unit": {"offset": 3.0}}, "scale"),
        ({"unit": "fahrenheit"}, "kelvin"),
        ({"unit": "counts", "flir": CONSTANTS, "corrected_for": {"emissivity": 0.9}},
         "counts are never corrected"),
        ({"quantity": "radiance", "corrected_for": {"emissivity": 0.9}},
         "quantity. is radiance"),
        ({"corrected_for": {"emissivity": 0.9, "reflected_temperature": 20}},
         "20 K is below 150 K"),
        ({"camera_settings": {"window_temperature": 20}}, "20 K is below 150 K"),
    ],
)  # fmt: skip
def test_settings_that_are_none_are_refused(tmp_path, settings, message):
    path = written(tmp_path, ".npy", KELVIN)
    with pytest.raises(ValueError, match=message):
        read(path, **settings)


def test_files_that_state_kelvin_are_not_read_in_celsius(tmp_path):
    """280 K would be 553 K, which is a temperature too."""
    exr = tmp_path / "own.exr"
    write_channels(exr, {"apparent_temperature_K": KELVIN})
    csv = tmp_path / "own.csv"
    csv.write_text("# unit,K\n280,281\n290,300\n")
    tiff = tmp_path / "own.tiff"
    tifffile.imwrite(
        tiff, KELVIN.astype(np.float32), description="ImageJ=1.54f\nunit_of_values=K\n"
    )
    for path in (exr, csv, tiff):
        assert "in kelvin" in refusal(read, path, unit="celsius")
        assert "in kelvin" in refusal(jt.read_thermogram, path, "degC")
        assert np.isfinite(read(path, unit="K")).all()


def test_exported_frames_are_turned_back_to_what_the_camera_shows(tmp_path):
    """L(T_shown) = eps L(T) + (1 - eps) L(T_reflected), in the band of the scene."""
    path = written(tmp_path, ".npy", KELVIN)
    correction = {"emissivity": 0.8, "reflected_temperature": "7 degC"}
    shown = read(path, corrected_for=correction)
    black = LONG_WAVE.radiance(KELVIN)
    expected = 0.8 * black + 0.2 * LONG_WAVE.radiance(np.array(280.15))
    np.testing.assert_allclose(LONG_WAVE.radiance(shown), expected, rtol=1e-9)
    default = read(path, corrected_for={"emissivity": 0.8})
    expected = 0.8 * black + 0.2 * LONG_WAVE.radiance(np.array(293.15))
    np.testing.assert_allclose(LONG_WAVE.radiance(default), expected, rtol=1e-9)
    assert read(path, corrected_for={"emissivity": 1}) == pytest.approx(KELVIN)


def test_dead_pixels_of_exported_frames_stay_what_they_are(tmp_path):
    dead = KELVIN.copy()
    dead[1, 2] = 0.0
    dead[3, 4] = np.nan
    shown = read(written(tmp_path, ".npy", dead), corrected_for={"emissivity": 0.8})
    assert shown[1, 2] == 0.0
    assert np.isnan(shown[3, 4])
    assert np.isfinite(shown).sum() == KELVIN.size - 1


def seen_through(kelvin, settings) -> np.ndarray:
    """Counts of black surfaces through air and a window, the reverse of the reading."""
    low, high = (
        FLIR.object_temperature(
            counts, **settings | {"emissivity": 1.0}, allow_extreme_temperatures=True
        )
        for counts in (9000.0, 16000.0)
    )
    ends = FLIR.counts(np.array([low, high]))
    # Counts before air and window are linear in those behind them.
    slope = 7000.0 / (ends[1] - ends[0])
    return 9000.0 + slope * (FLIR.counts(kelvin) - ends[0])


def jpeg(folder: Path, **changes: float) -> Path:
    settings = SETTINGS | changes
    counts = np.rint(seen_through(KELVIN, settings)).astype(np.uint16)
    path = folder / "frame.jpg"
    path.write_bytes(flir_jpeg(counts, settings | CONSTANTS))
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"window_transmissivity": 0.85, "window_temperature": 288.15},
        {"distance": 20.0, "air_temperature": 303.15},
        {"emissivity": 0.8, "reflected_temperature": 260.0},
    ],
)
def test_air_and_window_of_a_camera_are_taken_out(tmp_path, changes):
    """The surface as it is shown for an emissivity of 1, in a fit as in Python."""
    path = jpeg(tmp_path, **changes)
    np.testing.assert_allclose(read(path), KELVIN, atol=0.02)
    np.testing.assert_allclose(jt.read_thermogram(path), KELVIN, atol=0.02)


def test_settings_of_the_camera_may_be_given(tmp_path):
    """Of a file with other settings, and of counts that have none."""
    changes = {"window_transmissivity": 0.85, "window_temperature": 288.15}
    counts = seen_through(KELVIN, SETTINGS | changes)
    path = written(tmp_path, ".npy", counts)
    kelvin = read(path, unit="counts", flir=CONSTANTS, camera_settings=changes)
    np.testing.assert_allclose(kelvin, KELVIN, atol=1e-6)
    path = jpeg(tmp_path, **changes)
    kelvin = read(path, camera_settings={"window_transmissivity": 1.0})
    assert np.abs(kelvin - KELVIN).max() > 0.5


def test_settings_of_a_camera_in_the_cold_need_the_option(tmp_path):
    """Of its file and of the calibration; both are refused by their name."""
    path = jpeg(tmp_path, emissivity=0.9, reflected_temperature=100.0)
    message = refusal(read, path)
    assert f"{path}: FlirCalibration: reflected_temperature: 100 K is below" in message
    np.testing.assert_allclose(read(path, allow=True), KELVIN, atol=0.02)
    settings = {"window_transmissivity": 0.85, "window_temperature": 100.0}
    numbers = written(tmp_path, ".npy", seen_through(KELVIN, SETTINGS | settings))
    kelvin = read(
        numbers, True, unit="counts", flir=CONSTANTS, camera_settings=settings
    )
    np.testing.assert_allclose(kelvin, KELVIN, atol=1e-6)


def test_the_option_of_a_calibration_holds_for_settings_of_its_cameras(control):
    """A window of 100 K adds less radiation: what is behind it is warmer."""
    data = target(
        "04-jpg-behind-window",
        "allow_extreme_temperatures=true",
        "reference.camera_settings={window_temperature: 100}",
    )
    assert (np.asarray(data.data[0]) > np.asarray(control.data[0]) + 1.0).all()


def test_exported_frames_of_the_cold_are_turned_back_where_they_are_allowed(tmp_path):
    """Without the option they stay as they are, to be refused where they count."""
    cold = np.linspace(90.0, 140.0, 48).reshape(6, 8)
    path = written(tmp_path, ".npy", cold)
    correction = {"emissivity": 0.8, "reflected_temperature": 180.0}
    np.testing.assert_array_equal(read(path, corrected_for=correction), cold)
    shown = read(path, True, corrected_for=correction)
    expected = 0.8 * LONG_WAVE.radiance(cold)
    expected += 0.2 * LONG_WAVE.radiance(np.array(180.0))
    np.testing.assert_allclose(LONG_WAVE.radiance(shown), expected, rtol=1e-9)


def test_cold_pixels_of_counts_stay_what_they_are(tmp_path):
    """To be masked, or refused with their place where frames are compared."""
    kelvin = KELVIN.copy()
    kelvin[2, 5] = 110.0
    counts = FLIR.counts(kelvin, allow_extreme_temperatures=True)
    path = written(tmp_path, ".npy", counts)
    np.testing.assert_allclose(read(path, unit="counts", flir=CONSTANTS), kelvin)


def test_what_a_kind_of_file_does_not_have_is_refused(tmp_path):
    numbers = written(tmp_path, ".npy", KELVIN)
    picture = jpeg(tmp_path)
    assert "are for counts" in refusal(
        read, numbers, camera_settings={"emissivity": 0.9}
    )
    assert "never corrected" in refusal(
        read, picture, corrected_for={"emissivity": 0.9}
    )
    assert "EXR files alone" in refusal(read, picture, quantity="radiance")


def check(path: Path, fitted: tuple[str, ...] = (), **settings) -> None:
    """Compare what a file states with a block of emissivity 0.8 before 260 K."""
    frames = [{"case": "one", "files": [str(path)]}]
    config = MeasuredFrames.model_validate({"frames": frames, **settings})
    scene = seen_block(temperature=300.0, surroundings=260.0)
    check_stated(
        read_measured("one", config, QUANTITY).stated,
        surfaces=compile_scene(scene, 1, 1.0).surfaces,
        terms=scene.terms,
        settings=config,
        fitted=fitted,
    )


def test_a_camera_set_to_another_surface_than_the_scenes_is_refused(tmp_path):
    """By name, with the file; what the calibration says or fits is not contradicted."""
    path = jpeg(tmp_path, emissivity=0.95, reflected_temperature=293.15)
    message = refusal(check, path)
    assert f"{path}: the camera was set to an emissivity of 0.95" in message
    assert "surfaces of the scene have 0.8" in message
    message = refusal(check, path, ("material.emissivity",))
    assert (
        "reflected temperature of 293.15 K, and surfaces of the scene reflect 260 K"
        in (message)
    )
    check(path, ("material.emissivity", "reflected_temperature"))
    check(path, ("material.emissivity",), reflected_temperature=280.0)
    check(path, camera_settings={"emissivity": 1})
    check(jpeg(tmp_path, emissivity=0.8, reflected_temperature=260.0))
    # An emissivity of 1 corrects nothing, and states nothing of the surface.
    check(jpeg(tmp_path, emissivity=1.0, reflected_temperature=293.15))
