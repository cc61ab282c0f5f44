"""Radiometric JPEG files of FLIR cameras: raw counts and what they mean.

Such a file is a picture to look at with the counts of the detector, the constants of
the camera and the settings of its user inside: pieces of one file of records in the
JPEG's segments. The directory of records and the records have byte orders of their own.

Source: P. Harvey, exiftool.org/TagNames/FLIR.html, for types and offsets of records.
"""

import io
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt16
from PIL import Image as Pictures

from ...errors import InputError, located
from ..radiance.atmosphere import LONG_WAVE_AIR, AirConstants
from ..radiance.thermography import FlirCalibration


# Types of records.
_RAW_DATA = 0x01
_CAMERA_INFO = 0x20

_SIGNATURE = b"FLIR\0"
_PNG = b"\x89PNG"
_ENTRY_SIZE = 32
_RAW_HEADER_SIZE = 32

_ByteOrder = str
"""`<` for the least significant byte first, or `>`, as in `struct`."""

# Offsets of float32 in the record of the camera.
_SETTINGS = {
    "emissivity": 32,
    "distance": 36,
    "reflected_temperature": 40,
    "air_temperature": 44,
    "window_temperature": 48,
    "window_transmissivity": 52,
    "relative_humidity": 60,
}
_PLANCK = {"r1": 88, "b": 92, "f": 96, "r2": 780}
_AIR = {"alpha1": 112, "alpha2": 116, "beta1": 120, "beta2": 124, "x": 128}
# An int32, unlike the others.
_PLANCK_O = 776


class FlirThermogram(NamedTuple):
    """Counts of a FLIR camera with its constants, and the settings of its user.

    Example:
        >>> import jaxthermo as jt
        >>> import numpy as np
        >>> seen = jt.FlirThermogram(
        ...     np.full((2, 2), 18109), jt.FlirCalibration(), emissivity=0.95
        ... )
        >>> float(seen.object_temperature()[0, 0].round(2))
        296.95
    """

    counts: Int[np.ndarray, "h w"]
    """Raw counts S of the detector."""
    calibration: FlirCalibration
    """Constants of this camera."""
    emissivity: float = 1.0
    """Emissivity of the object [-], as set at the camera, like all that follows."""
    reflected_temperature: float = 293.15
    """Temperature of what the object reflects [K]."""
    distance: float = 0.0
    """Distance of the object [m]."""
    air_temperature: float = 293.15
    """Temperature of the air between [K]."""
    relative_humidity: float = 0.5
    """Humidity of this air, 0 to 1."""
    window_transmissivity: float = 1.0
    """Transmissivity of a window in front of the camera [-]."""
    window_temperature: float = 293.15
    """Temperature of the window [K]."""
    air_constants: AirConstants = LONG_WAVE_AIR
    """Constants of this camera's formula for the transmissivity of air."""

    def apparent_temperature(self) -> Float[np.ndarray, "h w"]:
        """Temperature of a black surface right before the camera [K].

        Pixels with counts of no temperature are not a number.
        """
        return np.asarray(self.calibration.temperature(self.counts))

    def object_temperature(
        self, *, allow_extreme_temperatures: bool = False, **settings: Any
    ) -> Float[np.ndarray, "h w"]:
        """Temperature of the object [K], with the camera's settings or others.

        Pixels with counts of no temperature are not a number.

        Raises:
            InputError: as `FlirCalibration.object_temperature`, and for settings of
                other names.
        """
        stored_settings = {name: getattr(self, name) for name in self._fields[2:]}
        for name in settings.keys() - stored_settings.keys():
            raise InputError(
                f"FlirThermogram.object_temperature({name}=...): settings are "
                f"{', '.join(stored_settings)}"
            )
        kelvin = self.calibration.object_temperature(
            self.counts,
            **stored_settings | settings,
            allow_extreme_temperatures=allow_extreme_temperatures,
        )
        return np.asarray(kelvin)


def read_flir(path: str | Path) -> FlirThermogram:
    """Read a radiometric JPEG of a FLIR camera.

    Raises:
        InputError: for a file that is missing, damaged or a mere picture.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} is not a file: give the path of a frame")
    try:
        records = _records(_embedded_file(path.read_bytes()))
        camera = _CameraRecord(_record(records, _CAMERA_INFO, "of the camera"))
        counts = _counts(_record(records, _RAW_DATA, "of the counts"))
        constants = {name: camera.real(at) for name, at in _PLANCK.items()}
        settings = {name: camera.real(at) for name, at in _SETTINGS.items()}
        air_numbers = {name: camera.real(at) for name, at in _AIR.items()}
        offset = camera.integer(_PLANCK_O)
    except Exception as error:  # damaged bytes may lead anywhere
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path}: no counts of a FLIR camera in it ({reason}): give the file that "
            "the camera wrote, not a picture exported from it"
        ) from error
    with located(str(path)):
        calibration = FlirCalibration(**constants, o=offset)
    # Some cameras write per cent.
    if settings["relative_humidity"] > 1:
        settings["relative_humidity"] /= 100
    # Old cameras leave these constants out.
    air = AirConstants(**air_numbers) if any(air_numbers.values()) else LONG_WAVE_AIR
    return FlirThermogram(
        counts=counts,
        calibration=calibration,
        **settings,
        air_constants=replace(air, b=calibration.b),
    )


def _embedded_file(jpeg: bytes) -> bytes:
    """The file of records in the segments of a JPEG, whose pieces are numbered."""
    if not jpeg.startswith(b"\xff\xd8"):
        raise ValueError("it is no JPEG file")
    pieces: dict[int, bytes] = {}
    count = 0
    position = 2
    # The picture itself begins with the marker DA.
    while jpeg[position : position + 1] == b"\xff" and jpeg[position + 1] != 0xDA:
        (size,) = struct.unpack_from(">H", jpeg, position + 2)
        segment = jpeg[position + 4 : position + 2 + size]
        if jpeg[position + 1] == 0xE1 and segment.startswith(_SIGNATURE):
            number, last = segment[6:8]
            pieces[number] = segment[8:]
            count = last + 1
        position += 2 + size
    if not count:
        raise ValueError("it has no records of a camera")
    for number in range(count):
        if number not in pieces:
            raise ValueError(f"piece {number + 1} of {count} is missing")
    return b"".join(pieces[number] for number in range(count))


def _records(data: bytes) -> dict[int, bytes]:
    """Bytes of the first record of each type."""
    order = _directory_order(data)
    start, count = struct.unpack_from(f"{order}II", data, 24)
    records: dict[int, bytes] = {}
    for entry in range(start, start + _ENTRY_SIZE * count, _ENTRY_SIZE):
        entry_head = struct.unpack_from(f"{order}HHIIII", data, entry)
        record_type, _, _, _, offset, size = entry_head
        content = data[offset : offset + size]
        if record_type and len(content) < size:
            raise ValueError("it ends within a record")
        if record_type:
            records.setdefault(record_type, content)
    return records


def _directory_order(data: bytes) -> _ByteOrder:
    # The version of the format is 100 and a little more.
    for order in "><":
        (version,) = struct.unpack_from(f"{order}I", data, 20)
        if 100 <= version < 200:
            return order
    raise ValueError("its directory of records is of an unknown version")


def _record(records: dict[int, bytes], record_type: int, words: str) -> bytes:
    if record_type not in records:
        raise ValueError(f"it has no record {words}")
    return records[record_type]


def _record_order(record: bytes) -> _ByteOrder:
    # A record begins with a small number.
    (first,) = struct.unpack_from("<H", record)
    return "<" if first < 0x100 else ">"


class _CameraRecord:
    """The record of a camera's constants and settings."""

    def __init__(self, record: bytes):
        self._record = record
        self._order = _record_order(record)

    def real(self, offset: int) -> float:
        """A float32."""
        return float(struct.unpack_from(f"{self._order}f", self._record, offset)[0])

    def integer(self, offset: int) -> float:
        """An int32."""
        return float(struct.unpack_from(f"{self._order}i", self._record, offset)[0])


def _counts(record: bytes) -> Int[np.ndarray, "h w"]:
    order = _record_order(record)
    width, height = struct.unpack_from(f"{order}HH", record, 2)
    pixels = record[_RAW_HEADER_SIZE:]
    if pixels.startswith(_PNG):
        counts = _png_counts(pixels)
    else:
        counts = np.frombuffer(pixels, f"{order}u2", width * height)
        counts = counts.reshape(height, width)
    if counts.shape != (height, width):
        raise ValueError(
            f"its counts are {counts.shape[1]} x {counts.shape[0]} pixels and not "
            f"{width} x {height}"
        )
    return counts.astype(np.int64)


def _png_counts(png: bytes) -> UInt16[np.ndarray, "h w"]:
    """Counts of a PNG of 16 bits, whose two bytes most cameras write swapped."""
    with Pictures.open(io.BytesIO(png)) as picture:
        stored = np.asarray(picture).astype(np.uint16)
    swapped = stored.byteswap()
    # In the wrong order the fast low bytes count 256 times as much.
    return stored if _roughness(stored) < _roughness(swapped) else swapped


def _roughness(counts: UInt16[np.ndarray, "h w"]) -> float:
    return float(np.abs(np.diff(counts.ravel().astype(np.int64))).sum())
