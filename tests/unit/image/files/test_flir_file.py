"""Radiometric JPEG files of FLIR cameras."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flir_jpeg import USUAL, FlirFormat, flir_jpeg
from PIL import Image

import jaxthermo as jt


DATA = Path(__file__).parents[3] / "data" / "frames_and_api"

CALIBRATION = jt.FlirCalibration(r1=17096.453, b=1428.0, f=1.0, o=-342.0, r2=0.046)
SETTINGS: Any = {
    "emissivity": 0.95,
    "reflected_temperature": 295.15,
    "distance": 3.0,
    "air_temperature": 293.15,
    "relative_humidity": 0.45,
    "window_transmissivity": 0.9,
    "window_temperature": 294.15,
}
COUNTS = (13_000 + 7 * (np.arange(30 * 40) // 4)).reshape(30, 40)


def written(folder, form=USUAL, name="frame.jpg", counts=COUNTS, **settings):
    constants = dataclasses.asdict(CALIBRATION)
    path = folder / name
    path.write_bytes(flir_jpeg(counts, constants | SETTINGS | settings, form))
    return path


@pytest.mark.parametrize(
    "form",
    [
        FlirFormat(),
        FlirFormat(directory="<"),
        FlirFormat(record=">"),
        FlirFormat(directory="<", record=">"),
        # No entry of the directory is empty.
        FlirFormat(entries=2),
        FlirFormat(directory="<", entries=2),
        FlirFormat(png="swapped"),
        FlirFormat(png="native"),
    ],
)
def test_counts_constants_and_settings_are_read(tmp_path, form):
    seen = jt.read_flir(written(tmp_path, form))
    np.testing.assert_array_equal(seen.counts, COUNTS)
    for name, value in (SETTINGS | dataclasses.asdict(CALIBRATION)).items():
        actual = getattr(seen if name in SETTINGS else seen.calibration, name)
        assert actual == pytest.approx(value, rel=1e-6), name


def test_temperatures_are_those_of_the_counts(tmp_path):
    path = written(tmp_path)
    black = CALIBRATION.object_temperature(COUNTS, **SETTINGS | {"emissivity": 1.0})
    np.testing.assert_allclose(jt.read_thermogram(path), black, rtol=1e-6)
    seen = jt.read_flir(path)
    lens = CALIBRATION.temperature(COUNTS)
    np.testing.assert_allclose(seen.apparent_temperature(), lens, rtol=1e-6)
    expected = CALIBRATION.object_temperature(COUNTS, **SETTINGS)
    np.testing.assert_allclose(seen.object_temperature(), expected, rtol=1e-6)
    # With another emissivity than the one set at the camera.
    changed = SETTINGS | {"emissivity": 0.8}
    expected_at_emissivity = CALIBRATION.object_temperature(COUNTS, **changed)
    np.testing.assert_allclose(
        seen.object_temperature(emissivity=0.8), expected_at_emissivity, rtol=1e-6
    )


def test_another_calibration_may_be_given(tmp_path):
    calibration = dataclasses.replace(CALIBRATION, b=1500.0)
    kelvin = jt.read_thermogram(written(tmp_path, name="a.JPEG"), "counts", calibration)
    black = calibration.object_temperature(COUNTS, **SETTINGS | {"emissivity": 1.0})
    np.testing.assert_allclose(kelvin, black, rtol=1e-6)


@pytest.mark.parametrize("per_cent", [1.5, 45.0])
def test_humidity_in_per_cent(tmp_path, per_cent):
    path = written(tmp_path, relative_humidity=per_cent)
    assert jt.read_flir(path).relative_humidity == pytest.approx(per_cent / 100)


def test_both_byte_orders_of_the_directory_give_the_same_counts():
    big = jt.read_flir(DATA / "08-flir-big-endian-works.jpg")
    little = jt.read_flir(DATA / "08-flir-little-endian-directory.jpg")
    np.testing.assert_array_equal(big.counts, little.counts)
    assert big[1:] == little[1:]
    assert little.counts.shape == (12, 16)
    assert little.distance == 20.0
    assert little.calibration.o == -4400.0


def test_the_air_is_that_of_the_file():
    """Worked out from the formulas of Thermimage with the numbers in the file."""
    seen = jt.read_flir(DATA / "09-flir-own-air.jpg")
    assert seen.air_constants.x == pytest.approx(0.73)
    celsius = seen.object_temperature() - 273.15
    assert celsius.min() == pytest.approx(31.870, abs=6e-4)
    assert celsius.mean() == pytest.approx(40.391, abs=6e-4)
    assert celsius.max() == pytest.approx(47.893, abs=6e-4)
    other = seen.object_temperature(air_constants=jt.AirConstants()) - 273.15
    assert other.mean() == pytest.approx(40.127, abs=6e-4)


def test_a_file_without_constants_of_air_has_those_of_most_cameras(tmp_path):
    seen = jt.read_flir(written(tmp_path))
    assert seen.air_constants == jt.AirConstants(b=CALIBRATION.b)


def test_a_cold_pixel_costs_that_pixel(tmp_path):
    counts = COUNTS.copy()
    counts[4, 7] = 200
    path = written(tmp_path, counts=counts)
    cold = np.zeros(COUNTS.shape, bool)
    cold[4, 7] = True
    whole = jt.read_flir(written(tmp_path, name="whole.jpg"))
    seen = jt.read_flir(path)
    for actual, expected in (
        (jt.read_thermogram(path), whole.object_temperature(emissivity=1.0)),
        (seen.apparent_temperature(), whole.apparent_temperature()),
        (seen.object_temperature(), whole.object_temperature()),
    ):
        np.testing.assert_array_equal(np.isnan(actual), cold)
        np.testing.assert_array_equal(actual[~cold], expected[~cold])
    with pytest.raises(jt.InputError, match="there are no others"):
        jt.read_thermogram(written(tmp_path, counts=np.full_like(COUNTS, 200)))


def test_a_pixel_of_few_counts_costs_itself(tmp_path):
    """One that is read as 107 K, which no window or air is told to add to."""
    counts = COUNTS.copy()
    counts[4, 7] = 343
    clear: Any = {"distance": 0.0, "window_transmissivity": 1.0}
    path = written(tmp_path, counts=counts, **clear)
    coldest = jt.read_thermogram(path, allow_extreme_temperatures=True)[4, 7]
    assert coldest == pytest.approx(
        CALIBRATION.b / np.log(CALIBRATION.r1 / CALIBRATION.r2 + CALIBRATION.f)
    )
    assert 96 < coldest < 150
    kelvin = jt.read_thermogram(path)
    assert np.isnan(kelvin[4, 7])
    assert np.isfinite(kelvin).sum() == kelvin.size - 1


def test_mistakes(tmp_path):
    picture = tmp_path / "picture.jpg"
    Image.new("RGB", (8, 6)).save(picture)
    with pytest.raises(jt.InputError, match="no counts of a FLIR camera"):
        jt.read_thermogram(picture)
    path = written(tmp_path)
    content = path.read_bytes()
    # Cut anywhere, also within a record: one line.
    for size in (0, 2, 3, 30, 400, 1000, 3000):
        path.write_bytes(content[:size])
        with pytest.raises(jt.InputError, match="no counts of a FLIR camera") as cut:
            jt.read_thermogram(path)
        assert "\n" not in str(cut.value)
    with pytest.raises(jt.InputError, match="not a file"):
        jt.read_flir(tmp_path / "none.jpg")
    path.write_bytes(content)
    with pytest.raises(jt.InputError, match="settings are emissivity, reflected"):
        jt.read_flir(path).object_temperature(emisivity=0.9)
    with pytest.raises(jt.InputError, match=r"FlirCalibration\(b=0.0\): give more"):
        jt.read_flir(written(tmp_path, b=0.0))
