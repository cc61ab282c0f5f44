"""Sheets of depth layers and of contact textures, each with its legend."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from ..arrays import Scalar
from ..image.colour.annotate import write_png
from ..image.colour.contact_texture import contact_images
from ..image.colour.palette import palette_table
from ..image.colour.ticks import decimals_of, label, nice_ticks
from ..voxels.grid import VoxelGrid
from ..voxels.textures import (
    AXIS_COLOURS,
    depth_colours,
    layer_images,
    normal_colours,
)
from .numbers import count
from .sheet import ColourBar, Legend, Pixels, Tile, enlarged, sheet


# Longer edge that a small layer is enlarged to, about [px]: one voxel is one pixel.
_LAYER_EDGE = 300
# Width of a sheet of layers over its height, about that of a screen.
_SHEET_RATIO = 1.6
_WAYS = ("+x", "-x", "+y", "-y", "+z", "-z")
# The packed layers hold surface fragments alone, and not where they were peeled.
_TITLES = {
    "depth": "depth layers along {axis}, the first in front",
    "normal": "normals of the depth layers along {axis}",
    "dominant": "dominant axes of the depth layers along {axis}",
    "packed": "surface fragments along {axis}, each moved to the first free layer",
}


def write_layer_sheets(grid: VoxelGrid, folder: Path) -> list[Path]:
    """Write the depth layers, `layers_x_depth.png` and so on; return the paths.

    Raises:
        InputError: if the folder cannot be written.
    """
    paths = []
    for name, images in layer_images(grid).items():
        if not images:
            continue
        axis, kind = name.split("_")
        word = "packed" if kind == "packed" else "layer"
        tiles = [
            Tile(enlarged(image, _LAYER_EDGE), f"{axis} {word} {k}")
            for k, image in enumerate(images)
        ]
        from_front = f"depth along +{axis} from the front of the lattice"
        key = depth_bar(grid, axis, from_front) if kind == "depth" else _legend(kind)
        path = folder / f"layers_{name}.png"
        title = f"{grid.mesh.name}: {_TITLES[kind].format(axis=axis)}"
        write_png(path, sheet(tiles, bar=key, title=title, columns=_columns(tiles)))
        paths.append(path)
    return paths


def _columns(tiles: list[Tile]) -> int:
    tall = max(tile.pixels.shape[0] for tile in tiles)
    wide = max(tile.pixels.shape[1] for tile in tiles)
    ratio = _SHEET_RATIO * len(tiles) * tall / wide
    columns = max(1, round(math.sqrt(ratio)))
    # Few rows as that ratio asks for, spread evenly so that none is nearly empty.
    return math.ceil(len(tiles) / math.ceil(len(tiles) / columns))


def depth_bar(grid: VoxelGrid, axis: str, quantity: str) -> ColourBar:
    """The scale of the depths of layers along an axis of the lattice [mm]."""
    whole = 1e3 * grid.pitch * grid.lattice.shape["xyz".index(axis)]
    ticks = nice_ticks(0.0, whole)
    decimals = decimals_of(ticks[1] - ticks[0])
    return ColourBar(
        depth_colours(np.linspace(0.0, 1.0, 256)),
        tuple((tick / whole, label(tick, decimals)) for tick in ticks),
        f"{quantity} [mm]; dark: no surface",
    )


def _legend(kind: str) -> Legend:
    if kind == "dominant":
        shown = zip(("x", "y", "z", "no area"), AXIS_COLOURS.tolist(), strict=True)
        return _of(shown, "dominant axis of the normal; dark: no surface")
    title = "outward normal n: red, green, blue are (n + 1) / 2; dark: no surface"
    return normal_legend(title)


def normal_legend(title: str, names: Sequence[str] = _WAYS) -> Legend:
    """Colours of normals along the axes of the lattice: +x, -x, +y, -y, +z, -z."""
    ways = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    return _of(zip(names, normal_colours(ways).tolist(), strict=True), title)


def _of(shown, title: str) -> Legend:
    entries = tuple((text, (red, green, blue)) for text, (red, green, blue) in shown)
    return Legend(entries, title)


def contact_tiles(
    name: str,
    grid: VoxelGrid,
    values: Float[np.ndarray, " s"],
    low: Scalar,
    high: Scalar,
    palette: str = "iron",
) -> list[Tile]:
    """Contact textures of a body, a tile for each layer with any contact.

    Args:
        name: of the body.
        grid: of the body.
        values: of every fragment; NaN where it is not in contact.
        low: value of the first colour.
        high: value of the last colour.
        palette: name of the palette.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    tiles = []
    layer, touched = grid.fragment_layer[:, 1], ~np.isnan(values)
    for key, images in contact_images(
        grid, values=values, low=low, high=high, palette=palette
    ).items():
        mine = grid.is_packed("xyz".index(key[0])) & touched
        for number in np.unique(layer[mine]).tolist():
            heading = f"{name}, {key[0]} layer {number}"
            touching = int(np.count_nonzero(layer[mine] == number))
            note = count(touching, "fragment") + " in contact"
            pixels: Pixels = enlarged(images[number], _LAYER_EDGE)
            tiles.append(Tile(pixels, heading, note))
    return tiles


def contact_texture_sheet(
    bodies: list[tuple[str, VoxelGrid, Float[np.ndarray, " s"]]],
    limits: tuple[float, float],
    quantity: str,
    title: str,
    palette: str = "iron",
) -> Image.Image:
    """Contact textures of several bodies on one scale.

    Args:
        bodies: name, grid and value of every fragment of each, NaN without contact.
        limits: values at the ends of the scale.
        quantity: name and unit of the values.
        title: of the sheet.
        palette: name of the palette.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    tiles = [tile for body in bodies for tile in contact_tiles(*body, *limits, palette)]
    low, high = limits
    ticks, span = nice_ticks(low, high), max(high - low, 1e-9)
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 1
    marks = tuple(((t - low) / span, label(t, decimals)) for t in ticks)
    bar = ColourBar(palette_table(palette), marks, f"{quantity}; grey: no contact")
    return sheet(tiles, bar, title)
