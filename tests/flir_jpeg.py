"""Radiometric JPEG files as FLIR's cameras write them, by exiftool's description."""

import io
import struct

import numpy as np
from PIL import Image


# Offsets in the record of the camera's settings, little-endian float32 but for O.
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
}
_ENTRIES = 14
"""Entries of the directory, most of them empty, as in real files."""
_SEGMENT = 200
"""Bytes of data in one segment: several, as in real files."""


def _raw_record(counts: np.ndarray, as_png: bool) -> bytes:
    head = struct.pack("<HHH", 2, counts.shape[1], counts.shape[0]).ljust(32, b"\0")
    if not as_png:
        return head + counts.astype("<u2").tobytes()
    # Cameras write the two bytes of a number in the other order.
    swapped = counts.astype("<u2").byteswap()
    stream = io.BytesIO()
    Image.fromarray(swapped.astype(np.uint16)).save(stream, "PNG")
    return head + stream.getvalue()


def _camera_record(settings: dict[str, float]) -> bytes:
    record = bytearray(0x400)
    for name, value in settings.items():
        form, number = ("<i", int(value)) if name == "o" else ("<f", value)
        struct.pack_into(form, record, SETTINGS[name], number)
    return bytes(record)


def flir_jpeg(
    counts: np.ndarray, settings: dict[str, float], as_png: bool = False
) -> bytes:
    """A JPEG with counts, and the settings and constants of a camera in kelvin."""
    records = {0x01: _raw_record(counts, as_png), 0x20: _camera_record(settings)}
    start = 64 + 32 * _ENTRIES
    table = b""
    body = b""
    for record_type, data in records.items():
        subtype = 3 if as_png and record_type == 0x01 else 1
        table += struct.pack(">HHII", record_type, subtype, 100, 1)
        table += struct.pack(">IIIII", start + len(body), len(data), 0, 0, 0)
        body += data
    head = b"FFF\0" + b"MTX IR".ljust(16, b"\0")
    head += struct.pack(">III", 100, 64, _ENTRIES)
    data = head.ljust(64, b"\0") + table.ljust(32 * _ENTRIES, b"\0") + body
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
