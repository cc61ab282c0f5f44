"""Contact sheets of the depth layers: one PNG for each axis and kind of image."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from ..image.annotate import contact_sheet, write_png
from ..voxels.grid import VoxelGrid
from ..voxels.textures import layer_images


_PAPER = (16, 17, 20)
_FRAME = (74, 76, 84)
_FAINT = (158, 160, 168)

SMALLEST = 300
"""Longer edge that a layer is enlarged to, about, if it has fewer pixels."""

SHAPE = 1.6
"""Width of a sheet over its height, about."""

PEELED = ("depth", "normal", "dominant")
"""Kinds of images whose layers are those of the peeling, not moved forwards."""


def write_layer_sheets(grid: VoxelGrid, folder: Path) -> list[Path]:
    """Writes `layers_x_depth.png` and so on; returns the paths.

    Raises:
        InputError: when the folder cannot be written.
    """
    return write_sheets(layer_images(grid), folder)


def write_sheets(
    named: dict[str, list[UInt8[np.ndarray, "h w 3"]]], folder: Path
) -> list[Path]:
    """Writes one sheet for each axis and kind, such as "x_depth"; returns the paths.

    Raises:
        InputError: when the folder cannot be written.
    """
    paths = []
    for name, images in named.items():
        if not images:
            continue
        axis, kind = name.split("_")
        what = "layer" if kind in PEELED else "packed"
        tiles = [_tile(image, f"{axis} {what} {k}") for k, image in enumerate(images)]
        path = folder / f"layers_{name}.png"
        write_png(path, contact_sheet(tiles, _columns(tiles)))
        paths.append(path)
    return paths


def _columns(tiles: list[Image.Image]) -> int:
    wide, tall = max(t.width for t in tiles), max(t.height for t in tiles)
    columns = max(1, round(math.sqrt(SHAPE * len(tiles) * tall / wide)))
    # As few rows as that asks for, but no row nearly empty.
    return math.ceil(len(tiles) / math.ceil(len(tiles) / columns))


def _tile(pixels: UInt8[np.ndarray, "h w 3"], label: str) -> Image.Image:
    """A layer, whole pixels enlarged if small, framed, with its label below."""
    factor = max(1, round(SMALLEST / max(pixels.shape[:2])))
    large = pixels.repeat(factor, axis=0).repeat(factor, axis=1)
    height, width = large.shape[:2]
    text = max(11, min(24, height // 16))
    font = ImageFont.load_default(size=text)
    across = max(width + 2, math.ceil(font.getlength(label)) + text)
    tile = Image.new("RGB", (across, height + 2 + 2 * text), _PAPER)
    left = (across - width - 2) // 2
    draw = ImageDraw.Draw(tile)
    draw.rectangle((left, 0, left + width + 1, height + 1), outline=_FRAME)
    tile.paste(Image.fromarray(np.ascontiguousarray(large)), (left + 1, 1))
    middle = (across / 2, height + 2 + text)
    draw.text(middle, label, fill=_FAINT, font=font, anchor="mm")
    return tile
