"""Thermal images as files: radiometric EXR, and PNG for the eye."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from .annotate import annotate, write_png as write_picture
from .exr import write_exr_channels
from .palette import apply_palette
from .render import Image


def exr_channels(image: Image) -> dict[str, np.ndarray]:
    """The named float32 channels of a radiometric frame."""
    normal = np.asarray(image.normal)
    return {
        "temperature_K": np.asarray(image.temperature),
        "apparent_temperature_K": np.asarray(image.apparent_temperature),
        "radiance": np.asarray(image.radiance),
        "emissivity": np.asarray(image.emissivity),
        "depth_m": np.asarray(image.depth),
        "object_id": np.asarray(image.object_id, np.float32),
        "normal_x": normal[..., 0],
        "normal_y": normal[..., 1],
        "normal_z": normal[..., 2],
    }


def write_exr(path: str | Path, image: Image, header: dict[str, str] | None = None):
    """Write a frame with its time and units, and any more text, into an EXR file.

    Raises:
        InputError: if the file cannot be written.
    """
    notes = {
        "time_s": f"{float(image.time):.9g}",
        "units": "temperature_K, apparent_temperature_K: K; radiance: W/(m^2 sr), "
        "total; depth_m: m along the axis, inf in the background; object_id: -1 in "
        "the background",
    }
    write_exr_channels(path, exr_channels(image), notes | (header or {}))


def picture(
    image: Image,
    low: float,
    high: float,
    palette: str = "iron",
    quantity: str = "apparent",
    title: str = "",
):
    """The frame in false colours, with a temperature bar and the time.

    Args:
        image: the frame.
        low: temperature at the lower end of the bar [K].
        high: at the upper end [K].
        palette: by name.
        quantity: "apparent" (what a camera shows) or "surface" (the true temperature).
        title: beside the time.
    """
    if quantity not in ("apparent", "surface"):
        raise InputError(f"quantity={quantity!r}: choose 'apparent' or 'surface'")
    shown = image.apparent_temperature if quantity == "apparent" else image.temperature
    colours = apply_palette(np.asarray(shown), low, high, palette)
    return annotate(
        colours,
        low=low,
        high=high,
        palette=palette,
        time=float(image.time),
        title=title,
    )


def write_png(path: str | Path, image: Image, low: float, high: float, **how):
    """Write the frame in false colours; the rest as for `picture`.

    Raises:
        InputError: if the file cannot be written.
    """
    write_picture(path, picture(image, low, high, **how))
