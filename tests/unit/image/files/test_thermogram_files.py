"""Frames of cameras from files of several kinds and units."""

import numpy as np
import pytest
from PIL import Image

import jaxthermo as jt
from tests.imaging import apparent


KELVIN = np.linspace(280.0, 330.0, 12).reshape(3, 4)
FLIR = jt.FlirCalibration()


def saved(folder, ending: str, numbers: np.ndarray):
    path = folder / f"frame{ending}"
    if ending == ".npy":
        np.save(path, numbers)
    elif ending == ".csv":
        np.savetxt(path, numbers, delimiter=",", header="time_s 3")
    else:
        Image.fromarray(numbers).save(path)
    return path


@pytest.mark.parametrize(
    ("ending", "unit", "numbers"),
    [
        (".npy", "kelvin", KELVIN),
        (".csv", "kelvin", KELVIN),
        (".tiff", "kelvin", KELVIN.astype(np.float32)),
        (".csv", "celsius", KELVIN - 273.15),
        (".png", "centikelvin", np.rint(100 * KELVIN).astype(np.uint16)),
        (".tif", "centikelvin", np.rint(100 * KELVIN).astype(np.uint16)),
    ],
)
def test_temperatures_are_read_in_their_unit(tmp_path, ending, unit, numbers):
    kelvin = jt.read_thermogram(saved(tmp_path, ending, numbers), unit)
    np.testing.assert_allclose(kelvin, KELVIN, atol=0.0051)


def test_counts_of_a_camera_become_temperatures(tmp_path):
    counts = np.rint(np.asarray(FLIR.counts(KELVIN))).astype(np.uint16)
    path = saved(tmp_path, ".png", counts)
    kelvin = jt.read_thermogram(path, "counts", FLIR)
    # A count is some 14 mK.
    np.testing.assert_allclose(kelvin, KELVIN, atol=0.01)


def test_extremely_cold_pixels_of_counts_cost_themselves(tmp_path):
    """Counts just above -O, such as those of dead pixels, give 96 to 150 K."""
    kelvin = KELVIN.copy()
    kelvin[1, :3] = 96.0, 149.9, 150.1
    counts = np.asarray(FLIR.counts(kelvin, allow_extreme_temperatures=True))
    path = saved(tmp_path, ".npy", counts)
    expected = np.where(kelvin < 150.0, np.nan, kelvin)
    np.testing.assert_allclose(jt.read_thermogram(path, "counts", FLIR), expected)
    whole = jt.read_thermogram(path, "counts", FLIR, allow_extreme_temperatures=True)
    np.testing.assert_allclose(whole, kelvin)
    # Hot ones, and temperatures that a file states, are a mistake of the whole frame.
    kelvin[1, 0] = 7000.0
    path = saved(tmp_path, ".npy", FLIR.counts(kelvin, allow_extreme_temperatures=True))
    with pytest.raises(jt.InputError, match="above 6000 K: 7000 K at row 1, column 0"):
        jt.read_thermogram(path, "counts", FLIR)
    with pytest.raises(jt.InputError, match="2 of 12 pixels are below 150 K: 96 K"):
        jt.read_thermogram(saved(tmp_path, ".npy", whole))
    cold = saved(tmp_path, ".npy", counts[1:2, :2])
    with pytest.raises(jt.InputError, match="no pixel has a temperature of 150 K or"):
        jt.read_thermogram(cold, "counts", FLIR)


def test_files_of_frames_are_read_back(tmp_path):
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=320.0)
    scene = jt.Scene((body,), (jt.Surroundings(290.0),))
    camera = jt.Camera((0.2, -0.2, 0.1), (0.0, 0.0, 0.0), width=16, height=12)
    image = jt.render(jt.simulate(scene, 0.0), camera)
    expected = apparent(image)
    jt.write_exr(tmp_path / "a.exr", image)
    jt.write_tiff(tmp_path / "a.tiff", image)
    jt.write_csv(tmp_path / "a.csv", image)
    jt.write_centikelvin(tmp_path / "a.png", image)
    for name, unit in (
        ("a.exr", "kelvin"),
        ("a.tiff", "kelvin"),
        ("a.csv", "kelvin"),
        ("a.png", "centikelvin"),
    ):
        kelvin = jt.read_thermogram(tmp_path / name, unit)
        np.testing.assert_allclose(kelvin, expected, atol=0.0052)


def test_a_csv_with_semicolons_and_commas_in_numbers(tmp_path):
    path = tmp_path / "frame.csv"
    path.write_text("20,5;21,25\n22;23,75\n")
    kelvin = jt.read_thermogram(path, "celsius")
    np.testing.assert_allclose(kelvin - 273.15, [[20.5, 21.25], [22.0, 23.75]])


def test_what_is_no_frame_is_refused_in_one_line(tmp_path):
    def refused(path, *how):
        with pytest.raises(jt.InputError) as caught:
            jt.read_thermogram(path, *how)
        text = str(caught.value)
        assert "\n" not in text
        return text

    good = saved(tmp_path, ".npy", KELVIN)
    assert "not a file" in refused(tmp_path / "none.npy")
    for unit in (
        "fahrenheit",
        {"scale": 0.0},
        {"factor": 2.0},
        {"offset": np.nan},
    ):
        assert "use one of" in refused(good, unit)
    assert "go together" in refused(good, "counts")
    assert "go together" in refused(good, "kelvin", FLIR)
    cold = saved(tmp_path, ".npy", KELVIN - 900)
    assert "12 of 12 pixels are below 150 K" in refused(cold, "celsius")
    empty = saved(tmp_path, ".npy", np.full((2, 2), np.nan))
    assert "no pixel has a temperature" in refused(empty)
    unknown = tmp_path / "frame.xyz"
    unknown.write_text("1")
    assert "frames may be" in refused(unknown)
    damaged = tmp_path / "frame.tiff"
    damaged.write_bytes(b"II*\x00nothing")
    assert "damaged" in refused(damaged)
    eight = saved(tmp_path, ".png", np.zeros((3, 4), np.uint8))
    assert "8 bits" in refused(eight)
    low = saved(tmp_path, ".png", np.full((3, 4), 7000, np.uint16))
    assert "no temperature" in refused(low, "counts", FLIR)
    words = tmp_path / "frame.csv"
    words.write_text("a,b\n")
    assert "damaged" in refused(words)
    words.write_text("")
    assert "no numbers" in refused(words)
    cube = saved(tmp_path, ".npy", np.zeros((2, 3, 4)))
    assert "one number for each row and column" in refused(cube)
