"""Radiometric frames: named float32 channels and text in an OpenEXR file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Array, Float

from ..atomic import replacing
from ..errors import InputError


_Image = Float[np.ndarray, "h w"] | Float[Array, "h w"]

# Names that the format gives a meaning and a type of its own.
_RESERVED = frozenset(
    {
        "channels",
        "chunkCount",
        "compression",
        "dataWindow",
        "displayWindow",
        "lineOrder",
        "name",
        "pixelAspectRatio",
        "screenWindowCenter",
        "screenWindowWidth",
        "tiles",
        "type",
        "version",
        "view",
    }
)
_LONGEST_NAME = 255


def _check(channels: Mapping[str, _Image], header: Mapping[str, str]) -> None:
    if not channels:
        raise InputError("an EXR file needs a channel: channels={} is empty")
    shapes = {name: np.shape(pixels) for name, pixels in channels.items()}
    if len(set(shapes.values())) > 1 or any(len(s) != 2 for s in shapes.values()):
        raise InputError(f"EXR channels need one shape [h, w], not {shapes}")
    if 0 in next(iter(shapes.values())):
        raise InputError(f"EXR channels need at least one pixel, not {shapes}")
    for name in (*channels, *header):
        if not 0 < len(name.encode()) <= _LONGEST_NAME:
            raise InputError(f"EXR name {name!r}: use 1 to {_LONGEST_NAME} bytes")
    for name in _RESERVED & set(header):
        raise InputError(f"EXR header {name!r} is reserved: choose another name")


def write_exr_channels(
    path: str | Path,
    channels: Mapping[str, _Image],
    header: Mapping[str, str] | None = None,
) -> None:
    """Writes images as float32 channels, lossless, replacing `path` in one step.

    Args:
        path: of the file; its folder must exist.
        channels: name to pixels, all of one shape; any unit, inf and NaN are kept.
        header: name to text, as the resolved config.

    Raises:
        InputError: for channels or names the format cannot hold, or an unwritable path.
    """
    texts = dict(header or {})
    _check(channels, texts)
    # OpenEXR silently scrambles arrays in Fortran order and refuses other types.
    pixels = {
        name: np.ascontiguousarray(np.asarray(image), np.float32)
        for name, image in channels.items()
    }
    fields = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **texts,
    }
    with replacing(path) as temporary, OpenEXR.File(fields, pixels) as file:
        file.write(str(temporary))


def read_exr(
    path: str | Path,
) -> tuple[dict[str, Float[np.ndarray, "h w"]], dict[str, str]]:
    """Reads the channels, as float32, and the texts of the header.

    Raises:
        InputError: when the file is missing, no EXR or damaged.
    """
    if not Path(path).is_file():
        raise InputError(f"{path} is not a file: give the path of an EXR file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            # A damaged file shows only here, as a file without parts.
            channels = {
                name: np.array(channel.pixels, np.float32)
                for name, channel in file.channels().items()
            }
            # Closing the file empties its own dictionary.
            fields = dict(file.header())
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(
            f"{path} is not an EXR file or is damaged: write it again"
        ) from error
    texts = {k: v for k, v in fields.items() if isinstance(v, str)}
    return channels, {k: v for k, v in texts.items() if k not in _RESERVED}
