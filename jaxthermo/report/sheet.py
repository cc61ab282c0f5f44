"""Contact sheets: labelled pictures in rows, with one colour bar for all of them."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..image.colour.annotate import contact_sheet
from ..image.colour.canvas import FAINT, FRAME, INK, PAPER, drawable
from ..image.colour.ticks import decimals_of, label, nice_ticks


Pixels = UInt8[np.ndarray, "h w 3"]

_MAX_COLUMNS = 6


@dataclass(frozen=True)
class Tile:
    """A picture, its label, and a note in smaller letters below it."""

    pixels: Pixels
    label: str
    note: str = ""


@dataclass(frozen=True)
class ColourBar:
    """The colour scale that all tiles of a sheet have in common."""

    colours: UInt8[np.ndarray, "n 3"]
    """Colours from the lower end of the scale to the upper end."""
    ticks: tuple[tuple[float, str], ...]
    """Position along the bar (0 to 1) and label of each tick."""
    title: str


@dataclass(frozen=True)
class Legend:
    """The colours that all tiles of a sheet have in common, by their meaning."""

    entries: tuple[tuple[str, tuple[int, int, int]], ...]
    """Meaning and sRGB of each colour."""
    title: str = ""


def scale_ticks(low: float, high: float) -> tuple[tuple[float, str], ...]:
    """Ticks at round values of a scale, as `ColourBar.ticks`."""
    values = nice_ticks(low, high)
    decimals = decimals_of(values[1] - values[0]) if len(values) > 1 else 1
    span = max(high - low, 1e-9)
    return tuple(((value - low) / span, label(value, decimals)) for value in values)


def sheet(
    tiles: list[Tile], bar: ColourBar | Legend, title: str, columns: int | None = None
) -> Image.Image:
    """Tiles in rows under one title, with the colour bar or legend below them."""
    if columns is None:
        rows = math.ceil(len(tiles) / _MAX_COLUMNS)
        columns = math.ceil(len(tiles) / rows)
    text = max(11, min(28, tiles[0].pixels.shape[0] // 22))
    grid = contact_sheet([_framed(tile, text) for tile in tiles], columns)
    font = ImageFont.load_default(size=round(1.25 * text))
    title = drawable(title)
    head = 3 * text
    foot = 6 * text
    small = ImageFont.load_default(size=text)
    below = small.getlength(bar.title)
    if isinstance(bar, Legend):
        below = max(below, sum(_entry_widths(bar, small, text)))
    needed = math.ceil(max(font.getlength(title), below)) + 2 * text
    width = max(grid.width, needed)
    picture = Image.new("RGB", (width, grid.height + head + foot), PAPER)
    picture.paste(grid, ((width - grid.width) // 2, head))
    draw = ImageDraw.Draw(picture)
    draw.text((width / 2, head / 2), title, fill=INK, font=font, anchor="mm")
    if isinstance(bar, Legend):
        _draw_legend(picture, legend=bar, top=grid.height + head, text=text)
    else:
        _draw_bar(picture, bar=bar, top=grid.height + head, text=text)
    return picture


def enlarged(pixels: Pixels, edge: int) -> UInt8[np.ndarray, "H W 3"]:
    """Whole pixels repeated until the longer edge is about `edge` [px]."""
    factor = max(1, round(edge / max(pixels.shape[:2])))
    return pixels.repeat(factor, axis=0).repeat(factor, axis=1)


def _framed(tile: Tile, text: int) -> Image.Image:
    # `text` is the height of the label's letters [px].
    height, width = tile.pixels.shape[:2]
    font = ImageFont.load_default(size=text)
    small = ImageFont.load_default(size=max(10, round(0.85 * text)))
    heading = drawable(tile.label)
    note = drawable(tile.note)
    text_width = max(font.getlength(heading), small.getlength(note))
    # The canvas grows with its texts: long labels must not overlap the next tile.
    across = max(width + 2, math.ceil(text_width) + text)
    below = round(3.2 * text) if tile.note else 2 * text
    image = Image.new("RGB", (across, height + 2 + below), PAPER)
    left = (across - width - 2) // 2
    draw = ImageDraw.Draw(image)
    draw.rectangle((left, 0, left + width + 1, height + 1), outline=FRAME)
    image.paste(Image.fromarray(np.ascontiguousarray(tile.pixels)), (left + 1, 1))
    middle = across / 2
    base = height + 2
    draw.text((middle, base + text), heading, fill=INK, font=font, anchor="mm")
    note_at = (middle, base + round(2.3 * text))
    draw.text(note_at, note, fill=FAINT, font=small, anchor="mm")
    return image


def _draw_bar(picture: Image.Image, bar: ColourBar, top: int, text: int) -> None:
    font = ImageFont.load_default(size=text)
    width = min(round(0.7 * picture.width), 60 * text)
    left = (picture.width - width) // 2
    height = round(1.1 * text)
    draw = ImageDraw.Draw(picture)
    middle = picture.width / 2
    draw.text((middle, top + 0.9 * text), bar.title, fill=INK, font=font, anchor="mm")
    y = top + 2 * text
    index = np.rint(np.linspace(0, len(bar.colours) - 1, width)).astype(int)
    strip = np.repeat(bar.colours[index][None], height, axis=0)
    picture.paste(Image.fromarray(np.ascontiguousarray(strip)), (left, y))
    bottom = y + height
    draw.rectangle((left - 1, y - 1, left + width, bottom), outline=FRAME)
    for position, tick_label in bar.ticks:
        x = left + position * (width - 1)
        draw.line((x, bottom, x, bottom + text // 2), fill=FAINT)
        label_at = (x, bottom + 1.2 * text)
        draw.text(label_at, tick_label, fill=INK, font=font, anchor="mm")


def _entry_widths(legend: Legend, font, text: int) -> list[float]:
    # A square, its meaning, and the space to the next one.
    return [3.2 * text + font.getlength(meaning) for meaning, _ in legend.entries]


def _draw_legend(picture: Image.Image, legend: Legend, top: int, text: int) -> None:
    font = ImageFont.load_default(size=text)
    draw = ImageDraw.Draw(picture)
    at = (picture.width / 2, top + 0.9 * text)
    draw.text(at, legend.title, fill=INK, font=font, anchor="mm")
    widths = _entry_widths(legend, font, text)
    x = (picture.width - sum(widths)) / 2 + text
    y = top + 3 * text
    for (meaning, colour), width in zip(legend.entries, widths, strict=True):
        box = (x, y - 0.6 * text, x + 1.2 * text, y + 0.6 * text)
        draw.rectangle(box, fill=colour, outline=FRAME)
        draw.text((x + 1.7 * text, y), meaning, fill=INK, font=font, anchor="lm")
        x += width
