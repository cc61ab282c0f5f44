"""Colours, font and sizes that all annotated pictures have in common."""

import math
import unicodedata
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from PIL import ImageFont


PAPER = (16, 17, 20)
INK = (236, 236, 238)
FAINT = (158, 160, 168)
FRAME = (74, 76, 84)
"""sRGB of frames; above those of paper, text, and text of lesser weight."""

_MORE_LETTERS = "".join(
    ("\N{DEGREE SIGN}", "\N{PLUS-MINUS SIGN}", "\N{HORIZONTAL ELLIPSIS}")
)
"""Letters of Pillow's font that ASCII lacks."""
_IN_ASCII = {
    "\N{LATIN SMALL LETTER SHARP S}": "ss",
    "\N{EN DASH}": "-",
    "\N{MICRO SIGN}": "u",
    "\N{MULTIPLICATION SIGN}": "x",
}


def drawable(text: str) -> str:
    """Replace letters that would be drawn as a box: by their base letter, or "?"."""
    return "".join(map(_drawable, text))


def _drawable(letter: str) -> str:
    if letter.isascii() or letter in _MORE_LETTERS:
        return letter
    # An accent follows its letter as a mark of its own.
    decomposed = _IN_ASCII.get(letter) or unicodedata.normalize("NFKD", letter)
    return "".join(character for character in decomposed if character.isascii()) or "?"


@dataclass(frozen=True)
class Layout:
    """Sizes that follow from those of the image [pixels]."""

    font: ImageFont.FreeTypeFont | ImageFont.ImageFont
    text: int
    gap: int
    line: int
    tip: int
    """Height of the points at the ends of a scale."""

    @classmethod
    def of(cls, height: int, width: int) -> "Layout":
        """The sizes for an image of `height` x `width`."""
        # By the height, but with smaller labels next to a narrow image.
        side = math.sqrt(height * min(width, 2 * height))
        text = min(max(round(side / 28), 10), 96)
        return cls(
            font=ImageFont.load_default(size=text),
            text=text,
            gap=max(4, round(0.7 * text)),
            line=max(1, round(text / 14)),
            tip=max(5, round(0.6 * text)),
        )

    def width(self, text: str) -> int:
        """Width of a text, rounded up so that no letter is cut."""
        return math.ceil(self.font.getlength(text))

    def shorten(self, text: str, room: int) -> str:
        """The text, or its longest start that fits into `room`, with an ellipsis.

        Letters that the font lacks are replaced.
        """
        text = drawable(text)
        if self.width(text) <= room:
            return text
        while text and self.width(text + "\N{HORIZONTAL ELLIPSIS}") > room:
            text = text[:-1]
        return text.rstrip() + "\N{HORIZONTAL ELLIPSIS}" if text else ""


def averaged(
    colours: UInt8[np.ndarray, "H W 3"] | Float[np.ndarray, "H W 3"], samples: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Pixels as means of their samples, `samples` along each axis."""
    # Sample by sample: numpy is slow at means along short axes. Sums are exact.
    total = np.zeros((1, 1, 1))
    for row in range(samples):
        for column in range(samples):
            total = total + colours[row::samples, column::samples]
    return np.rint(total / samples**2).astype(np.uint8)
