"""Frames of real cameras: temperatures from EXR, TIFF, PNG, CSV, NPY and FLIR's counts.

Numbers in files are kelvin, hundredths of kelvin, degrees Celsius or raw counts: what
they are has to be said, since a file of whole numbers may be any of them. The JPEG of a
FLIR camera says it itself.
"""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image as Pictures

from ...constants import ZERO_CELSIUS
from ...errors import InputError, located
from ..radiance.thermography import FlirCalibration
from .csv_file import read_csv_numbers
from .exr import read_channel
from .flir_file import read_flir
from .raster_files import CENTIKELVIN
from .tiff_file import read_tiff_numbers, tiff_page_count


_UNITS = ("kelvin", "centikelvin", "celsius", "counts")
"""Units that the numbers of a file may have."""
# Channel of the EXR files of this package.
_CHANNEL = "apparent_temperature_K"
_RADIOMETRIC = (".jpg", ".jpeg")
_TIFF = (".tif", ".tiff")


def read_thermogram(
    path: str | Path,
    unit: str = "kelvin",
    calibration: FlirCalibration | None = None,
    channel: str = _CHANNEL,
    page: int | None = None,
) -> Float[np.ndarray, "h w"]:
    """Read the temperatures that a camera shows for emissivity 1 [K].

    Pixels with counts of no temperature, such as dead ones, are not a number.

    Args:
        path: EXR, TIFF, PNG of one channel, CSV or NPY file, or the JPEG of a FLIR
            camera with its counts. The rows of a CSV file are separated by semicolons,
            tabs, commas or spaces, with points or commas before decimals; lines of text
            above them are left out.
        unit: of its numbers: "kelvin", "centikelvin", "celsius" or "counts"; not used
            for a JPEG, which has counts and their calibration.
        calibration: of raw counts; of a JPEG in place of its own.
        channel: of an EXR file.
        page: of a TIFF file of several, counted from 0.

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
    numbers = _numbers(Path(path), channel, page)
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


def frame_count(path: str | Path) -> int:
    """Number of frames in a file: pages of a TIFF file, 1 in any other.

    Raises:
        InputError: for a TIFF file that is missing or damaged.
    """
    path = Path(path)
    if path.suffix.lower() not in _TIFF:
        return 1
    _check_is_file(path)
    with _reading(path):
        return tiff_page_count(path)


def _check_is_file(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path} is not a file: give the path of a frame")


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Name the file in errors of its reader; those of an `InputError` stay."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # damaged bytes make readers raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path} is damaged or no {path.suffix.lower()} file: {reason}"
        ) from error


def _numbers(path: Path, channel: str, page: int | None) -> Float[np.ndarray, "h w"]:
    _check_is_file(path)
    ending = path.suffix.lower()
    if ending not in _READERS:
        endings = ", ".join(sorted((*_READERS, *_RADIOMETRIC)))
        raise InputError(f"{path}: frames may be {endings} files")
    if page and ending not in _TIFF:
        raise InputError(f"{path}: page {page} is one of a TIFF file: leave it out")
    with _reading(path):
        numbers = np.asarray(_READERS[ending](path, channel, page))
    if numbers.ndim != 2 or not numbers.size or numbers.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: has numbers of the shape {numbers.shape}, of the type "
            f"{numbers.dtype}: a frame has one number for each row and column"
        )
    if numbers.dtype == np.uint8:
        raise InputError(
            f"{path}: is a picture of 8 bits, whose colours are no temperatures: give "
            "one of 16 bits or of float32"
        )
    return numbers.astype(float)


def _read_exr(path: Path, channel: str, page: int | None) -> Any:
    return read_channel(path, channel)


def _read_tiff(path: Path, channel: str, page: int | None) -> Any:
    return read_tiff_numbers(path, page)


def _read_picture(path: Path, channel: str, page: int | None) -> Any:
    with warnings.catch_warnings():
        # What is wrong with a file is said by the error that follows.
        warnings.simplefilter("ignore")
        with Pictures.open(path) as picture:
            return np.asarray(picture)


def _read_csv(path: Path, channel: str, page: int | None) -> Any:
    return read_csv_numbers(path)


def _read_array(path: Path, channel: str, page: int | None) -> Any:
    return np.load(path, allow_pickle=False)


_READERS = {
    ".exr": _read_exr,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".png": _read_picture,
    ".csv": _read_csv,
    ".npy": _read_array,
}
