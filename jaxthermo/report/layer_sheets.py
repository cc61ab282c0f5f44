"""Sheets of depth layers and of contact textures, each with its legend."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from ..arrays import Scalar
from ..choices import Palette
from ..image.colour.annotate import write_png
from ..image.colour.palette import apply_palette
from ..image.colour.ticks import scale_ticks
from ..voxels.grid import VoxelGrid
from ..voxels.textures import (
    AXIS_COLOURS,
    depth_colours,
    layer_images,
    normal_colours,
    packed_images,
)
from .numbers import count
from .sheet import (
    ColourBar,
    Legend,
    Tile,
    colour_bar,
    enlarged,
    even_columns,
    sheet,
)


# Approximate longer edge of an enlarged small layer [px]: one voxel is one pixel.
_LAYER_EDGE = 300
# Width of a sheet of layers over its height, about that of a screen.
_SHEET_RATIO = 1.6
# sRGB of fragments without contact: dark, and in no palette.
_UNTOUCHED = (52, 55, 62)
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
        axis, content = name.split("_")
        word = "packed" if content == "packed" else "layer"
        tiles = [
            Tile(enlarged(image, _LAYER_EDGE), f"{axis} {word} {k}")
            for k, image in enumerate(images)
        ]
        if content == "depth":
            quantity = f"depth along +{axis} from the front of the lattice"
            bar = depth_bar(grid, axis=axis, quantity=quantity)
        else:
            bar = _legend(content)
        path = folder / f"layers_{name}.png"
        title = f"{grid.mesh.name}: {_TITLES[content].format(axis=axis)}"
        tall = max(tile.pixels.shape[0] for tile in tiles)
        wide = max(tile.pixels.shape[1] for tile in tiles)
        columns = even_columns(len(tiles), tall / wide, _SHEET_RATIO)
        write_png(path, sheet(tiles, bar=bar, title=title, columns=columns))
        paths.append(path)
    return paths


def depth_bar(grid: VoxelGrid, axis: str, quantity: str) -> ColourBar:
    """The scale of the depths of layers along an axis of the lattice [mm]."""
    depth = 1e3 * grid.pitch * grid.lattice.shape["xyz".index(axis)]
    return ColourBar(
        colours=depth_colours(np.linspace(0.0, 1.0, 256)),
        ticks=scale_ticks(0.0, depth),
        title=f"{quantity} [mm]; dark: no surface",
    )


def _legend(content: str) -> Legend:
    if content == "dominant":
        entries = zip(("x", "y", "z", "no area"), AXIS_COLOURS.tolist(), strict=True)
        return _of(entries, "dominant axis of the normal; dark: no surface")
    title = "outward normal n: red, green, blue are (n + 1) / 2; dark: no surface"
    return normal_legend(title)


def normal_legend(title: str, names: Sequence[str] = _WAYS) -> Legend:
    """Colours of normals along the axes of the lattice: +x, -x, +y, -y, +z, -z."""
    ways = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    return _of(zip(names, normal_colours(ways).tolist(), strict=True), title)


def _of(meanings, title: str) -> Legend:
    entries = tuple((text, (red, green, blue)) for text, (red, green, blue) in meanings)
    return Legend(entries, title)


def _contact_tiles(
    name: str,
    grid: VoxelGrid,
    values: Float[np.ndarray, " s"],
    low: Scalar,
    high: Scalar,
    palette: Palette = "iron",
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
    layer = grid.fragment_layer[:, 1]
    in_contact = ~np.isnan(values)
    images_by_axis = _contact_images(
        grid, values=values, low=low, high=high, palette=palette
    )
    for axis, images in images_by_axis.items():
        touching_layer = layer[grid.is_packed("xyz".index(axis)) & in_contact]
        for number in np.unique(touching_layer).tolist():
            fragments = int(np.count_nonzero(touching_layer == number))
            tile = Tile(
                pixels=enlarged(images[number], _LAYER_EDGE),
                label=f"{name}, {axis} layer {number}",
                note=count(fragments, "fragment") + " in contact",
            )
            tiles.append(tile)
    return tiles


def _contact_images(
    grid: VoxelGrid,
    values: Float[np.ndarray, " s"],
    low: Scalar,
    high: Scalar,
    palette: Palette,
) -> dict[str, list[UInt8[np.ndarray, "h w 3"]]]:
    """Packed layers in false colours, front layer first, by axes with any contact.

    They are those of the thesis, 5.3, figures 5.4 and 5.5.
    """
    column = apply_palette(
        values[:, None], low=low, high=high, name=palette, invalid=_UNTOUCHED
    )
    images = {}
    for axis, name in enumerate("xyz"):
        with_value = grid.is_packed(axis) & ~np.isnan(values)
        if with_value.any():
            last = int(grid.fragment_layer[with_value, 1].max())
            images[name] = packed_images(grid, axis, column[:, 0])[: last + 1]
    return images


def contact_texture_sheet(
    bodies: list[tuple[str, VoxelGrid, Float[np.ndarray, " s"]]],
    limits: tuple[float, float],
    quantity: str,
    title: str,
    palette: Palette = "iron",
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
    low, high = limits
    tiles = []
    for name, grid, values in bodies:
        tiles += _contact_tiles(
            name, grid=grid, values=values, low=low, high=high, palette=palette
        )
    bar = colour_bar(low, high, f"{quantity}; grey: no contact", palette)
    return sheet(tiles, bar=bar, title=title)
