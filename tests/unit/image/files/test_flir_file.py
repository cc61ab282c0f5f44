"""Radiometric JPEG files of FLIR cameras."""

import dataclasses
import importlib.util

import numpy as np
import pytest
from flir_jpeg import flir_jpeg
from PIL import Image

import jaxthermo as jt


CALIBRATION = jt.FlirCalibration(r1=17096.453, b=1428.0, f=1.0, o=-342.0, r2=0.046)
SETTINGS = {
    "emissivity": 0.95,
    "reflected_temperature": 295.15,
    "distance": 3.0,
    "air_temperature": 293.15,
    "relative_humidity": 0.45,
    "window_transmissivity": 0.9,
    "window_temperature": 294.15,
}
# Large enough for a PNG of them to be smaller than the counts.
COUNTS = (13_000 + 256 * (np.arange(30 * 40) // 100)).reshape(30, 40)


def written(folder, as_png=False, name="frame.jpg", **settings):
    constants = dataclasses.asdict(CALIBRATION)
    path = folder / name
    path.write_bytes(flir_jpeg(COUNTS, constants | SETTINGS | settings, as_png))
    return path


@pytest.mark.parametrize("as_png", [False, True])
def test_counts_constants_and_settings_are_read(tmp_path, as_png):
    seen = jt.read_flir(written(tmp_path, as_png))
    np.testing.assert_array_equal(seen.counts, COUNTS)
    for name, value in (SETTINGS | dataclasses.asdict(CALIBRATION)).items():
        actual = getattr(seen if name in SETTINGS else seen.calibration, name)
        assert actual == pytest.approx(value, rel=1e-6), name


def test_temperatures_are_those_of_the_counts(tmp_path):
    path = written(tmp_path)
    apparent = CALIBRATION.temperature(COUNTS)
    np.testing.assert_allclose(jt.read_thermogram(path), apparent, rtol=1e-6)
    seen = jt.read_flir(path)
    expected = CALIBRATION.object_temperature(COUNTS, **SETTINGS)
    np.testing.assert_allclose(seen.object_temperature(), expected, rtol=1e-6)
    # With another emissivity than the one set at the camera.
    expected_at_emissivity = CALIBRATION.object_temperature(
        COUNTS, **SETTINGS | {"emissivity": 0.8}
    )
    np.testing.assert_allclose(
        seen.object_temperature(emissivity=0.8), expected_at_emissivity, rtol=1e-6
    )


def test_another_calibration_may_be_given(tmp_path):
    calibration = dataclasses.replace(CALIBRATION, b=1500.0)
    kelvin = jt.read_thermogram(written(tmp_path, name="a.JPEG"), "counts", calibration)
    np.testing.assert_allclose(kelvin, calibration.temperature(COUNTS))


def test_humidity_in_per_cent(tmp_path):
    path = written(tmp_path, relative_humidity=45.0)
    assert jt.read_flir(path).relative_humidity == pytest.approx(0.45)


def test_mistakes(tmp_path, monkeypatch):
    picture = tmp_path / "picture.jpg"
    Image.new("RGB", (8, 6)).save(picture)
    with pytest.raises(jt.InputError, match="no counts of a FLIR camera"):
        jt.read_thermogram(picture)
    path = written(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[:400])
    with pytest.raises(jt.InputError, match="no counts of a FLIR camera"):
        jt.read_thermogram(path)
    with pytest.raises(jt.InputError, match="not a file"):
        jt.read_flir(tmp_path / "none.jpg")
    path.write_bytes(content)
    with pytest.raises(jt.InputError, match="settings are emissivity, reflected"):
        jt.read_flir(path).object_temperature(emisivity=0.9)
    with pytest.raises(jt.InputError, match=r"FlirCalibration\(b=0.0\): give more"):
        jt.read_flir(written(tmp_path, b=0.0))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(jt.InputError, match=r'pip install "jaxthermo\[flir\]"'):
        jt.read_flir(path)
