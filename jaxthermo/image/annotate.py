"""Annotated frames: image, temperature scale, time and title; contact sheets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..arrays import Scalar
from ..atomic import replacing
from ..errors import InputError
from .palette import apply_palette, check_limits
from .ticks import (
    decimals_of,
    end_decimals,
    label,
    nice_ticks,
    time_label,
    to_celsius,
)


_PAPER = (16, 17, 20)
_INK = (236, 236, 238)
_FAINT = (158, 160, 168)
_FRAME = (74, 76, 84)
_UNIT = "\N{DEGREE SIGN}C"


@dataclass(frozen=True)
class _Layout:
    """Sizes that follow from those of the image [pixels]."""

    font: ImageFont.FreeTypeFont | ImageFont.ImageFont
    text: int
    gap: int
    line: int

    @classmethod
    def of(cls, height: int, width: int) -> "_Layout":
        # By the height, but with smaller labels beside a narrow image.
        side = math.sqrt(height * min(width, 2 * height))
        text = min(max(round(side / 28), 10), 96)
        return cls(
            ImageFont.load_default(size=text),
            text,
            max(4, round(0.7 * text)),
            max(1, round(text / 14)),
        )

    # Rounded up, so that no letter is cut.
    def width(self, text: str) -> int:
        return math.ceil(self.font.getlength(text))


# Position along the bar (0 bottom, 1 top), text, and flag of an end, per label.
def _bar_labels(
    low: float, high: float, height: int, room: int
) -> list[tuple[float, str, bool]]:
    if high <= low:
        return [(0.5, label(low, end_decimals(low, high)), True)]
    ticks = nice_ticks(low, high, min(max(height // (2 * room), 2), 8))
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 0
    ends = [
        (0.0, label(low, end_decimals(low, high)), True),
        (1.0, label(high, end_decimals(low, high)), True),
    ]
    margin = room / height
    inner = [((t - low) / (high - low), label(t, decimals), False) for t in ticks]
    # Ticks too close to an end are dropped: the ends show the range of the colours.
    return ends + [tick for tick in inner if margin < tick[0] < 1.0 - margin]


def _draw_bar(
    canvas: Image.Image,
    box: tuple[int, int, int, int],
    limits: tuple[float, float],
    palette: str,
    labels: list[tuple[float, str, bool]],
    layout: _Layout,
) -> None:
    left, top, width, height = box
    low, high = limits
    column = np.linspace(high, low, height)[:, None]
    colours = apply_palette(np.repeat(column, width, axis=1), low, high, palette)
    canvas.paste(Image.fromarray(colours), (left, top))
    draw = ImageDraw.Draw(canvas)
    edge = layout.line
    ends = (left + width + edge - 1, top + height + edge - 1)
    draw.rectangle((left - edge, top - edge, *ends), outline=_FRAME, width=edge)
    for position, text, is_end in labels:
        y = top + (1.0 - position) * (height - 1)
        mark, upper = left + width + edge, round(y - edge / 2)
        lower = (mark + layout.gap // 2, upper + edge - 1)
        draw.rectangle((mark, upper, *lower), fill=_FAINT)
        draw.text(
            (mark + layout.gap, y),
            text,
            fill=_FAINT if is_end else _INK,
            font=layout.font,
            anchor="lm",
        )


def _shorten(text: str, room: int, layout: _Layout) -> str:
    if layout.width(text) <= room:
        return text
    while text and layout.width(text + "\N{HORIZONTAL ELLIPSIS}") > room:
        text = text[:-1]
    return text.rstrip() + "\N{HORIZONTAL ELLIPSIS}" if text else ""


def annotate(
    rgb: UInt8[np.ndarray, "h w 3"],
    *,
    low: Scalar,
    high: Scalar,
    palette: str,
    time: Scalar,
    title: str = "",
) -> Image.Image:
    """Add a temperature scale, the time and a title to a coloured image.

    Args:
        rgb: the image, as from `apply_palette`; its pixels stay unchanged.
        low: temperature of the coldest colour [K].
        high: temperature of the hottest colour [K].
        palette: name of the palette.
        time: of the frame [s].
        title: text at the bottom right, shortened if necessary.

    Returns:
        A larger image.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    low, high = check_limits(low, high)
    height, width, _ = rgb.shape
    layout = _Layout.of(height, width)
    gap, text = layout.gap, layout.text
    # The unit is above the bar, whose end labels extend it by half a line each.
    top = gap + round(1.9 * text)
    bar_height = max(height - top - gap - text // 2, 3 * text)
    bar_width = max(6, round(1.1 * text))
    limits = to_celsius(low), to_celsius(high)
    labels = _bar_labels(*limits, bar_height, round(1.3 * text))
    widest = max(layout.width(entry[1]) for entry in labels)
    panel = 2 * gap + bar_width + layout.line + gap + widest + gap
    strip = round(1.3 * text) + gap
    stamp = time_label(float(time))
    whole = max(width + panel, layout.width(stamp) + 2 * gap)
    tall = max(height, top + bar_height + gap + text // 2)

    canvas = Image.new("RGB", (whole, tall + strip), _PAPER)
    canvas.paste(Image.fromarray(np.ascontiguousarray(rgb)), (0, 0))
    left = width + 2 * gap
    _draw_bar(
        canvas, (left, top, bar_width, bar_height), (low, high), palette, labels, layout
    )
    draw = ImageDraw.Draw(canvas)
    draw.text((left, gap + text // 2), _UNIT, fill=_INK, font=layout.font, anchor="lm")
    base = tall + strip // 2
    draw.text((gap, base), stamp, fill=_INK, font=layout.font, anchor="lm")
    room = whole - layout.width(stamp) - 4 * gap
    caption = _shorten(title, room, layout)
    draw.text((whole - gap, base), caption, fill=_FAINT, font=layout.font, anchor="rm")
    return canvas


def contact_sheet(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Arrange images in rows on a dark sheet, in cells of the largest size.

    Raises:
        InputError: without an image or a column.
    """
    if not images or columns < 1:
        raise InputError(
            f"contact sheet of {len(images)} images in {columns} columns: "
            "give at least one of each"
        )
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    wide = max(image.width for image in images)
    tall = max(image.height for image in images)
    gap = max(2, round(0.02 * min(wide, tall)))
    size = (columns * (wide + gap) + gap, rows * (tall + gap) + gap)
    sheet = Image.new("RGB", size, _PAPER)
    for k, image in enumerate(images):
        row, column = divmod(k, columns)
        x = gap + column * (wide + gap) + (wide - image.width) // 2
        y = gap + row * (tall + gap) + (tall - image.height) // 2
        sheet.paste(image, (x, y))
    return sheet


def write_png(path: str | Path, image: Image.Image) -> None:
    """Write a PNG, replacing `path` in one step.

    Raises:
        InputError: when the path cannot be written.
    """
    with replacing(path) as temporary:
        image.save(temporary, format="PNG")
