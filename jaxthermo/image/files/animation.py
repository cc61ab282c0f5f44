"""Animations of pictures: APNG, GIF, and MP4 with the package av (an extra)."""

import functools
import importlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image as Pictures
from PIL.Image import Image as Picture

from ...atomic import replacing
from ...choices import Palette
from ...errors import InputError, shortened
from ...extras import require_extra
from ..colour.canvas import FAINT, FRAME, INK, PAPER
from ..colour.palette import BACKGROUND, ENTRIES, palette_table


ANIMATIONS = {"apng": ".png", "gif": ".gif", "mp4": ".mp4"}
"""Kinds of animations, and the end of the name of each."""

_KINDS = {".png": "apng", ".apng": "apng", ".gif": "gif", ".mp4": "mp4"}
MAX_BYTES = 2**31
"""Pictures that an APNG or a GIF holds in memory until all are there [bytes]."""
MAX_RATE = 100.0
"""More frames a second than any viewer shows; the units of a GIF are 10 ms [1/s]."""
# Colours of a GIF for the palette; the others are for texts, edges and isotherms.
_GIF_SCALE = 200
_GIF_COLOURS = 256
_ENCODER = "libx264"
_QUALITY = {"crf": "16", "preset": "medium"}
"""Options of the encoder: a crf of 18 looks as the original, a lower one is better."""
_BT709 = 1
"""Number of the colour matrix of high-definition video in its standards."""


def default_rate(count: int) -> float:
    """Frames a second at which that many last ten seconds, from 2 to 25 [1/s]."""
    return min(max(count / 10.0, 2.0), 25.0)


def check_animation(file_format: str) -> None:
    """Check that animations of a kind can be made, before a long run.

    Raises:
        InputError: for an unknown kind, or MP4 without the package av.
    """
    if file_format not in ANIMATIONS:
        raise InputError(f"animation {file_format!r}: choose {', '.join(ANIMATIONS)}")
    if file_format == "mp4":
        require_extra(
            "an animation as MP4 needs",
            package="av",
            extra="video",
            otherwise="choose apng or gif",
        )


def write_animation(
    path: str | Path,
    pictures: Iterable[Picture | UInt8[np.ndarray, "h w 3"]],
    rate: float | None = None,
    palette: Palette | None = None,
) -> int:
    """Write pictures as an animation, of the kind that the end of the name says.

    An APNG is exact, `.png` or `.apng`. A GIF has 256 colours, of one table for all
    pictures and without dither, `.gif`. An MP4 is small and nearly exact, `.mp4`.

    Args:
        path: of the file.
        pictures: of one size, as from `picture`, or arrays of sRGB.
        rate: pictures a second [1/s]; ten seconds in all if None, from 2 to 25, for
            which the pictures must be a sequence.
        palette: of the pictures, whose colours a GIF keeps; found from the first
            picture if None.

    Returns:
        The number of pictures.

    Raises:
        InputError: for an unknown kind or rate, no pictures or several sizes of them,
            MP4 without the package av, or if the file cannot be written.
    """
    path = Path(path)
    file_format = _KINDS.get(path.suffix.lower())
    if file_format is None:
        raise InputError(f"{path}: name an animation .png (APNG), .gif or .mp4")
    check_animation(file_format)
    if rate is None:
        pictures = list(pictures)
        rate = default_rate(len(pictures))
    if not 0.0 < rate <= MAX_RATE:
        raise InputError(f"rate={rate}: give pictures a second, from 0 to {MAX_RATE:g}")
    write: Callable[..., int]
    write = {"apng": _write_apng, "gif": _write_gif, "mp4": _write_mp4}[file_format]
    if file_format == "gif":
        write = functools.partial(write, palette=palette)
    counted = _Counted(pictures, path, limited=file_format != "mp4")
    with replacing(path) as temporary:
        write(temporary, iter(counted), rate)
    return counted.count


class _Counted:
    """Pictures as RGB, checked one after another."""

    def __init__(self, pictures: Iterable[Any], path: Path, limited: bool):
        self._pictures = pictures
        self._path = path
        self._limited = limited
        self.count = 0

    def __iter__(self) -> Iterator[Picture]:
        first: tuple[int, int] | None = None
        for picture in self._pictures:
            frame = self._checked(picture)
            first = first or frame.size
            if frame.size != first:
                raise InputError(
                    f"{self._path}: picture {self.count} is of {frame.width} x "
                    f"{frame.height} pixels and the first of {first[0]} x {first[1]}: "
                    "give one size"
                )
            self.count += 1
            if self._limited and 3 * self.count * math.prod(first) > MAX_BYTES:
                raise InputError(
                    f"{self._path}: more than {self.count - 1} pictures of this size "
                    "do not fit into memory: write an MP4, or fewer pictures"
                )
            yield frame
        if first is None:
            raise InputError(f"{self._path}: an animation needs at least one picture")

    def _checked(self, picture: Any) -> Picture:
        if isinstance(picture, Picture):
            return picture.convert("RGB")
        pixels = np.asarray(picture)
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
            raise InputError(
                f"{self._path}: picture {self.count} is {shortened(picture)}: give "
                "pictures as of `picture`, or arrays [h, w, 3] of uint8"
            )
        return Pictures.fromarray(np.ascontiguousarray(pixels))


def _write_apng(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    first = next(pictures)
    # Pillow goes over them twice.
    how = {"save_all": True, "append_images": list(pictures), "loop": 0}
    first.save(path, format="PNG", duration=1000.0 / rate, **how)


def _write_gif(
    path: Path, pictures: Iterator[Picture], rate: float, palette: Palette | None
) -> None:
    first = next(pictures)
    colours = _gif_colours(first, palette)

    def reduced(picture: Picture) -> Picture:
        return picture.quantize(palette=colours, dither=Pictures.Dither.NONE)

    how = {"save_all": True, "append_images": map(reduced, pictures), "loop": 0}
    # Pillow's optimisation would give each picture its own order of colours.
    how |= {"duration": 1000.0 / rate, "optimize": False, "disposal": 1}
    reduced(first).save(path, format="GIF", **how)


def _gif_colours(first: Picture, palette: Palette | None) -> Picture:
    # One table for all pictures: the same temperature has one colour throughout, also
    # where the first one does not show it.
    if palette is None:
        return first.quantize(_GIF_COLOURS, dither=Pictures.Dither.NONE)
    even = np.rint(np.linspace(0, ENTRIES - 1, _GIF_SCALE)).astype(int)
    table = [tuple(colour) for colour in palette_table(palette)[even].tolist()]
    paper = np.array(PAPER)
    ink = np.array(INK)
    greys = [np.rint(paper + f * (ink - paper)) for f in np.linspace(0, 1, 16)]
    table += [PAPER, INK, FAINT, FRAME, BACKGROUND]
    table += [tuple(grey.astype(int).tolist()) for grey in greys]
    table = list(dict.fromkeys(table))
    # Colours of edges, isotherms and anything else in the first picture.
    quantized = first.quantize(_GIF_COLOURS - len(table), dither=Pictures.Dither.NONE)
    extra_colours = np.array(quantized.getpalette(), np.uint8).reshape(-1, 3).tolist()
    table = list(dict.fromkeys([*table, *map(tuple, extra_colours)]))[:_GIF_COLOURS]
    palette_image = Pictures.new("P", (1, 1))
    palette_image.putpalette([channel for colour in table for channel in colour])
    return palette_image


def _write_mp4(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    # By name: help and frames do without it.
    av = importlib.import_module("av")
    av.logging.set_level(None)
    first = next(pictures)
    # The colours of neighbours are shared in twos: with an odd edge none is left over.
    width, height = (edge + edge % 2 for edge in first.size)
    with av.open(str(path), "w", format="mp4") as file:
        steps = Fraction(rate).limit_denominator(1000)
        stream = file.add_stream(_ENCODER, rate=steps, options=_QUALITY)
        stream.width = width
        stream.height = height
        stream.pix_fmt = "yuv420p"
        stream.codec_context.colorspace = _BT709
        for picture in itertools.chain([first], pictures):
            canvas = Pictures.new("RGB", (width, height), PAPER)
            canvas.paste(picture)
            frame = av.VideoFrame.from_image(canvas)
            frame = frame.reformat(format="yuv420p", dst_colorspace=_BT709)
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
