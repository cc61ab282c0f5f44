"""False colours: a temperature image becomes an 8-bit sRGB image."""

import functools
import json
import math
from pathlib import Path

import numpy as np
from jaxtyping import Array, Float, UInt8

from ..arrays import Scalar
from ..errors import InputError


ENTRIES = 256


@functools.cache
def _tables() -> dict[str, np.ndarray]:
    rows = json.loads(Path(__file__).with_name("palettes.json").read_text())
    return {
        name: np.frombuffer(bytes.fromhex("".join(row)), np.uint8).reshape(ENTRIES, 3)
        for name, row in rows.items()
    }


def palette_names() -> tuple[str, ...]:
    """The names that `apply_palette` knows."""
    return tuple(_tables())


def palette_table(name: str) -> UInt8[np.ndarray, "256 3"]:
    """The sRGB colours of a palette, from cold to hot.

    Raises:
        InputError: for an unknown name.
    """
    if name not in _tables():
        known = ", ".join(palette_names())
        raise InputError(f"palette {name!r} is not known: use one of {known}")
    return _tables()[name]


def check_limits(low: Scalar, high: Scalar) -> tuple[float, float]:
    """The ends of a scale as plain numbers.

    Raises:
        InputError: for limits that are not finite and in order.
    """
    ends = float(low), float(high)
    if not (math.isfinite(ends[0]) and math.isfinite(ends[1]) and ends[0] <= ends[1]):
        raise InputError(
            f"palette limits low={low}, high={high}: give finite numbers, low <= high"
        )
    return ends


def apply_palette(
    values: Float[np.ndarray, "h w"] | Float[Array, "h w"],
    low: Scalar,
    high: Scalar,
    name: str,
    *,
    invalid: tuple[int, int, int] = (128, 128, 128),
) -> UInt8[np.ndarray, "h w 3"]:
    """Colours an image: `low` gets the coldest colour, `high` the hottest.

    index = round(255 (value - low) / (high - low)), clipped to 0-255. With
    `low == high`, values below, at and above it get the first, middle and last colour.

    Args:
        values: any quantity, in the unit of the limits; NaN where nothing is seen.
        low: value of the first colour.
        high: value of the last colour, at least `low`.
        name: one of `palette_names()`.
        invalid: sRGB colour of NaN, 0-255 each.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    table = palette_table(name)
    low, high = check_limits(low, high)
    image = np.asarray(values, np.float64)
    seen = ~np.isnan(image)
    # Clipped first, so that infinities take the end colours without a warning.
    bounded = np.clip(np.where(seen, image, low), low, high)
    if high > low:
        fraction = (bounded - low) / (high - low)
    else:
        fraction = 0.5 + 0.5 * np.sign(np.where(seen, image, low) - low)
    colours = table[np.rint(fraction * (ENTRIES - 1)).astype(np.intp)]
    colours[~seen] = np.asarray(invalid, np.uint8)
    return colours
