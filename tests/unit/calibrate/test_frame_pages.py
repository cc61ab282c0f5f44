"""Frames of a calibration on the pages of one TIFF file."""

import numpy as np
import tifffile

from calibrate.config.schema import MeasuredFrames
from calibrate.problem.frame_files import read_measured
from calibrate.problem.frame_quantity import FrameQuantity


def test_the_pages_of_a_file_are_the_saved_times(tmp_path):
    kelvin = np.linspace(290.0, 320.0, 24).reshape(2, 3, 4)
    tifffile.imwrite(tmp_path / "all.tiff", kelvin, photometric="minisblack")
    np.save(tmp_path / "last.npy", kelvin[0])
    files = [str(tmp_path / name) for name in ("all.tiff", "last.npy")]
    settings = MeasuredFrames.model_validate(
        {"frames": [{"case": "one", "files": files}]}
    )
    (frames,) = read_measured("one", settings, FrameQuantity("temperature")).frames
    np.testing.assert_array_equal(frames, [*kelvin, kelvin[0]])
