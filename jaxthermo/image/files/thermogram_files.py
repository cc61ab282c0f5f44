"""Frames of real cameras: temperatures from EXR, TIFF, PNG, CSV, NPY and FLIR's counts.

Numbers in files are kelvin, degrees Celsius, parts of a kelvin or raw counts: what they
are has to be said, since a file of whole numbers may be any of them. The JPEG of a FLIR
camera says it itself.
"""

import contextlib
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Shaped
from PIL import Image as Pictures

from ...errors import InputError, located
from ...temperatures import (
    ALLOW_EXTREME,
    KELVIN,
    UNITS,
    CheckedValues,
    Limits,
    LinearUnit,
    pixel_mistake,
    temperature_limits,
)
from ..radiance.thermography import FlirCalibration
from .csv_file import read_csv_numbers
from .exr import read_channel, read_exr
from .flir_file import FlirThermogram, read_flir
from .tiff_file import read_tiff_pages


COUNTS = "counts"
"""Unit of raw counts, whose temperatures follow from the constants of a camera."""
Unit = str | Mapping[str, float | int] | LinearUnit
"""Unit of the numbers in a file: a name, or `scale` and `offset` [K]."""
_COUNTS_AND_CALIBRATION = (
    "read_thermogram: counts and a calibration go together: give unit='counts' and "
    "calibration=FlirCalibration(...), or neither"
)
# Channel of the EXR files of this package.
_CHANNEL = "apparent_temperature_K"
_RADIOMETRIC = (".jpg", ".jpeg")
_TIFF = (".tif", ".tiff")
_Frame = TypeVar("_Frame")
_STATEMENTS = {
    ".csv": b"# unit,K\n",
    **dict.fromkeys(_TIFF, b"unit_of_values=K\n"),
}
"""Texts by which the files of this package state kelvin."""


def read_thermogram(
    path: str | Path,
    unit: Unit = "kelvin",
    calibration: FlirCalibration | None = None,
    channel: str = _CHANNEL,
    page: int | None = None,
    *,
    allow_extreme_temperatures: bool = False,
) -> Float[np.ndarray, "h w"]:
    """Read the temperatures that a camera shows for emissivity 1 [K].

    Air and window that the JPEG of a FLIR camera states are taken out. Pixels with
    counts of no temperature, such as dead ones, or of an extremely low one, are not a
    number.

    Args:
        path: EXR, TIFF, PNG of one channel, CSV or NPY file, or the JPEG of a FLIR
            camera with its counts. The rows of a CSV file are separated by semicolons,
            tabs, commas or spaces, with points or commas before decimals; lines of text
            above them are left out.
        unit: of its numbers: "kelvin" or "K", "celsius" or "degC", "centikelvin",
            {"scale": 0.04, "offset": 0.0} for T = scale N + offset [K], or "counts";
            not used for a JPEG, which has counts and their calibration.
        calibration: of raw counts; of a JPEG in place of its own.
        channel: of an EXR file.
        page: of a TIFF file of several, counted from 0.
        allow_extreme_temperatures: accept pixels below 150 K and above 6000 K.

    Raises:
        InputError: for a file that is missing, of another kind or of no temperatures,
            an unknown unit or one that contradicts the file, counts without a
            calibration, or pixels of extreme temperatures but for cold ones of counts.

    Example:
        >>> import jaxthermo as jt
        >>> import numpy as np
        >>> np.save("frame.npy", np.full((4, 6), 18109))
        >>> flir = jt.FlirCalibration()
        >>> float(jt.read_thermogram("frame.npy", "counts", flir)[0, 0].round(2))
        296.77
    """
    linear_unit = None
    limits = temperature_limits(allow_extreme_temperatures)
    if has_counts(path, unit):
        thermogram = _only_frame(path, read_counts(path, calibration, page))
        with located(str(path)):
            kelvin = thermogram.object_temperature(
                emissivity=1.0, allow_extreme_temperatures=allow_extreme_temperatures
            )
        # Counts just above those of no temperature are of dead pixels, too.
        kelvin = np.where(kelvin < limits.low, np.nan, kelvin)
    elif calibration is not None:
        raise InputError(_COUNTS_AND_CALIBRATION)
    else:
        linear_unit = _unit_of(unit)
        frames = read_temperatures(path, linear_unit, (channel,), page)
        kelvin = _only_frame(path, frames)
    if not np.isfinite(kelvin).any():
        raise InputError(
            f"{path}: no pixel has a temperature of {limits.low:g} K or more: give "
            "another file"
        )
    mistake = pixel_mistake(
        CheckedValues(kelvin), limits, linear_unit, option=f"{ALLOW_EXTREME}=True"
    )
    if mistake:
        raise InputError(f"{path}: {mistake}")
    return kelvin


def _unit_of(unit: Unit) -> LinearUnit:
    """Scale and offset of a unit.

    Raises:
        InputError: for an unknown one.
    """
    try:
        if isinstance(unit, str):
            return UNITS[unit]
        if isinstance(unit, LinearUnit):
            return unit
        numbers = {name: float(number) for name, number in unit.items()}
        linear_unit = LinearUnit(**numbers)
        if not (linear_unit.scale > 0 and np.isfinite(linear_unit).all()):
            raise ValueError
        return linear_unit
    except (KeyError, TypeError, ValueError, AttributeError):
        names = ", ".join((*UNITS, COUNTS))
        raise InputError(
            f"read_thermogram(unit={unit!r}): use one of {names}, or a scale and an "
            "offset in kelvin, {'scale': 0.04, 'offset': 0.0}"
        ) from None


def has_counts(path: str | Path, unit: Unit) -> bool:
    """True for a file of raw counts: the JPEG of a camera, or numbers in counts."""
    return unit == COUNTS or Path(path).suffix.lower() in _RADIOMETRIC


def read_counts(
    path: str | Path,
    calibration: FlirCalibration | None = None,
    page: int | None = None,
) -> list[FlirThermogram]:
    """Read the raw counts of all frames, with what their file states of the camera.

    Args:
        path: JPEG of a FLIR camera, or a file of counts.
        calibration: of the counts; of a JPEG in place of its own.
        page: the only one to read of a TIFF file.

    Raises:
        InputError: as `read_thermogram`.
    """
    if Path(path).suffix.lower() in _RADIOMETRIC:
        thermogram = read_flir(path)
        if calibration is None:
            return [thermogram]
        return [thermogram._replace(calibration=calibration)]
    if calibration is None:
        raise InputError(_COUNTS_AND_CALIBRATION)
    frames = _frames_of_numbers(Path(path), (_CHANNEL,), page)
    return [FlirThermogram(counts, calibration) for counts in frames]


def read_temperatures(
    path: str | Path,
    unit: LinearUnit,
    channels: tuple[str, ...] = (_CHANNEL,),
    page: int | None = None,
) -> list[Float[np.ndarray, "_ _"]]:
    """Read all frames of temperatures [K], whose pixels are not checked.

    Args:
        path: as of `read_thermogram`.
        unit: of the numbers.
        channels: of an EXR file, of which the first that is there counts.
        page: the only one to read of a TIFF file.

    Raises:
        InputError: for a file that cannot be read, or states another unit.
    """
    path = Path(path)
    frames = _frames_of_numbers(path, channels, page)
    if unit != KELVIN and _is_in_kelvin(path, frames, channels):
        raise InputError(
            f"{path}: says that its numbers are in kelvin, and the unit is another "
            "one: give kelvin"
        )
    return [unit.kelvin(numbers) for numbers in frames]


def _only_frame(path: str | Path, frames: list[_Frame]) -> _Frame:
    if len(frames) > 1:
        raise InputError(
            f"{path} has {len(frames)} pages, and a frame is one of them: give its "
            f"number, page=0 to page={len(frames) - 1}"
        )
    return frames[0]


def _is_in_kelvin(
    path: Path, frames: list[Float[np.ndarray, "_ _"]], channels: tuple[str, ...]
) -> bool:
    """True for a file that states kelvin, with numbers that may be."""
    numbers = np.concatenate([frame[np.isfinite(frame)] for frame in frames])
    # Programs may write degrees Celsius under the names of this package.
    if not numbers.size or Limits().exceeded(np.median(numbers, keepdims=True)).any():
        return False
    ending = path.suffix.lower()
    if ending == ".exr":
        stored, _ = read_exr(path)
        return next(name for name in channels if name in stored).endswith("_K")
    statement = _STATEMENTS.get(ending)
    return statement is not None and statement in path.read_bytes()


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


def _frames_of_numbers(
    path: Path, channels: tuple[str, ...], page: int | None
) -> list[Float[np.ndarray, "_ _"]]:
    if not path.is_file():
        raise InputError(f"{path} is not a file: give the path of a frame")
    ending = path.suffix.lower()
    if ending not in (*_READERS, *_TIFF):
        endings = ", ".join(sorted((*_READERS, *_TIFF, *_RADIOMETRIC)))
        raise InputError(f"{path}: frames may be {endings} files")
    if page and ending not in _TIFF:
        raise InputError(f"{path}: page {page} is one of a TIFF file: leave it out")
    with _reading(path):
        if ending in _TIFF:
            frames = read_tiff_pages(path, page)
        else:
            frames = [np.asarray(_READERS[ending](path, channels))]
    return [_checked_numbers(path, numbers) for numbers in frames]


def _checked_numbers(
    path: Path, numbers: Shaped[np.ndarray, "..."]
) -> Float[np.ndarray, "_ _"]:
    """Numbers of a frame, if they are."""
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


def _read_exr(path: Path, channels: tuple[str, ...]) -> Any:
    return read_channel(path, *channels)


def _read_picture(path: Path, channels: tuple[str, ...]) -> Any:
    with warnings.catch_warnings():
        # What is wrong with a file is said by the error that follows.
        warnings.simplefilter("ignore")
        with Pictures.open(path) as picture:
            return np.asarray(picture)


def _read_csv(path: Path, channels: tuple[str, ...]) -> Any:
    return read_csv_numbers(path)


def _read_array(path: Path, channels: tuple[str, ...]) -> Any:
    return np.load(path, allow_pickle=False)


_READERS = {
    ".exr": _read_exr,
    ".png": _read_picture,
    ".csv": _read_csv,
    ".npy": _read_array,
}
