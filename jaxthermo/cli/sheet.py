"""Contact sheets: pictures of one body in rows, labels below, one scale for all."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..image.annotate import contact_sheet


PAPER = (16, 17, 20)
INK = (236, 236, 238)
FAINT = (158, 160, 168)
FRAME = (74, 76, 84)

MOST_COLUMNS = 6


@dataclass(frozen=True)
class Tile:
    """A picture, its name, and a line about it."""

    pixels: UInt8[np.ndarray, "h w 3"]
    label: str
    note: str


@dataclass(frozen=True)
class ColourBar:
    """What the colours of all tiles mean."""

    colours: UInt8[np.ndarray, "n 3"]
    """From the lower end to the upper one."""
    ticks: tuple[tuple[float, str], ...]
    """Place along the bar, 0 to 1, and what stands there."""
    title: str


def sheet(tiles: list[Tile], bar: ColourBar, title: str) -> Image.Image:
    """All tiles under one title, and the colour bar below them."""
    rows = math.ceil(len(tiles) / MOST_COLUMNS)
    columns = math.ceil(len(tiles) / rows)
    grid = contact_sheet([_tile(tile) for tile in tiles], columns)
    text = _text_size(tiles[0].pixels.shape[0])
    font = ImageFont.load_default(size=round(1.25 * text))
    head, foot = 3 * text, 6 * text
    below = ImageFont.load_default(size=text).getlength(bar.title)
    needed = math.ceil(max(font.getlength(title), below)) + 2 * text
    width = max(grid.width, needed)
    whole = Image.new("RGB", (width, grid.height + head + foot), PAPER)
    whole.paste(grid, ((width - grid.width) // 2, head))
    draw = ImageDraw.Draw(whole)
    draw.text((width / 2, head / 2), title, fill=INK, font=font, anchor="mm")
    _bar(whole, bar, grid.height + head, text)
    return whole


def _text_size(height: int) -> int:
    return max(11, min(28, height // 22))


def _tile(tile: Tile) -> Image.Image:
    """The picture in a thin frame, its label and its note below."""
    height, width = tile.pixels.shape[:2]
    text = _text_size(height)
    font = ImageFont.load_default(size=text)
    small = ImageFont.load_default(size=max(10, round(0.85 * text)))
    widths = (font.getlength(tile.label), small.getlength(tile.note))
    across = max(width + 2, math.ceil(max(widths)) + text)
    image = Image.new("RGB", (across, height + 2 + round(3.2 * text)), PAPER)
    left = (across - width - 2) // 2
    draw = ImageDraw.Draw(image)
    draw.rectangle((left, 0, left + width + 1, height + 1), outline=FRAME)
    image.paste(Image.fromarray(np.ascontiguousarray(tile.pixels)), (left + 1, 1))
    middle, base = across / 2, height + 2
    draw.text((middle, base + text), tile.label, fill=INK, font=font, anchor="mm")
    place = (middle, base + round(2.3 * text))
    draw.text(place, tile.note, fill=FAINT, font=small, anchor="mm")
    return image


def _bar(whole: Image.Image, bar: ColourBar, top: int, text: int) -> None:
    """A horizontal colour bar in the strip below `top`."""
    font = ImageFont.load_default(size=text)
    width = min(round(0.7 * whole.width), 60 * text)
    left, high = (whole.width - width) // 2, round(1.1 * text)
    draw = ImageDraw.Draw(whole)
    middle = whole.width / 2
    draw.text((middle, top + 0.9 * text), bar.title, fill=INK, font=font, anchor="mm")
    y = top + 2 * text
    index = np.rint(np.linspace(0, len(bar.colours) - 1, width)).astype(int)
    strip = np.repeat(bar.colours[index][None], high, axis=0)
    whole.paste(Image.fromarray(np.ascontiguousarray(strip)), (left, y))
    draw.rectangle((left - 1, y - 1, left + width, y + high), outline=FRAME)
    for place, label in bar.ticks:
        x = left + place * (width - 1)
        draw.line((x, y + high, x, y + high + text // 2), fill=FAINT)
        spot = (x, y + high + 1.2 * text)
        draw.text(spot, label, fill=INK, font=font, anchor="mm")
