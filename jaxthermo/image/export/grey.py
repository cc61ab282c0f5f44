"""Grey PNG files of 8 and 16 bits, from numbers that they hold exactly or rounded."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image

from ...atomic import replacing


def write_grey(
    path: str | Path, pixels: UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]
) -> None:
    """Write a grey PNG with the bits of the pixels.

    Raises:
        InputError: if the file cannot be written.
    """
    with replacing(path) as temporary:
        Image.fromarray(np.ascontiguousarray(pixels)).save(temporary, format="PNG")


def grey_levels(
    kelvin: Float[np.ndarray, "h w"], low: float, high: float
) -> UInt8[np.ndarray, "h w"]:
    """Temperatures as 256 levels, 0 at `low` and 255 at `high` [K], clipped."""
    share = (np.asarray(kelvin, float) - low) / max(high - low, 1e-9)
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)
