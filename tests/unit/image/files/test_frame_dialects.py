"""Frames in the dialects of CSV and TIFF that cameras and spreadsheets write."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

import jaxthermo as jt
from jaxthermo.image.files.thermogram_files import read_temperatures
from jaxthermo.temperatures import KELVIN as KELVIN_UNIT


DATA = Path(__file__).parents[3] / "data" / "frames_and_api"
CELSIUS = np.array([[20.5, 21.25, -3.0], [22.0, 23.75, 1e2]])
KELVIN = 273.15 + CELSIUS


@pytest.mark.parametrize("name", ["10-trailing-semicolon", "10-header-lines-latin1"])
def test_files_of_a_camera_with_german_numbers(name):
    kelvin = jt.read_thermogram(DATA / f"{name}.csv", "celsius")
    expected = np.linspace(20.0, 35.0, 12).reshape(3, 4)
    np.testing.assert_allclose(kelvin - 273.15, expected, atol=0.0051)


DIALECTS = {
    "commas": "20.5,21.25,-3\n22,23.75,1e2\n",
    "semicolons": "20.5;21.25;-3\n22;23.75;1e2\n",
    "tabs": "20.5\t21.25\t-3\n22\t23.75\t1e2\n",
    "spaces": "  20.5   21.25  -3\n22 23.75 1e2\n",
    "decimal commas": "20,5;21,25;-3,0\n22,0;23,75;1e2\n",
    "decimal commas and tabs": "20,5\t21,25\t-3\n22\t23,75\t1e2\n",
    "quotes": '"20,5","21,25","-3"\n"22","23,75","1e2"\n',
    "a separator at each end": "20.5,21.25,-3,\n22,23.75,1e2,\n",
    "a tab at each end": "20.5\t21.25\t-3\t\n22\t23.75\t1e2\t\n",
    "line ends of old Macs": "20.5;21.25;-3\r22;23.75;1e2\r",
    "line ends of Windows": "20.5;21.25;-3\r\n22;23.75;1e2\r\n\r\n",
    "no last line end": "20.5;21.25;-3\n22;23.75;1e2",
    "a header of settings": "Camera;X-1\nE;0,95\n\n20,5;21,25;-3\n22;23,75;1e2",
    "a header of another separator": "E: 0.95, 3 m\n20,5;21,25;-3\n22;23,75;1e2",
    "a mark of Excel": "sep=;\n20,5;21,25;-3\n22;23,75;1e2\n",
    "comments": "# time_s 3\n20.5,21.25,-3\n# half\n22,23.75,1e2\n",
}


@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_dialects_of_csv(tmp_path, text, encoding):
    path = tmp_path / "frame.csv"
    path.write_bytes(text.encode(encoding))
    np.testing.assert_allclose(jt.read_thermogram(path, "celsius"), KELVIN)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "it has no numbers"),
        ("", "it has no numbers"),
        ("20;21\n22\n", "line 2 has 1 numbers and line 1 has 2"),
        ("20;21\n22;23;24\n", "line 2 has 3 numbers and line 1 has 2"),
        ("Frame 1\n20;21\nFrame 2\n22;23\n", "line 3, 'Frame 2', below rows"),
        ("20;x\n22;23\n20;warm\n", "line 3, '20;warm', below rows"),
        ("1.020,5;1\n20;1\n30;oops\n", "line 3, '30;oops', below rows"),
    ],
)
def test_what_is_no_frame_says_where(tmp_path, text, message):
    path = tmp_path / "frame.csv"
    path.write_text(text)
    with pytest.raises(jt.InputError, match=message) as caught:
        jt.read_thermogram(path, "celsius")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8", ">f4", ">f8", "u2", ">u2", "i4"])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_types_of_numbers_in_tiff_files(tmp_path, dtype, compression):
    path = tmp_path / "frame.tif"
    numbers = np.linspace(280.0, 330.0, 12).reshape(3, 4).astype(dtype)
    order = ">" if dtype.startswith(">") else "<"
    tifffile.imwrite(path, numbers, byteorder=order, compression=compression)
    np.testing.assert_array_equal(jt.read_thermogram(path), numbers)


def test_pages_of_tiff_files_are_frames(tmp_path):
    path = tmp_path / "frames.tiff"
    frames = np.linspace(280.0, 330.0, 24).reshape(2, 3, 4)
    tifffile.imwrite(path, frames, photometric="minisblack")
    np.testing.assert_array_equal(read_temperatures(path, KELVIN_UNIT), frames)
    for page in (0, 1):
        np.testing.assert_array_equal(jt.read_thermogram(path, page=page), frames[page])
    with pytest.raises(jt.InputError, match="has 2 pages") as several:
        jt.read_thermogram(path)
    # The reader's own message, and not that the file is damaged.
    assert "damaged" not in str(several.value)
    with pytest.raises(jt.InputError, match="no page 2: it has 2, from page 0"):
        jt.read_thermogram(path, page=2)


def test_small_copies_of_a_picture_are_no_frames(tmp_path):
    path = tmp_path / "frame.tiff"
    frame = np.linspace(280.0, 330.0, 12).reshape(3, 4)
    with tifffile.TiffWriter(path) as file:
        file.write(frame)
        file.write(frame[:2, :2], subfiletype=1)
    np.testing.assert_array_equal(jt.read_thermogram(path), frame)
    assert len(read_temperatures(path, KELVIN_UNIT)) == 1


def test_pictures_of_8_bits_are_refused_as_such(tmp_path):
    path = tmp_path / "frame.tiff"
    tifffile.imwrite(path, np.zeros((3, 4), np.uint8))
    with pytest.raises(jt.InputError, match="8 bits") as caught:
        jt.read_thermogram(path)
    assert "damaged" not in str(caught.value)


def test_a_page_of_what_has_none_is_refused(tmp_path):
    path = tmp_path / "frame.npy"
    np.save(path, KELVIN)
    with pytest.raises(jt.InputError, match="page 1 is one of a TIFF file"):
        jt.read_thermogram(path, page=1)


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    """Of 240 files that are cut or have other bytes, none raises anything else."""
    rng = np.random.default_rng(5)
    tifffile.imwrite(tmp_path / "a.tif", KELVIN, photometric="minisblack")
    (tmp_path / "a.csv").write_text("E;0,95\n" + DIALECTS["decimal commas"])
    np.save(tmp_path / "a.npy", KELVIN)
    (tmp_path / "a.jpg").write_bytes(
        (DATA / "08-flir-little-endian-directory.jpg").read_bytes()
    )
    refused = 0
    for number in range(240):
        whole = tmp_path / f"a.{('tif', 'csv', 'npy', 'jpg')[number % 4]}"
        content = bytearray(whole.read_bytes())
        # Most of a small file is its head.
        for position in rng.integers(0, min(len(content), 300), 3):
            content[position] = rng.integers(256)
        if number % 3 == 0:
            del content[rng.integers(len(content)) :]
        damaged = tmp_path / f"damaged{whole.suffix}"
        damaged.write_bytes(content)
        try:
            assert jt.read_thermogram(damaged).ndim == 2
        except jt.InputError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 100
