"""Frames of a calibration on the pages of one TIFF file."""

import numpy as np
import tifffile

import jaxthermo as jt
from calibrate.config.schema import MeasuredFrames
from calibrate.problem.frame_files import read_measured
from calibrate.problem.frame_quantity import FrameQuantity


FLIR = {"r1": 15900.0, "b": 1415.0, "f": 1.0, "o": -4400.0, "r2": 0.0145}


def frames_of(*paths, **settings) -> np.ndarray:
    config = MeasuredFrames.model_validate(
        {"frames": [{"case": "one", "files": [*map(str, paths)]}], **settings}
    )
    (frames,) = read_measured("one", config, FrameQuantity("temperature")).frames
    return frames


def test_the_pages_of_a_file_are_the_saved_times(tmp_path):
    kelvin = np.linspace(290.0, 320.0, 24).reshape(2, 3, 4)
    tifffile.imwrite(tmp_path / "all.tiff", kelvin, photometric="minisblack")
    np.save(tmp_path / "last.npy", kelvin[0])
    frames = frames_of(tmp_path / "all.tiff", tmp_path / "last.npy")
    np.testing.assert_array_equal(frames, [*kelvin, kelvin[0]])


def test_pages_of_counts_are_frames(tmp_path):
    kelvin = np.linspace(290.0, 320.0, 24).reshape(2, 3, 4)
    counts = jt.FlirCalibration(**FLIR).counts(kelvin)
    tifffile.imwrite(tmp_path / "all.tiff", counts, photometric="minisblack")
    settings = {"window_transmissivity": 0.8, "window_temperature": 290.0}
    plain = frames_of(tmp_path / "all.tiff", unit="counts", flir=FLIR)
    np.testing.assert_allclose(plain, kelvin)
    behind = frames_of(
        tmp_path / "all.tiff", unit="counts", flir=FLIR, camera_settings=settings
    )
    assert (behind[:, 0, 0] >= kelvin[:, 0, 0] - 1e-9).all()
    assert (behind[1] > kelvin[1] + 1.0).all()


def test_a_file_of_many_pages_is_opened_once(tmp_path, monkeypatch):
    kelvin = np.linspace(290.0, 320.0, 480).reshape(40, 3, 4)
    path = tmp_path / "all.tiff"
    tifffile.imwrite(path, kelvin - 273.15, photometric="minisblack")
    opened = []

    open_file = tifffile.TiffFile

    def open_counted(path, **options):
        opened.append(path)
        return open_file(path, **options)

    monkeypatch.setattr(tifffile, "TiffFile", open_counted)
    np.testing.assert_allclose(frames_of(path, unit="celsius"), kelvin)
    assert len(opened) == 1
