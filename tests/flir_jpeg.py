"""Radiometric JPEG files as FLIR's cameras write them, by exiftool's description."""

import io
import struct
from typing import NamedTuple

import numpy as np
from PIL import Image


# Offsets in the record of the camera's settings, float32 but for O.
SETTINGS = {
    "emissivity": 0x20,
    "distance": 0x24,
    "reflected_temperature": 0x28,
    "air_temperature": 0x2C,
    "window_temperature": 0x30,
    "window_transmissivity": 0x34,
    "relative_humidity": 0x3C,
    "r1": 0x58,
    "b": 0x5C,
    "f": 0x60,
    "o": 0x308,
    "r2": 0x30C,
    "alpha1": 0x70,
    "alpha2": 0x74,
    "beta1": 0x78,
    "beta2": 0x7C,
    "x": 0x80,
}
_SEGMENT = 200
"""Bytes of data in one segment: several, as in real files."""


class FlirFormat(NamedTuple):
    """How a camera writes its file."""

    directory: str = ">"
    """Byte order of the directory of records, as in `struct`."""
    record: str = "<"
    """Byte order of the records."""
    entries: int = 14
    """Entries of the directory, most of them empty, as in real files."""
    png: str = ""
    """`swapped`, as most cameras write counts as PNG, or `native`; no PNG if empty."""


USUAL = FlirFormat()
"""The form of most files."""


def _raw_record(counts: np.ndarray, form: FlirFormat) -> bytes:
    height, width = counts.shape
    head = struct.pack(f"{form.record}HHH", 2, width, height).ljust(32, b"\0")
    if not form.png:
        return head + counts.astype(f"{form.record}u2").tobytes()
    pixels = counts.astype(np.uint16)
    stream = io.BytesIO()
    stored = pixels.byteswap() if form.png == "swapped" else pixels
    Image.fromarray(stored).save(stream, "PNG")
    return head + stream.getvalue()


def _camera_record(settings: dict[str, float], form: FlirFormat) -> bytes:
    record = bytearray(0x400)
    struct.pack_into(f"{form.record}H", record, 0, 2)
    for name, value in settings.items():
        number = int(value) if name == "o" else value
        real = "i" if name == "o" else "f"
        struct.pack_into(f"{form.record}{real}", record, SETTINGS[name], number)
    return bytes(record)


def flir_jpeg(
    counts: np.ndarray, settings: dict[str, float], form: FlirFormat = USUAL
) -> bytes:
    """A JPEG with counts, and the settings and constants of a camera in kelvin."""
    records = {0x20: _camera_record(settings, form), 0x01: _raw_record(counts, form)}
    start = 64 + 32 * form.entries
    table = b""
    body = b""
    for record_type, data in records.items():
        subtype = 3 if form.png and record_type == 0x01 else 1
        table += struct.pack(f"{form.directory}HHII", record_type, subtype, 100, 1)
        offset = start + len(body)
        table += struct.pack(f"{form.directory}IIIII", offset, len(data), 0, 0, 0)
        body += data
    head = b"FFF\0" + b"MTX IR".ljust(16, b"\0")
    head += struct.pack(f"{form.directory}III", 100, 64, form.entries)
    data = head.ljust(64, b"\0") + table.ljust(32 * form.entries, b"\0") + body
    pieces = [data[at : at + _SEGMENT] for at in range(0, len(data), _SEGMENT)]
    segments = b"".join(
        b"\xff\xe1"
        + struct.pack(">H", len(piece) + 10)
        + b"FLIR\0\x01"
        + bytes([number, len(pieces) - 1])
        + piece
        for number, piece in enumerate(pieces)
    )
    stream = io.BytesIO()
    Image.new("RGB", (8, 6), (90, 40, 10)).save(stream, "JPEG")
    picture = stream.getvalue()
    return picture[:2] + segments + picture[2:]
