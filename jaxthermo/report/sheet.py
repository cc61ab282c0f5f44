"""Contact sheets: labelled pictures in rows, with one colour bar for all of them."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..choices import Palette
from ..image.colour.annotate import contact_sheet
from ..image.colour.canvas import FAINT, FRAME, INK, PAPER, drawable
from ..image.colour.palette import palette_table
from ..image.colour.ticks import scale_ticks


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
    beyond: tuple[bool, bool] = (False, False)
    """True for an end that values go beyond: it is pointed."""


@dataclass(frozen=True)
class Legend:
    """The colours that all tiles of a sheet have in common, by their meaning."""

    entries: tuple[tuple[str, tuple[int, int, int]], ...]
    """Meaning and sRGB of each colour."""
    title: str = ""


def colour_bar(
    low: float,
    high: float,
    title: str,
    palette: Palette = "iron",
    beyond: tuple[bool, bool] = (False, False),
) -> ColourBar:
    """The scale of a palette with round numbers between its ends."""
    colours = palette_table(palette)
    return ColourBar(colours, scale_ticks(low, high), title, beyond=beyond)


def even_columns(count: int, tall: float, ratio: float) -> int:
    """Columns of a sheet that is about `ratio` times as wide as high.

    Args:
        count: of the tiles.
        tall: height of a tile over its width.
        ratio: width of the sheet over its height.
    """
    columns = max(1, round(math.sqrt(ratio * count * tall)))
    # The tiles are spread evenly over the rows, so that no row is nearly empty.
    return math.ceil(count / math.ceil(count / columns))


def sheet(
    tiles: list[Tile], bar: ColourBar | Legend, title: str, columns: int | None = None
) -> Image.Image:
    """Tiles in rows under one title, with the colour bar or legend below them."""
    if columns is None:
        rows = math.ceil(len(tiles) / _MAX_COLUMNS)
        columns = math.ceil(len(tiles) / rows)
    tile_height = tiles[0].pixels.shape[0]
    text = max(11, min(28, tile_height // 22))
    framed = [_framed(tile, text) for tile in tiles]
    grid = contact_sheet(framed, columns)
    title_size = round(1.25 * text)
    font = ImageFont.load_default(size=title_size)
    title = drawable(title)
    head = 3 * text
    foot = 6 * text
    small = ImageFont.load_default(size=text)
    below = small.getlength(bar.title)
    if isinstance(bar, Legend):
        legend_width = sum(_entry_widths(bar, small, text))
        below = max(below, legend_width)
    text_width = max(font.getlength(title), below)
    needed = math.ceil(text_width) + 2 * text
    width = max(grid.width, needed)
    grid_bottom = head + grid.height
    height = grid_bottom + foot
    picture = Image.new("RGB", (width, height), PAPER)
    grid_left = (width - grid.width) // 2
    picture.paste(grid, (grid_left, head))
    draw = ImageDraw.Draw(picture)
    title_centre = (width / 2, head / 2)
    draw.text(title_centre, title, fill=INK, font=font, anchor="mm")
    if isinstance(bar, Legend):
        _draw_legend(picture, legend=bar, top=grid_bottom, text=text)
    else:
        _draw_bar(picture, bar=bar, top=grid_bottom, text=text)
    return picture


def enlarged(pixels: Pixels, edge: int) -> UInt8[np.ndarray, "H W 3"]:
    """Whole pixels repeated until the longer edge is about `edge` [px]."""
    longer_edge = max(pixels.shape[:2])
    factor = max(1, round(edge / longer_edge))
    rows = pixels.repeat(factor, axis=0)
    return rows.repeat(factor, axis=1)


def _framed(tile: Tile, text: int) -> Image.Image:
    # `text` is the height of the label's letters [px].
    height, width = tile.pixels.shape[:2]
    font = ImageFont.load_default(size=text)
    note_size = max(10, round(0.85 * text))
    small = ImageFont.load_default(size=note_size)
    heading = drawable(tile.label)
    note = drawable(tile.note)
    heading_width = font.getlength(heading)
    note_width = small.getlength(note)
    text_width = max(heading_width, note_width)
    # The canvas grows with its texts: long labels must not overlap the next tile.
    across = max(width + 2, math.ceil(text_width) + text)
    base = height + 2
    below = 2 * text
    if tile.note:
        below = round(3.2 * text)
    image = Image.new("RGB", (across, base + below), PAPER)
    left = (across - width - 2) // 2
    right = left + width + 1
    draw = ImageDraw.Draw(image)
    draw.rectangle((left, 0, right, height + 1), outline=FRAME)
    picture = Image.fromarray(np.ascontiguousarray(tile.pixels))
    image.paste(picture, (left + 1, 1))
    middle = across / 2
    heading_at = (middle, base + text)
    draw.text(heading_at, heading, fill=INK, font=font, anchor="mm")
    note_base = base + round(2.3 * text)
    note_at = (middle, note_base)
    draw.text(note_at, note, fill=FAINT, font=small, anchor="mm")
    return image


def _draw_bar(picture: Image.Image, bar: ColourBar, top: int, text: int) -> None:
    font = ImageFont.load_default(size=text)
    available_width = round(0.7 * picture.width)
    width = min(available_width, 60 * text)
    left = (picture.width - width) // 2
    height = round(1.1 * text)
    draw = ImageDraw.Draw(picture)
    middle = picture.width / 2
    title_at = (middle, top + 0.9 * text)
    draw.text(title_at, bar.title, fill=INK, font=font, anchor="mm")
    y = top + 2 * text
    last = len(bar.colours) - 1
    colour_position = np.linspace(0, last, width)
    index = np.rint(colour_position).astype(int)
    row = bar.colours[index]
    strip = np.repeat(row[None], height, axis=0)
    strip_picture = Image.fromarray(np.ascontiguousarray(strip))
    picture.paste(strip_picture, (left, y))
    bottom = y + height
    frame = (left - 1, y - 1, left + width, bottom)
    draw.rectangle(frame, outline=FRAME)
    tips = (
        (left - 2, left - 2 - height),
        (left + width + 1, left + width + 1 + height),
    )
    for is_beyond, (base, apex), colour in zip(
        bar.beyond, tips, bar.colours[[0, -1]].tolist(), strict=True
    ):
        if is_beyond:
            corners = [(base, y), (base, bottom - 1), (apex, y + height // 2)]
            draw.polygon(corners, fill=tuple(colour), outline=FAINT)
    for position, tick_label in bar.ticks:
        x = left + position * (width - 1)
        tick_end = bottom + text // 2
        draw.line((x, bottom, x, tick_end), fill=FAINT)
        label_at = (x, bottom + 1.2 * text)
        draw.text(label_at, tick_label, fill=INK, font=font, anchor="mm")


def _entry_widths(legend: Legend, font, text: int) -> list[float]:
    # A square, its meaning, and the space to the next one.
    square_and_space = 3.2 * text
    return [square_and_space + font.getlength(meaning) for meaning, _ in legend.entries]


def _draw_legend(picture: Image.Image, legend: Legend, top: int, text: int) -> None:
    font = ImageFont.load_default(size=text)
    draw = ImageDraw.Draw(picture)
    title_at = (picture.width / 2, top + 0.9 * text)
    draw.text(title_at, legend.title, fill=INK, font=font, anchor="mm")
    widths = _entry_widths(legend, font, text)
    margin = (picture.width - sum(widths)) / 2
    x = margin + text
    y = top + 3 * text
    square_top = y - 0.6 * text
    square_bottom = y + 0.6 * text
    for (meaning, colour), width in zip(legend.entries, widths, strict=True):
        box = (x, square_top, x + 1.2 * text, square_bottom)
        draw.rectangle(box, fill=colour, outline=FRAME)
        meaning_at = (x + 1.7 * text, y)
        draw.text(meaning_at, meaning, fill=INK, font=font, anchor="lm")
        x += width
