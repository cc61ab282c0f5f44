"""Radiometric OpenEXR files of frames, and of any channels by name."""

import errno
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Array, Float

from ...atomic import replacing
from ...errors import InputError
from ..colour.frame_values import covered_fraction, shown_temperature
from ..radiance.image import Image


_Image = Float[np.ndarray, "h w"] | Float[Array, "h w"]

# Names for which the format prescribes a meaning and a type.
_RESERVED_NAMES = (
    "channels chunkCount compression dataWindow displayWindow lineOrder name tiles "
    "type pixelAspectRatio screenWindowCenter screenWindowWidth version view"
)
_RESERVED = frozenset(_RESERVED_NAMES.split())
# The format's limit for long names.
_MAX_NAME_BYTES = 255


def _check(channels: Mapping[str, _Image], header: Mapping[str, str]) -> None:
    if not channels:
        raise InputError("an EXR file needs a channel: channels={} is empty")
    shapes = {name: np.shape(pixels) for name, pixels in channels.items()}
    if len(set(shapes.values())) > 1 or any(len(s) != 2 for s in shapes.values()):
        raise InputError(f"EXR channels need one shape [h, w], not {shapes}")
    if 0 in next(iter(shapes.values())):
        raise InputError(f"EXR channels need at least one pixel, not {shapes}")
    for name in (*channels, *header):
        if not 0 < len(name.encode()) <= _MAX_NAME_BYTES:
            raise InputError(f"EXR name {name!r}: use 1 to {_MAX_NAME_BYTES} bytes")
    for name in _RESERVED & set(header):
        raise InputError(f"EXR header {name!r} is reserved: choose another name")


def write_channels(
    path: str | Path,
    channels: Mapping[str, _Image],
    header: Mapping[str, str] | None = None,
) -> None:
    """Write channels by name as an EXR file of lossless float32, with texts.

    Inf and NaN are preserved.

    Raises:
        InputError: for channels of several sizes, names that the format reserves, or if
            the file cannot be written.
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
    with replacing(path) as temporary:
        try:
            with OpenEXR.File(fields, pixels) as file:
                file.write(str(temporary))
            # OpenEXR ignores errors at the end of a file, on a full disk for one.
            read_exr(temporary)
        except (InputError, RuntimeError) as error:
            raise OSError(errno.EIO, "the file was not written whole") from error


def read_exr(
    path: str | Path,
) -> tuple[dict[str, Float[np.ndarray, "h w"]], dict[str, str]]:
    """Read the float32 channels and the texts of the header.

    Raises:
        InputError: when the file is missing, no EXR or damaged.
    """
    if not Path(path).is_file():
        raise InputError(f"{path} is not a file: give the path of an EXR file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            # A damaged file is detected only here, as a file without parts.
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


def read_channel(path: str | Path, *names: str) -> Float[np.ndarray, "h w"]:
    """Read the first channel of an EXR file that has one of the names.

    Raises:
        InputError: as `read_exr`, or if it has none of them.
    """
    channels, _ = read_exr(path)
    for name in names:
        if name in channels:
            return channels[name]
    listed = ", ".join(sorted(channels))
    raise InputError(f"{path}: has no channel {names[0]} (it has {listed})")


def _exr_channels(image: Image, mask: _Image | None = None) -> dict[str, np.ndarray]:
    normal = np.asarray(image.normal)
    channels = {
        "temperature_K": shown_temperature(image, "surface"),
        "apparent_temperature_K": shown_temperature(image, "apparent"),
        "radiance": image.radiance,
        "emissivity": image.emissivity,
        "depth_m": image.depth,
        # EXR has no signed integers, and the background is -1.
        "object_id": np.asarray(image.object_id, np.float32),
        "mask": covered_fraction(image) if mask is None else mask,
    }
    if image.part_id is not None:
        channels["part_id"] = np.asarray(image.part_id, np.float32)
    along = {f"normal_{axis}": normal[..., k] for k, axis in enumerate("xyz")}
    return {name: np.asarray(pixels) for name, pixels in channels.items()} | along


def write_exr(
    path: str | Path,
    image: Image,
    header: dict[str, str] | None = None,
    mask: _Image | None = None,
):
    """Write a frame with its time, units and further texts as an EXR file.

    The background is not left out, since a camera sees it too: `mask` is 0 there.

    Args:
        path: of the file.
        image: the frame.
        header: further texts by name.
        mask: fraction of each pixel that bodies cover; of whole pixels if None.

    Raises:
        InputError: for temperatures that are not finite, a mask of another size, or if
            the file cannot be written.
    """
    seen = "total" if image.band is None else f"of {image.band!r}"
    notes = {
        "time_s": f"{float(image.time):.9g}",
        "units": "temperature_K, apparent_temperature_K: K; radiance: W/(m^2 sr), "
        f"{seen}; emissivity: -; depth_m: m along the axis, inf in the background; "
        "object_id: -1 in the background; mask: fraction of the pixel that bodies "
        "cover, 0 in the background; normal_x, normal_y, normal_z: - in the world",
    }
    if image.part_id is not None:
        names = dict(enumerate(map(list, image.part_names)))
        notes["parts"] = json.dumps(names, ensure_ascii=False)
    if any(image.body_names):
        names = dict(enumerate(image.body_names))
        notes["bodies"] = json.dumps(names, ensure_ascii=False)
    write_channels(path, _exr_channels(image, mask), notes | (header or {}))
