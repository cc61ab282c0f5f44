"""Files of a frame for other programs: the temperatures come back, with their unit."""

import numpy as np
import pytest
import tifffile
from frames import frame
from PIL import Image as Pictures

from jaxthermo.errors import InputError
from jaxthermo.image.colour.frame_values import covered_fraction, shown_temperature
from jaxthermo.image.colour.picture import picture
from jaxthermo.image.files.exr import read_exr, write_exr
from jaxthermo.image.files.raster_files import write_centikelvin, write_csv, write_tiff
from jaxthermo.image.radiance.image import coarsen


KELVIN = 280.0 + np.random.default_rng(3).uniform(0.0, 60.0, (5, 7))
WRITERS = (write_centikelvin, write_tiff, write_csv)


def test_centikelvin_are_grey_and_of_16_bits(tmp_path):
    path = tmp_path / "frame.png"
    assert write_centikelvin(path, frame(KELVIN)) == 0
    with Pictures.open(path) as file:
        counts = np.asarray(file)
        texts = dict(file.info)
    assert counts.dtype == np.uint16
    np.testing.assert_allclose(counts * 0.01, KELVIN, rtol=0, atol=0.0051)
    assert texts["unit"] == "0.01 K" and texts["time_s"] == "90"
    assert texts["quantity"] == "apparent temperature"


def test_what_16_bits_cannot_hold_is_refused_or_counted(tmp_path):
    path = tmp_path / "frame.png"
    hot = frame([[300.0, 655.35], [655.36, 5800.0]])
    with pytest.raises(InputError, match="2 of 4 pixels .* 655.35 K, up to 5800"):
        write_centikelvin(path, hot)
    assert not path.exists()
    assert write_centikelvin(path, hot, saturate=True) == 2
    assert np.asarray(Pictures.open(path)).tolist() == [[30000, 65535], [65535, 65535]]


def test_a_tiff_has_kelvin_and_the_display_range_of_imagej(tmp_path):
    path = tmp_path / "frame.tiff"
    write_tiff(path, frame(KELVIN), low=290.0, high=320.0)
    with tifffile.TiffFile(path) as file:
        notes = file.imagej_metadata
        values = file.asarray()
    assert values.dtype == np.float32 and notes is not None
    np.testing.assert_array_equal(values, KELVIN.astype(np.float32))
    assert (notes["min"], notes["max"], notes["vunit"]) == (290.0, 320.0, "K")
    assert notes["time_s"] == 90 and notes["quantity"] == "apparent temperature"


def test_a_table_loads_without_options(tmp_path):
    path = tmp_path / "frame.csv"
    write_csv(path, frame(KELVIN, KELVIN + 9.0), "surface", title="a\nblock, hot")
    np.testing.assert_allclose(np.loadtxt(path, delimiter=","), KELVIN + 9, atol=5.1e-4)
    head = [line for line in path.read_text().splitlines() if line[0] == "#"]
    assert head == [
        '# title,"a block, hot"',
        "# time_s,90",
        "# quantity,surface temperature",
        "# band,all wavelengths",
        "# unit,K",
        "# columns,7",
        "# rows,5",
    ]


@pytest.mark.parametrize("write", [*WRITERS, write_exr])
def test_temperatures_that_are_not_finite_are_refused(tmp_path, write):
    wrong = KELVIN.copy()
    wrong[1, 2:4] = np.nan, np.inf
    with pytest.raises(InputError, match="90 s: .* of 2 of 35 pixels is not finite"):
        write(tmp_path / "frame", frame(wrong))
    assert not list(tmp_path.iterdir())


def test_a_picture_of_nan_is_refused():
    with pytest.raises(InputError, match="of 1 of 2 pixels is not finite"):
        picture(frame([[np.nan, 300.0]]), 280.0, 320.0)


@pytest.mark.parametrize("write", WRITERS)
def test_an_unknown_quantity_is_refused(tmp_path, write):
    with pytest.raises(InputError, match="'true': choose 'apparent' or 'surface'"):
        write(tmp_path / "frame", frame(KELVIN), "true")


@pytest.mark.parametrize("write", WRITERS)
def test_a_folder_that_is_not_there(tmp_path, write):
    with pytest.raises(InputError, match="cannot write"):
        write(tmp_path / "nowhere" / "frame", frame(KELVIN))


def test_the_mask_is_the_fraction_that_bodies_cover(tmp_path):
    body = np.array([[0, 0, -1, -1], [1, -1, -1, -1]])
    fine = frame(np.full((2, 4), 300.0), body=body)
    mask = covered_fraction(coarsen(fine, 2))
    assert mask.tolist() == [[0.75, 0.0]]
    assert covered_fraction(fine).tolist() == (body >= 0).tolist()
    coarse = frame([[300.0, 300.0]], body=[[0, -1]])
    path = tmp_path / "frame.exr"
    write_exr(path, coarse, mask=mask)
    channels, header = read_exr(path)
    assert channels["mask"].tolist() == [[0.75, 0.0]]
    assert all(f"{name}:" in header["units"].replace(",", ":") for name in channels)
    # The background is as the camera sees it, and finite but for its depth.
    assert channels["apparent_temperature_K"][0, 1] == pytest.approx(300.0)
    write_exr(path, coarse)
    assert read_exr(path)[0]["mask"].tolist() == [[1.0, 0.0]]
    with pytest.raises(InputError, match="one shape"):
        write_exr(path, coarse, mask=np.zeros((3, 3)))


def test_shown_temperatures_are_of_the_quantity():
    image = frame(KELVIN, KELVIN - 5.0)
    np.testing.assert_allclose(shown_temperature(image, "apparent"), KELVIN)
    np.testing.assert_array_equal(shown_temperature(image, "surface"), KELVIN - 5.0)
