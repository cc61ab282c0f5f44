"""Files of a frame that other programs open: 16-bit PNG, TIFF in kelvin, and CSV.

All of them have the temperature that a camera shows, or the surface's own, of every
pixel: in the background that of sky and ground.
"""

import csv
import io
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image as Pictures, PngImagePlugin

from ...atomic import replacing, write_text
from ...choices import Quantity
from ...errors import InputError
from ...temperatures import CENTIKELVIN
from ..colour.frame_values import QUANTITIES, shown_temperature
from ..radiance.image import Image


_LARGEST = np.iinfo(np.uint16).max
# Tags of TIFF.
_DESCRIPTION = 270
_SOFTWARE = 305


def saturated_pixels(kelvin: Float[np.ndarray, "h w"]) -> int:
    """Number of temperatures [K] above the largest of 16 bits in units of 0.01 K."""
    return int((np.rint(CENTIKELVIN.numbers(kelvin)) > _LARGEST).sum())


def centikelvin(kelvin: Float[np.ndarray, "h w"]) -> UInt16[np.ndarray, "h w"]:
    """Temperatures in units of 0.01 K; what is above 655.35 K is 65535."""
    counts = np.rint(CENTIKELVIN.numbers(np.asarray(kelvin, float)))
    return np.clip(counts, 0, _LARGEST).astype(np.uint16)


def write_centikelvin(
    path: str | Path,
    image: Image,
    quantity: Quantity = "apparent",
    saturate: bool = False,
) -> int:
    """Write temperatures in units of 0.01 K as a grey PNG of 16 bits.

    Args:
        path: of the file.
        image: the frame.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        saturate: write 65535 for what is above 655.35 K, as a camera does.

    Returns:
        The number of saturated pixels.

    Raises:
        InputError: for temperatures that are not finite or, unless `saturate`, above
            655.35 K, or if the file cannot be written.
    """
    kelvin = shown_temperature(image, quantity)
    above = saturated_pixels(kelvin)
    if above and not saturate:
        raise InputError(
            f"{path}: {above} of {kelvin.size} pixels are above "
            f"{_LARGEST * CENTIKELVIN.scale:g} K, up to {kelvin.max():g} K: 16 bits of "
            "0.01 K end there; write a TIFF, or give saturate=True"
        )
    texts = PngImagePlugin.PngInfo()
    for name, text in _notes(image, quantity).items():
        texts.add_text(name, text)
    texts.add_text("unit", "0.01 K")
    with replacing(path) as temporary:
        Pictures.fromarray(centikelvin(kelvin)).save(
            temporary, format="PNG", pnginfo=texts
        )
    return above


def write_tiff(
    path: str | Path,
    image: Image,
    quantity: Quantity = "apparent",
    low: float | None = None,
    high: float | None = None,
) -> None:
    """Write temperatures in kelvin as a TIFF of float32.

    The description is that of ImageJ, which shows kelvin below the pointer; other
    programs ignore it.

    Args:
        path: of the file.
        image: the frame.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        low: temperature that ImageJ shows in black [K]; the coldest if None.
        high: temperature that it shows in white [K]; the hottest if None.

    Raises:
        InputError: for temperatures that are not finite, or if the file cannot be
            written.
    """
    kelvin = shown_temperature(image, quantity)
    ends = [
        kelvin.min() if low is None else low,
        kelvin.max() if high is None else high,
    ]
    notes = {
        # Its first line is how ImageJ finds the rest.
        "ImageJ": "1.54f",
        "min": f"{float(ends[0]):.9g}",
        "max": f"{float(ends[1]):.9g}",
        "vunit": "K",
        **_notes(image, quantity),
        "unit_of_values": "K",
    }
    description = "".join(f"{name}={text}\n" for name, text in notes.items())
    tags = {_DESCRIPTION: description, _SOFTWARE: "jaxthermo"}
    with replacing(path) as temporary:
        pixels = Pictures.fromarray(kelvin.astype(np.float32))
        pixels.save(temporary, format="TIFF", tiffinfo=tags)


def write_csv(
    path: str | Path, image: Image, quantity: Quantity = "apparent", title: str = ""
) -> None:
    """Write temperatures in kelvin as a table, one line for each row of pixels.

    The lines before it begin with `#`, which `numpy.loadtxt` leaves out.

    Args:
        path: of the file.
        image: the frame.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        title: of the scene, in a line before the table.

    Raises:
        InputError: for temperatures that are not finite, or if the file cannot be
            written.
    """
    kelvin = shown_temperature(image, quantity)
    height, width = kelvin.shape
    head = {"title": title} if title else {}
    head |= _notes(image, quantity)
    head |= {"unit": "K", "columns": str(width), "rows": str(height)}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows(
        [f"# {name}", " ".join(value.split())] for name, value in head.items()
    )
    _write_table(text, kelvin)
    write_text(path, text.getvalue())


def _write_table(text: io.StringIO, kelvin: Float[np.ndarray, "h w"]) -> None:
    # To the millikelvin, below which float32 has no digits.
    np.savetxt(text, kelvin, fmt="%.3f", delimiter=",")


def _notes(image: Image, quantity: str) -> dict[str, str]:
    band = "all wavelengths" if image.band is None else repr(image.band)
    return {
        "time_s": f"{float(image.time):.9g}",
        "quantity": QUANTITIES[quantity],
        "band": band,
    }


def write_grey(
    path: str | Path, pixels: UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]
) -> None:
    """Write a grey PNG with the bits of the pixels.

    Raises:
        InputError: if the file cannot be written.
    """
    with replacing(path) as temporary:
        Pictures.fromarray(np.ascontiguousarray(pixels)).save(temporary, format="PNG")


def grey_levels(
    kelvin: Float[np.ndarray, "h w"], low: float, high: float
) -> UInt8[np.ndarray, "h w"]:
    """Temperatures as 256 levels, 0 at `low` and 255 at `high` [K], clipped."""
    share = (np.asarray(kelvin, float) - low) / max(high - low, 1e-9)
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)
