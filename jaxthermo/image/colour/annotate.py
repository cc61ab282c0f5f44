"""Annotated frames: image, temperature scale, time and title; contact sheets."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from ...arrays import Scalar
from ...atomic import replacing
from ...choices import Palette
from ...constants import ZERO_CELSIUS
from ...errors import InputError
from ..detector.gain import Gain
from .canvas import FAINT, FRAME, INK, PAPER, Layout
from .palette import apply_palette, check_limits, palette_table
from .ticks import decimals_of, end_decimals, label, nice_ticks, time_label, to_celsius


_UNIT = "\N{DEGREE SIGN}C"
# Before the label of an end that the image goes below or above.
_SIGNS = ("< ", "> ")
_END_INK = (FAINT, INK)


class _Label(NamedTuple):
    position: float
    """Along the bar, 0 at the bottom and 1 at the top."""
    text: str
    ink: tuple[int, int, int]


class _Scale(NamedTuple):
    """Temperatures along a bar, and its size."""

    low: float
    """Temperature at the lower end [°C]."""
    high: float
    """Temperature at the upper end [°C]."""
    height: int
    """Height of the bar [pixels]."""
    room: int
    """Least distance between two labels [pixels]."""
    gain: Gain | None


def _bar_labels(scale: _Scale, beyond: tuple[bool, bool]) -> list[_Label]:
    low, high, height, room, gain = scale
    digits = end_decimals(low, high)
    if high <= low:
        return [_Label(0.5, label(low, digits), FAINT)]
    ticks = nice_ticks(low, high, min(max(height // (2 * room), 2), 8))
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 0
    ends = [
        _Label(0.0, _SIGNS[0] * beyond[0] + label(low, digits), _END_INK[beyond[0]]),
        _Label(1.0, _SIGNS[1] * beyond[1] + label(high, digits), _END_INK[beyond[1]]),
    ]
    margin = room / height
    along = [(t - low) / (high - low) for t in ticks]
    if gain is not None:
        along = gain.positions(np.array(ticks) + ZERO_CELSIUS).tolist()
    inner = [
        _Label(at, label(t, decimals), INK) for at, t in zip(along, ticks, strict=True)
    ]
    # Ticks too close to an end are dropped: the ends show the range of the colours.
    labels = ends
    below = 0.0
    for tick in inner:
        if below + margin < tick.position < 1.0 - margin:
            labels.append(tick)
            # With a gain round numbers may be close together.
            below = tick.position if gain is not None else 0.0
    return labels


def _draw_bar(
    canvas: Image.Image,
    box: tuple[int, int, int, int],
    limits: tuple[float, float],
    palette: Palette,
    labels: list[_Label],
    layout: Layout,
) -> None:
    left, top, width, height = box
    low, high = limits
    column = np.linspace(high, low, height)[:, None]
    colours = apply_palette(
        np.repeat(column, width, axis=1), low=low, high=high, name=palette
    )
    canvas.paste(Image.fromarray(colours), (left, top))
    draw = ImageDraw.Draw(canvas)
    edge = layout.line
    ends = (left + width + edge - 1, top + height + edge - 1)
    draw.rectangle((left - edge, top - edge, *ends), outline=FRAME, width=edge)
    for position, text, ink in labels:
        y = top + (1.0 - position) * (height - 1)
        mark = left + width + edge
        upper = round(y - edge / 2)
        lower = (mark + layout.gap // 2, upper + edge - 1)
        draw.rectangle((mark, upper, *lower), fill=FAINT)
        at = (mark + layout.gap, y)
        draw.text(at, text, fill=ink, font=layout.font, anchor="lm")


# Points at the ends of the bar, in their colours, where the image goes beyond them.
def _draw_tips(
    canvas: Image.Image,
    box: tuple[int, int, int, int],
    palette: Palette,
    beyond: tuple[bool, bool],
    layout: Layout,
) -> None:
    left, top, width, height = box
    draw = ImageDraw.Draw(canvas)
    table = palette_table(palette)
    edge = layout.line
    tall = layout.tip
    for is_shown, end, base, apex in (
        (beyond[0], 0, top + height + edge, top + height + edge + tall),
        (beyond[1], -1, top - edge - 1, top - edge - 1 - tall),
    ):
        if is_shown:
            middle = left + (width - 1) / 2
            corners = [(left, base), (left + width - 1, base), (middle, apex)]
            colour = tuple(int(channel) for channel in table[end])
            draw.polygon(corners, fill=colour, outline=FAINT, width=edge)


def annotate(
    rgb: UInt8[np.ndarray, "h w 3"],
    *,
    low: Scalar,
    high: Scalar,
    palette: Palette,
    time: Scalar,
    title: str = "",
    quantity: str = "",
    beyond: tuple[bool, bool] = (False, False),
    gain: Gain | None = None,
    start: datetime | None = None,
) -> Image.Image:
    """Add a temperature scale, the time and a title to a coloured image.

    Args:
        rgb: the image, as from `apply_palette`; its pixels stay unchanged.
        low: temperature of the coldest colour [K].
        high: temperature of the hottest colour [K].
        palette: name of the palette.
        time: of the frame [s].
        title: text at the bottom right, shortened if necessary.
        quantity: name of what the colours show, above the scale.
        beyond: flags of values below `low` and above `high`, marked at the scale.
        gain: curve of the colours over the temperature; linear if None.
        start: date and time at 0 s, which adds the time of day.

    Returns:
        A larger image, of a size that does not depend on `beyond`.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    low, high = check_limits(low, high)
    height, width, _ = rgb.shape
    layout = Layout.of(height, width)
    gap = layout.gap
    text = layout.text
    heads = [quantity, _UNIT] if quantity else [_UNIT]
    # The lines above the bar, whose end labels extend it by half a line each, and tips.
    spare = max(text // 2, layout.tip + layout.line)
    top = gap + round((0.9 + 1.2 * len(heads)) * text) + layout.tip // 2
    bar_height = max(height - top - gap - spare, 3 * text)
    bar_width = max(6, round(1.1 * text))
    scale = _Scale(
        low=to_celsius(low),
        high=to_celsius(high),
        height=bar_height,
        room=round(1.3 * text),
        gain=gain,
    )
    labels = _bar_labels(scale, beyond)
    # Room for the signs in any case: all frames of a run have one size.
    longest = _bar_labels(scale, (True, True))
    widest = max(layout.width(entry.text) for entry in longest)
    panel = 2 * gap + bar_width + layout.line + gap + widest + gap
    panel = max(panel, *(3 * gap + layout.width(line) for line in heads))
    strip = round(1.3 * text) + gap
    stamp = time_label(float(time), start)
    total_width = max(width + panel, layout.width(stamp) + 2 * gap)
    tall = max(height, top + bar_height + gap + spare)

    canvas = Image.new("RGB", (total_width, tall + strip), PAPER)
    canvas.paste(Image.fromarray(np.ascontiguousarray(rgb)), (0, 0))
    left = width + 2 * gap
    box = (left, top, bar_width, bar_height)
    _draw_bar(
        canvas,
        box=box,
        limits=(low, high),
        palette=palette,
        labels=labels,
        layout=layout,
    )
    _draw_tips(canvas, box=box, palette=palette, beyond=beyond, layout=layout)
    draw = ImageDraw.Draw(canvas)
    for k, line in enumerate(heads):
        at = (left, gap + round((0.5 + 1.2 * k) * text))
        draw.text(at, line, fill=INK, font=layout.font, anchor="lm")
    base = tall + strip // 2
    draw.text((gap, base), stamp, fill=INK, font=layout.font, anchor="lm")
    room = total_width - layout.width(stamp) - 4 * gap
    caption = layout.shorten(title, room)
    draw.text(
        (total_width - gap, base), caption, fill=FAINT, font=layout.font, anchor="rm"
    )
    return canvas


def contact_sheet(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Arrange images in rows on a dark sheet, each row as high as its highest image.

    Raises:
        InputError: without an image or a column.
    """
    if not images or columns < 1:
        raise InputError(
            f"contact sheet of {len(images)} images in {columns} columns: "
            "give at least one of each"
        )
    columns = min(columns, len(images))
    wide = max(image.width for image in images)
    gap = max(2, round(0.02 * min(wide, max(image.height for image in images))))
    rows = [images[k : k + columns] for k in range(0, len(images), columns)]
    tall = [max(image.height for image in row) for row in rows]
    size = (columns * (wide + gap) + gap, sum(tall) + gap * (len(rows) + 1))
    sheet = Image.new("RGB", size, PAPER)
    top = gap
    for row, height in zip(rows, tall, strict=True):
        for column, image in enumerate(row):
            x = gap + column * (wide + gap) + (wide - image.width) // 2
            sheet.paste(image, (x, top + (height - image.height) // 2))
        top += height + gap
    return sheet


def write_png(path: str | Path, image: Image.Image) -> None:
    """Write a PNG, replacing `path` in one step.

    Raises:
        InputError: when the path cannot be written.
    """
    with replacing(path) as temporary:
        image.save(temporary, format="PNG")
