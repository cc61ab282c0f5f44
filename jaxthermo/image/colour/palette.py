"""False colours: from a temperature image to an 8-bit sRGB image.

Without jax, so that a config can check the name of a palette before jax is loaded.
"""

import functools
import json
import math
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np
from jaxtyping import Float, UInt8

from ...choices import Palette
from ...errors import InputError


# Colours of a palette.
ENTRIES = 256

BACKGROUND = (14, 54, 49)
"""sRGB where an image shows nothing: dark, and far from the colours of all palettes."""


@functools.cache
def _tables() -> dict[Palette, np.ndarray]:
    rows = json.loads(Path(__file__).with_name("palettes.json").read_text())
    return {
        name: np.frombuffer(bytes.fromhex("".join(row)), np.uint8).reshape(ENTRIES, 3)
        for name, row in rows.items()
    }


def palette_names() -> tuple[Palette, ...]:
    """Names of the palettes."""
    return tuple(_tables())


def palette_table(name: Palette) -> UInt8[np.ndarray, "256 3"]:
    """Colours of a palette as sRGB, from cold to hot.

    Raises:
        InputError: for an unknown name.
    """
    if name not in _tables():
        names = ", ".join(palette_names())
        raise InputError(f"palette {name!r} is not known: use one of {names}")
    return _tables()[name]


def check_limits(low: SupportsFloat, high: SupportsFloat) -> tuple[float, float]:
    """Convert the ends of a scale to plain numbers.

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
    values: Float[Any, "h w"],
    low: SupportsFloat,
    high: SupportsFloat,
    name: Palette,
    *,
    invalid: tuple[int, int, int] = (128, 128, 128),
) -> UInt8[np.ndarray, "h w 3"]:
    """Colour an image: index = round(255 (value - low) / (high - low)).

    The index is clipped to 0-255. With `low == high`, values below, at and above it
    have the first, middle and last colour.

    Args:
        values: array of numpy or jax, in the unit of the limits; NaN in the
            background.
        low: value of the first colour.
        high: value of the last colour, at least `low`.
        name: one of `palette_names()`.
        invalid: sRGB colour of NaN, 0-255 each.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    low, high = check_limits(low, high)
    # One more colour, of NaN.
    table = np.vstack([palette_table(name), np.asarray(invalid, np.uint8)])
    # Clipped first, so that infinities have the end colours without a warning.
    bounded = np.clip(np.asarray(values, np.float64), low, high)
    if high > low:
        bounded -= low
        bounded /= high - low
    else:
        bounded = 0.5 + 0.5 * np.sign(np.asarray(values, np.float64) - low)
    bounded *= ENTRIES - 1
    np.rint(bounded, out=bounded)
    bounded[np.isnan(bounded)] = ENTRIES
    # `take` is fast with the type of an index only.
    return table.take(bounded.astype(np.intp), axis=0)
