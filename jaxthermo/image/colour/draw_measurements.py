"""Readings of measurements on a frame, drawn on its picture."""

from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Bool, Float
from PIL import Image as Pictures, ImageDraw
from PIL.Image import Image as Picture

from ...choices import Quantity
from ...errors import InputError
from ..measurements import (
    AbstractMeasurement,
    Box,
    Isotherm,
    Line,
    Reading,
    Spot,
    names_of,
    read_temperatures,
)
from ..radiance.image import Image
from .canvas import FAINT, INK, PAPER, Layout, drawable
from .frame_values import covered_fraction, shown_temperature
from .ticks import label, to_celsius


_UNIT = "\N{DEGREE SIGN}C"
# Outlines of isotherms, with a dark rim: no palette has all of them.
_ISOTHERMS = ((90, 255, 150), (90, 205, 255), (255, 130, 220), (255, 240, 90))


def measure(
    image: Image,
    measurements: Sequence[AbstractMeasurement],
    quantity: Quantity = "apparent",
    mask: Float[np.ndarray, "h w"] | None = None,
) -> dict[str, Reading]:
    """Read temperatures of a frame, of the pixels that bodies fill.

    Args:
        image: the frame.
        measurements: of the module `measurements`: `Spot`, `Line`, `Box`, `Isotherm`.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        mask: fraction of each pixel that bodies cover; of whole pixels if None.

    Raises:
        InputError: for temperatures that are not finite, a mask of another size, a
            point outside of the image, or a name given twice.
    """
    kelvin = shown_temperature(image, quantity)
    mask = covered_fraction(image) if mask is None else np.asarray(mask, float)
    if mask.shape != kelvin.shape:
        raise InputError(
            f"measure(mask=): {mask.shape} for a frame of {kelvin.shape}: give one size"
        )
    return read_temperatures(kelvin, mask >= 1, measurements)


def draw_measurements(
    picture: Picture,
    image: Image,
    measurements: Sequence[AbstractMeasurement],
    quantity: Quantity = "apparent",
    mask: Float[np.ndarray, "h w"] | None = None,
    decimals: int = 1,
) -> Picture:
    """Draw marks on a picture of a frame, and a line for each of them below it.

    Args:
        picture: of the frame, as from `picture`: the frame is its upper left corner.
        image: the frame.
        measurements: as of `measure`, which describes the other arguments.
        quantity: "apparent" or "surface".
        mask: fraction of each pixel that bodies cover.
        decimals: of temperatures.

    Returns:
        A taller picture; the same one without measurements.

    Raises:
        InputError: as of `measure`, and for a picture that is smaller than the frame.
    """
    readings = measure(image, measurements=measurements, quantity=quantity, mask=mask)
    if not measurements:
        return picture
    height, width = np.shape(image.object_id)
    if picture.width < width or picture.height < height:
        raise InputError(
            f"draw_measurements(picture=): {picture.width} x {picture.height} pixels "
            f"for a frame of {width} x {height}: give the picture of this frame"
        )
    drawn = picture.copy()
    draw_marks(
        drawn, image=image, measurements=measurements, quantity=quantity, mask=mask
    )
    return _with_readings(
        drawn,
        size=(height, width),
        measurements=measurements,
        readings=readings,
        decimals=decimals,
    )


def draw_marks(
    picture: Picture,
    image: Image,
    measurements: Sequence[AbstractMeasurement],
    quantity: Quantity = "apparent",
    mask: Float[np.ndarray, "h w"] | None = None,
) -> None:
    """Draw marks and names alone; arguments as of `draw_measurements`."""
    kelvin = shown_temperature(image, quantity)
    filled = (covered_fraction(image) if mask is None else mask) >= 1
    height, width = kelvin.shape
    layout = Layout.of(height, width)
    colours = iter(_isotherm_colours(measurements))
    # Outlines first: marks and names of other measurements are above them.
    for measurement in measurements:
        if isinstance(measurement, Isotherm):
            inside = np.zeros(kelvin.shape, bool)
            inside[measurement.pixels(kelvin)] = True
            _draw_outline(
                picture, inside=inside & filled, colour=next(colours), layout=layout
            )
    draw = ImageDraw.Draw(picture)
    for name, measurement in zip(names_of(measurements), measurements, strict=True):
        points = [(column, row) for row, column in measurement.points(height, width)]
        match measurement:
            case Spot():
                _draw_cross(draw, points[0], layout)
            case Line():
                _draw_line(draw, points, layout)
            case Box():
                _draw_box(draw, points, layout)
            case _:
                continue
        _draw_name(
            draw,
            points=points,
            above=isinstance(measurement, Box),
            name=name,
            size=(height, width),
            layout=layout,
        )


def _with_readings(
    picture: Picture,
    size: tuple[int, int],
    measurements: Sequence[AbstractMeasurement],
    readings: dict[str, Reading],
    decimals: int,
) -> Picture:
    layout = Layout.of(*size)
    step = round(1.35 * layout.text)
    height = picture.height + step * len(readings) + layout.gap
    canvas = Pictures.new("RGB", (picture.width, height), PAPER)
    canvas.paste(picture)
    draw = ImageDraw.Draw(canvas)
    names = {name: layout.shorten(name, picture.width // 3) for name in readings}
    left = max(layout.width(name) for name in names.values()) + 2 * layout.gap
    y = picture.height + step // 2
    colours = iter(_isotherm_colours(measurements))
    for (name, reading), measurement in zip(
        readings.items(), measurements, strict=True
    ):
        is_isotherm = isinstance(measurement, Isotherm)
        ink = next(colours) if is_isotherm else INK
        at = (layout.gap, y)
        draw.text(at, names[name], fill=ink, font=layout.font, anchor="lm")
        words = _reading_in_words(measurement, reading, decimals)
        words = layout.shorten(words, picture.width - left - layout.gap)
        ink = INK if reading.pixels or is_isotherm else FAINT
        draw.text((left, y), words, fill=ink, font=layout.font, anchor="lm")
        y += step
    return canvas


def limits_in_words(isotherm: Isotherm, decimals: int = 1) -> str:
    """The limits of an isotherm as text: "> 35.0 °C"."""
    low, high = (label(to_celsius(end), decimals) for end in isotherm.limits)
    if isotherm.below is None:
        return f"> {low} {_UNIT}"
    if isotherm.above is None:
        return f"< {high} {_UNIT}"
    return f"{low} to {high} {_UNIT}"


def _isotherm_colours(
    measurements: Sequence[AbstractMeasurement],
) -> list[tuple[int, int, int]]:
    count = sum(isinstance(measurement, Isotherm) for measurement in measurements)
    return [_ISOTHERMS[k % len(_ISOTHERMS)] for k in range(count)]


def _reading_in_words(
    measurement: AbstractMeasurement, reading: Reading, decimals: int = 1
) -> str:
    """A reading as text: "34.2 °C", or "background" where no body is."""

    def celsius(kelvin: float) -> str:
        return label(to_celsius(kelvin), decimals)

    if isinstance(measurement, Isotherm):
        percent = label(100 * reading.fraction, 1)
        return f"{limits_in_words(measurement, decimals)}: {percent} % of the bodies"
    if not reading.pixels:
        return "background"
    if isinstance(measurement, Spot):
        return f"{celsius(reading.mean)} {_UNIT}"
    ends = f"{celsius(reading.min)} to {celsius(reading.max)}"
    return f"{ends}, mean {celsius(reading.mean)} {_UNIT}"


def _draw_outline(
    picture: Picture,
    inside: Bool[np.ndarray, "h w"],
    colour: tuple[int, int, int],
    layout: Layout,
) -> None:
    # Scipy loads this part when it is first used: few frames have an isotherm.
    ndimage = scipy.ndimage
    # A frame's border is no end of an isotherm.
    core = ndimage.binary_erosion(inside, iterations=layout.line + 1, border_value=1)
    edge = inside & np.logical_not(core)
    rim = ndimage.binary_dilation(inside, iterations=1) & ~inside
    for where, ink in ((rim, PAPER), (edge, colour)):
        mask = Pictures.fromarray(where.astype(np.uint8) * 255)
        picture.paste(ink, (0, 0), mask)


def _strokes(layout: Layout) -> tuple[tuple[int, tuple[int, int, int]], ...]:
    # A light line on a dark one is seen on all colours.
    return (layout.line + 2 * max(1, layout.line // 2), PAPER), (layout.line, INK)


def _draw_cross(draw: ImageDraw.ImageDraw, at: tuple[int, int], layout: Layout) -> None:
    # Open in the middle: the pixel itself stays visible.
    far = round(0.55 * layout.text)
    near = max(2, round(0.2 * layout.text))
    x, y = at
    for width, ink in _strokes(layout):
        rim = (width - layout.line) // 2
        for way in (-1, 1):
            a = way * (near - rim)
            b = way * (far + rim)
            draw.line((x + a, y, x + b, y), fill=ink, width=width)
            draw.line((x, y + a, x, y + b), fill=ink, width=width)


def _draw_line(
    draw: ImageDraw.ImageDraw, points: list[tuple[int, int]], layout: Layout
) -> None:
    for width, ink in _strokes(layout):
        draw.line(points, fill=ink, width=width)
        reach = width + 1
        for x, y in points:
            draw.ellipse((x - reach, y - reach, x + reach, y + reach), fill=ink)


def _draw_box(
    draw: ImageDraw.ImageDraw, points: list[tuple[int, int]], layout: Layout
) -> None:
    left, right = sorted(x for x, _ in points)
    top, bottom = sorted(y for _, y in points)
    for width, ink in _strokes(layout):
        out = (width - layout.line) // 2
        corners = (left - out, top - out, right + out, bottom + out)
        draw.rectangle(corners, outline=ink, width=width)


def _draw_name(
    draw: ImageDraw.ImageDraw,
    points: list[tuple[int, int]],
    above: bool,
    name: str,
    size: tuple[int, int],
    layout: Layout,
) -> None:
    # Next to the last point, or above a box; moved where it would leave the image.
    height, width = size
    name = drawable(name)
    long = layout.width(name)
    tall = layout.text
    gap = layout.gap
    rim = layout.line + 1
    if above:
        x = min(x for x, _ in points)
        y = min(y for _, y in points) - tall
        y = y if y > tall / 2 else y + 2 * tall
    else:
        x, y = points[-1]
        x += gap + rim
        x = x if x + long + rim < width else points[-1][0] - gap - rim - long
    x = min(max(x, rim), max(width - long - rim, rim))
    y = min(max(y, tall // 2 + rim), height - tall // 2 - rim)
    how = {"stroke_width": rim, "stroke_fill": PAPER}
    draw.text((x, y), name, INK, layout.font, anchor="lm", **how)
