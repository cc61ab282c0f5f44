"""Pictures of frames in false colours."""

from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL.Image import Image as Picture

from ...choices import Palette, Quantity
from ..detector.gain import Gain
from ..radiance.image import Image
from .annotate import annotate, write_png as write_picture
from .canvas import averaged
from .frame_values import shown_temperature
from .palette import BACKGROUND, ENTRIES, apply_palette


class ColouredFrame(NamedTuple):
    """A frame in false colours."""

    colours: UInt8[np.ndarray, "h w 3"]
    beyond: tuple[bool, bool]
    """Flags of bodies in the frame that are colder and warmer than the scale."""


def coloured(
    image: Image,
    low: float,
    high: float,
    palette: Palette = "iron",
    quantity: Quantity = "apparent",
    samples: int = 1,
    gain: Gain | None = None,
) -> ColouredFrame:
    """Colour a frame, without a scale; arguments as of `picture`.

    Raises:
        InputError: for an unknown quantity or palette, limits not in order, or
            temperatures that are not finite.
    """
    kelvin = shown_temperature(image, quantity)
    on_body = np.isfinite(np.asarray(image.depth))
    values = np.where(on_body, kelvin, np.nan)
    ends = (low, high)
    if gain is not None:
        values = gain.positions(values)
        ends = (0.0, 1.0)
    colours = apply_palette(
        values, low=ends[0], high=ends[1], name=palette, invalid=BACKGROUND
    )
    return ColouredFrame(
        # Colours and not temperatures: at an edge their mean would be of neither side.
        averaged(colours, samples),
        beyond=_beyond(
            kelvin, on_body=on_body, ends=(float(low), float(high)), samples=samples
        ),
    )


def _without_silhouette(drawn: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels whose four neighbours are drawn as well."""
    # Without `scipy.ndimage`, whose import takes longer than many frames.
    wide = np.pad(drawn, 1, constant_values=True)
    neighbours = wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]
    return np.logical_and.reduce((drawn, *neighbours))


def picture(
    image: Image,
    low: float,
    high: float,
    palette: Palette = "iron",
    quantity: Quantity = "apparent",
    title: str = "",
    samples: int = 1,
    gain: Gain | None = None,
    start: datetime | None = None,
) -> Picture:
    """Draw a frame in false colours, with the time and a scale that names the quantity.

    The background has a colour of its own, in no palette. The scale has a pointed end
    where temperatures in the image lie beyond it.

    Args:
        image: the frame.
        low: temperature at the lower end of the scale [K].
        high: temperature at the upper end [K].
        palette: name of the palette.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        title: text next to the time.
        samples: pixels of the image along each axis, not coarsened yet, whose colours
            become one pixel.
        gain: curve of the colours over the temperature; linear if None.
        start: date and time at 0 s, which adds the time of day.

    Raises:
        InputError: for an unknown quantity or palette, limits not in order, or
            temperatures that are not finite.
    """
    frame = coloured(
        image,
        low=low,
        high=high,
        palette=palette,
        quantity=quantity,
        samples=samples,
        gain=gain,
    )
    return annotate(
        frame.colours,
        low=low,
        high=high,
        palette=palette,
        time=float(image.time),
        title=title,
        quantity=quantity,
        beyond=frame.beyond,
        gain=gain,
        start=start,
    )


def _beyond(
    kelvin: Float[np.ndarray, "H W"],
    on_body: Bool[np.ndarray, "H W"],
    ends: tuple[float, float],
    samples: int,
) -> tuple[bool, bool]:
    if samples == 1:
        # A coarsened pixel on the silhouette mixes the body with the background.
        on_body = _without_silhouette(on_body)
    seen = kelvin[on_body]
    low, high = ends
    # By more than half a colour, up to which the end's own colour is right.
    step = (high - low) / (2 * (ENTRIES - 1))
    return bool((seen < low - step).any()), bool((seen > high + step).any())


def write_png(path: str | Path, image: Image, low: float, high: float, **how: Any):
    """Write a frame in false colours as PNG; options as for `picture`.

    Raises:
        InputError: if the file cannot be written.
    """
    write_picture(path, picture(image, low, high, **how))
