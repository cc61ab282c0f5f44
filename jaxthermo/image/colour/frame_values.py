"""Values of a frame that its files, pictures and measurements have in common."""

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ..radiance.image import Image
from .ticks import time_label


QUANTITIES = {"apparent": "apparent temperature", "surface": "surface temperature"}
"""Names of what a frame shows: as of a camera, or the surface's own."""


def shown_temperature(image: Image, quantity: str) -> Float[np.ndarray, "h w"]:
    """Apparent or surface temperature of each pixel [K].

    Raises:
        InputError: for an unknown quantity, or temperatures that are not finite.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"quantity={quantity!r}: choose 'apparent' or 'surface'")
    values = image.apparent_temperature if quantity == "apparent" else image.temperature
    kelvin = np.asarray(values, float)
    wrong = int(kelvin.size - np.isfinite(kelvin).sum())
    if wrong:
        raise InputError(
            f"frame at {time_label(float(image.time))}: {QUANTITIES[quantity]} of "
            f"{wrong} of {kelvin.size} pixels is not finite: check the terms and "
            "materials of the scene"
        )
    return kelvin


def covered_fraction(image: Image) -> Float[np.ndarray, "h w"]:
    """Fraction of each pixel that bodies cover [-]: 0 in the background, 1 inside."""
    if image.coverage is not None:
        return np.asarray(image.coverage, float)
    return (np.asarray(image.object_id) >= 0).astype(float)
