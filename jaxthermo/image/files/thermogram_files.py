"""Frames of real cameras: temperatures from EXR, TIFF, PNG, CSV, NPY and FLIR's counts.

Numbers in files are kelvin, hundredths of kelvin, degrees Celsius or raw counts: what
they are has to be said, since a file of whole numbers may be any of them. The JPEG of a
FLIR camera says it itself.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image as Pictures, UnidentifiedImageError

from ...constants import ZERO_CELSIUS
from ...errors import InputError, located
from ..radiance.thermography import FlirCalibration
from .exr import read_channel
from .flir_file import read_flir
from .raster_files import CENTIKELVIN


_UNITS = ("kelvin", "centikelvin", "celsius", "counts")
"""Units that the numbers of a file may have."""
# Channel of the EXR files of this package.
_CHANNEL = "apparent_temperature_K"
_RADIOMETRIC = (".jpg", ".jpeg")


def read_thermogram(
    path: str | Path,
    unit: str = "kelvin",
    calibration: FlirCalibration | None = None,
    channel: str = _CHANNEL,
) -> Float[np.ndarray, "h w"]:
    """Read the temperatures that a camera shows for emissivity 1 [K].

    Args:
        path: EXR, TIFF, PNG of one channel, CSV (comma, semicolon or tab; lines with #
            are left out) or NPY file, or the JPEG of a FLIR camera with its counts.
        unit: of its numbers: "kelvin", "centikelvin", "celsius" or "counts"; not used
            for a JPEG, which has counts and their calibration.
        calibration: of raw counts; of a JPEG in place of its own.
        channel: of an EXR file.

    Raises:
        InputError: for a file that is missing, of another kind or of no temperatures,
            an unknown unit, or counts without a calibration.

    Example:
        >>> import jaxthermo as jt
        >>> import numpy as np
        >>> np.save("frame.npy", np.full((4, 6), 18109))
        >>> flir = jt.FlirCalibration()
        >>> float(jt.read_thermogram("frame.npy", "counts", flir)[0, 0].round(2))
        296.77
    """
    if unit not in _UNITS:
        units = ", ".join(_UNITS)
        raise InputError(f"read_thermogram(unit={unit!r}): use one of {units}")
    if Path(path).suffix.lower() in _RADIOMETRIC:
        seen = read_flir(path)
        return _from_counts(path, calibration or seen.calibration, seen.counts)
    if (unit == "counts") != (calibration is not None):
        raise InputError(
            "read_thermogram: counts and a calibration go together: give "
            "unit='counts' and calibration=FlirCalibration(...), or neither"
        )
    numbers = _numbers(Path(path), channel)
    if calibration is not None:
        return _from_counts(path, calibration, numbers)
    scale, zero = {
        "kelvin": (1.0, 0.0),
        "centikelvin": (CENTIKELVIN, 0.0),
        "celsius": (1.0, ZERO_CELSIUS),
    }[unit]
    kelvin = numbers * scale + zero
    if (kelvin[np.isfinite(kelvin)] < 0).any() or not np.isfinite(kelvin).any():
        raise InputError(
            f"{path}: {np.nanmin(numbers):g} to {np.nanmax(numbers):g} are no "
            f"temperatures in {unit}: give the unit of the file"
        )
    return kelvin


def _from_counts(
    path: str | Path, calibration: FlirCalibration, counts: np.ndarray
) -> Float[np.ndarray, "h w"]:
    with located(str(path)):
        return np.asarray(calibration.temperature(counts))


def _numbers(path: Path, channel: str) -> Float[np.ndarray, "h w"]:
    if not path.is_file():
        raise InputError(f"{path} is not a file: give the path of a frame")
    ending = path.suffix.lower()
    try:
        values = _READERS[ending](path, channel)
    except KeyError:
        endings = ", ".join(sorted((*_READERS, *_RADIOMETRIC)))
        raise InputError(f"{path}: frames may be {endings} files") from None
    except (ValueError, OSError, UnidentifiedImageError) as error:
        raise InputError(f"{path} is damaged or no {ending} file: {error}") from error
    numbers = np.asarray(values)
    if numbers.ndim != 2 or not numbers.size or numbers.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: has numbers of the shape {numbers.shape}, of the type "
            f"{numbers.dtype}: a frame has one number for each row and column"
        )
    return numbers.astype(float)


def _read_picture(path: Path, channel: str) -> Any:
    with warnings.catch_warnings():
        # What is wrong with a file is said by the error that follows.
        warnings.simplefilter("ignore")
        with Pictures.open(path) as picture:
            pixels = np.asarray(picture)
    if pixels.dtype == np.uint8:
        raise InputError(
            f"{path}: is a picture of 8 bits, whose colours are no temperatures: give "
            "one of 16 bits or of float32"
        )
    return pixels


def _read_csv(path: Path, channel: str) -> Any:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    rows = [line for line in lines if line.strip() and not line.startswith("#")]
    if not rows:
        raise ValueError("it has no numbers")
    mark = next((separator for separator in ";\t" if separator in rows[0]), ",")
    if mark == ";":
        # With commas in numbers, as a program in German writes them.
        rows = [line.replace(",", ".") for line in rows]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return np.loadtxt(rows, delimiter=mark, ndmin=2)


_READERS = {
    ".exr": read_channel,
    ".tif": _read_picture,
    ".tiff": _read_picture,
    ".png": _read_picture,
    ".csv": _read_csv,
    ".npy": lambda path, channel: np.load(path, allow_pickle=False),
}
