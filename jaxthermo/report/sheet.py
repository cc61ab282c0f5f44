"""Contact sheets: labelled pictures in rows, with one colour bar for all of them."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..image.annotate import contact_sheet, write_png
from ..voxels.grid import VoxelGrid
from ..voxels.textures import layer_images


Pixels = UInt8[np.ndarray, "h w 3"]

_PAPER = (16, 17, 20)
_INK = (236, 236, 238)
_FAINT = (158, 160, 168)
_FRAME = (74, 76, 84)

_MAX_COLUMNS = 6
# Longer edge that a small layer is enlarged to, about [px]: one voxel is one pixel.
_LAYER_EDGE = 300
# Width of a sheet of layers over its height, about that of a screen.
_LAYER_SHEET_RATIO = 1.6
# Kinds of images whose layers are those of the peeling, not packed forwards.
_PEELED_KINDS = ("depth", "normal", "dominant")


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
    """Position along the bar, 0 to 1, and label of each tick."""
    title: str


def sheet(tiles: list[Tile], bar: ColourBar, title: str) -> Image.Image:
    """Tiles in rows under one title, with the colour bar below them."""
    rows = math.ceil(len(tiles) / _MAX_COLUMNS)
    columns = math.ceil(len(tiles) / rows)
    text = max(11, min(28, tiles[0].pixels.shape[0] // 22))
    grid = contact_sheet([_framed(tile, text, _INK) for tile in tiles], columns)
    font = ImageFont.load_default(size=round(1.25 * text))
    head, foot = 3 * text, 6 * text
    below = ImageFont.load_default(size=text).getlength(bar.title)
    needed = math.ceil(max(font.getlength(title), below)) + 2 * text
    width = max(grid.width, needed)
    whole = Image.new("RGB", (width, grid.height + head + foot), _PAPER)
    whole.paste(grid, ((width - grid.width) // 2, head))
    draw = ImageDraw.Draw(whole)
    draw.text((width / 2, head / 2), title, fill=_INK, font=font, anchor="mm")
    _draw_bar(whole, bar, grid.height + head, text)
    return whole


def enlarged(pixels: Pixels, edge: int) -> UInt8[np.ndarray, "H W 3"]:
    """Whole pixels repeated until the longer edge is about `edge` [px]."""
    factor = max(1, round(edge / max(pixels.shape[:2])))
    return pixels.repeat(factor, axis=0).repeat(factor, axis=1)


def write_layer_sheets(grid: VoxelGrid, folder: Path) -> list[Path]:
    """Write the depth layers, `layers_x_depth.png` and so on; return the paths.

    Raises:
        InputError: if the folder cannot be written.
    """
    return _write_sheets(layer_images(grid), folder)


def _write_sheets(named: dict[str, list[Pixels]], folder: Path) -> list[Path]:
    # The names have an axis and a kind, such as "x_depth".
    paths = []
    for name, images in named.items():
        if not images:
            continue
        axis, kind = name.split("_")
        layer = "layer" if kind in _PEELED_KINDS else "packed"
        tiles = [
            _layer_tile(image, f"{axis} {layer} {k}") for k, image in enumerate(images)
        ]
        path = folder / f"layers_{name}.png"
        write_png(path, contact_sheet(tiles, _layer_columns(tiles)))
        paths.append(path)
    return paths


def _layer_columns(tiles: list[Image.Image]) -> int:
    wide, tall = max(t.width for t in tiles), max(t.height for t in tiles)
    ratio = _LAYER_SHEET_RATIO * len(tiles) * tall / wide
    columns = max(1, round(math.sqrt(ratio)))
    # Few rows as that ratio asks for, spread evenly so that none is nearly empty.
    return math.ceil(len(tiles) / math.ceil(len(tiles) / columns))


def _layer_tile(pixels: Pixels, label: str) -> Image.Image:
    large = enlarged(pixels, _LAYER_EDGE)
    text = max(11, min(24, large.shape[0] // 16))
    return _framed(Tile(large, label), text, _FAINT)


def _framed(tile: Tile, text: int, ink: tuple[int, int, int]) -> Image.Image:
    # `text` is the height of the label's letters [px].
    height, width = tile.pixels.shape[:2]
    font = ImageFont.load_default(size=text)
    small = ImageFont.load_default(size=max(10, round(0.85 * text)))
    widths = font.getlength(tile.label), small.getlength(tile.note)
    # The canvas grows with its texts, or long labels would run into the next tile.
    across = max(width + 2, math.ceil(max(widths)) + text)
    below = round(3.2 * text) if tile.note else 2 * text
    image = Image.new("RGB", (across, height + 2 + below), _PAPER)
    left = (across - width - 2) // 2
    draw = ImageDraw.Draw(image)
    draw.rectangle((left, 0, left + width + 1, height + 1), outline=_FRAME)
    image.paste(Image.fromarray(np.ascontiguousarray(tile.pixels)), (left + 1, 1))
    middle, base = across / 2, height + 2
    draw.text((middle, base + text), tile.label, fill=ink, font=font, anchor="mm")
    note_at = (middle, base + round(2.3 * text))
    draw.text(note_at, tile.note, fill=_FAINT, font=small, anchor="mm")
    return image


def _draw_bar(whole: Image.Image, bar: ColourBar, top: int, text: int) -> None:
    font = ImageFont.load_default(size=text)
    width = min(round(0.7 * whole.width), 60 * text)
    left, high = (whole.width - width) // 2, round(1.1 * text)
    draw = ImageDraw.Draw(whole)
    middle = whole.width / 2
    draw.text((middle, top + 0.9 * text), bar.title, fill=_INK, font=font, anchor="mm")
    y = top + 2 * text
    index = np.rint(np.linspace(0, len(bar.colours) - 1, width)).astype(int)
    strip = np.repeat(bar.colours[index][None], high, axis=0)
    whole.paste(Image.fromarray(np.ascontiguousarray(strip)), (left, y))
    draw.rectangle((left - 1, y - 1, left + width, y + high), outline=_FRAME)
    for position, label in bar.ticks:
        x = left + position * (width - 1)
        draw.line((x, y + high, x, y + high + text // 2), fill=_FAINT)
        label_at = (x, y + high + 1.2 * text)
        draw.text(label_at, label, fill=_INK, font=font, anchor="mm")
