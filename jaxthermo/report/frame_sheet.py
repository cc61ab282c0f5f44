"""Contact sheet of frames: all on one scale, which is drawn once."""

from collections.abc import Iterable, Sequence
from datetime import datetime

import numpy as np
from jaxtyping import UInt8
from PIL import Image as Pictures
from PIL.Image import Image as Picture

from ..choices import Palette, Quantity
from ..errors import InputError
from ..image.colour.frame_values import QUANTITIES
from ..image.colour.picture import coloured
from ..image.colour.ticks import time_label, to_celsius
from ..image.radiance.image import Image
from .sheet import Tile, colour_bar, even_columns, sheet


_MAX_TILES = 48
"""Largest number of frames on a sheet: more are too small to be read."""
# Width of a sheet over its height.
_SHEET_RATIO = 1.5
# Longer edge of a frame on a sheet [pixels].
_MAX_EDGE = 640
# Longer edge of a sheet [pixels].
_MAX_SHEET = 4096


def shown_on_sheet(count: int) -> list[int]:
    """Indices of the frames on a sheet, all or evenly spaced ones, first and last."""
    if count <= _MAX_TILES:
        return list(range(count))
    return np.rint(np.linspace(0, count - 1, _MAX_TILES)).astype(int).tolist()


def frame_sheet(
    images: Iterable[Image],
    low: float,
    high: float,
    palette: Palette = "iron",
    quantity: Quantity = "apparent",
    title: str = "",
) -> Picture:
    """Arrange frames on one sheet with their times and their common scale.

    Of more than 48 frames, evenly spaced ones of the list are shown, and the sheet says
    so. The scale has a pointed end where temperatures in these frames lie beyond it.

    Args:
        images: the frames, of one size.
        low: temperature at the lower end of the scale [K].
        high: temperature at the upper end [K].
        palette: name of the palette.
        quantity: "apparent" (as of a camera) or "surface" (the true temperature).
        title: above the frames.

    Raises:
        InputError: without a frame, for frames of several sizes or of temperatures
            that are not finite, an unknown quantity or palette, or limits not in order.
    """
    frames = list(images)
    sizes = {np.shape(image.object_id) for image in frames}
    if len(sizes) != 1:
        found_sizes = ", ".join(f"{w} x {h}" for h, w in sorted(sizes)) or "none"
        raise InputError(
            f"frame_sheet(images=): {found_sizes}: give frames of one size"
        )
    shown_frames = [frames[k] for k in shown_on_sheet(len(frames))]
    coloured_frames = [
        coloured(image, low=low, high=high, palette=palette, quantity=quantity)
        for image in shown_frames
    ]
    times = [float(image.time) for image in shown_frames]
    below, above = zip(*(frame.beyond for frame in coloured_frames), strict=True)
    return tile_sheet(
        [frame.colours for frame in coloured_frames],
        times=times,
        total=len(frames),
        beyond=(any(below), any(above)),
        low=low,
        high=high,
        palette=palette,
        quantity=quantity,
        title=title,
    )


def tile_sheet(
    tiles: Sequence[UInt8[np.ndarray, "h w 3"]],
    times: Sequence[float],
    total: int,
    beyond: tuple[bool, bool],
    low: float,
    high: float,
    palette: Palette,
    quantity: str,
    title: str = "",
    start: datetime | None = None,
) -> Picture:
    """Arrange frames that are coloured already; arguments as of `frame_sheet`.

    Args:
        tiles: frames of one size, as from `coloured`.
        times: of the frames [s].
        total: number of all frames, of which these are some.
        beyond: flags of temperatures below `low` and above `high` in the frames.
        low: temperature of the coldest colour [K].
        high: temperature of the hottest colour [K].
        palette: name of the palette.
        quantity: "apparent" or "surface", for the name of the scale.
        title: above the frames.
        start: date and time at 0 s, which adds the time of day.
    """
    height, width = tiles[0].shape[:2]
    columns = even_columns(len(tiles), height / width, _SHEET_RATIO)
    edge = min(_MAX_EDGE, _MAX_SHEET // columns)
    labelled = [
        Tile(_smaller(tile, edge), time_label(time, start))
        for tile, time in zip(tiles, times, strict=True)
    ]
    words = f"{QUANTITIES[quantity]} [\N{DEGREE SIGN}C]"
    bar = colour_bar(to_celsius(low), to_celsius(high), words, palette, beyond)
    if len(tiles) < total:
        subset = f"{len(tiles)} of {total} frames"
        title = f"{title}: {subset}" if title else subset
    return sheet(labelled, bar=bar, title=title, columns=columns)


def _smaller(pixels: UInt8[np.ndarray, "h w 3"], edge: int) -> UInt8[np.ndarray, "..."]:
    factor = edge / max(pixels.shape[:2])
    if factor >= 1:
        return pixels
    height, width = (max(1, round(factor * side)) for side in pixels.shape[:2])
    picture = Pictures.fromarray(np.ascontiguousarray(pixels))
    return np.asarray(picture.resize((width, height), Pictures.Resampling.BOX))
