"""Colours, font and sizes that all annotated pictures have in common."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from PIL import ImageFont


PAPER = (16, 17, 20)
INK = (236, 236, 238)
FAINT = (158, 160, 168)
FRAME = (74, 76, 84)
"""sRGB of what is not the picture itself: paper, text, lesser text, and frames."""


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
        # By the height, but with smaller labels beside a narrow image.
        side = math.sqrt(height * min(width, 2 * height))
        text = min(max(round(side / 28), 10), 96)
        return cls(
            ImageFont.load_default(size=text),
            text,
            max(4, round(0.7 * text)),
            max(1, round(text / 14)),
            max(5, round(0.6 * text)),
        )

    def width(self, text: str) -> int:
        """Width of a text, rounded up so that no letter is cut."""
        return math.ceil(self.font.getlength(text))

    def shorten(self, text: str, room: int) -> str:
        """The text, or as much of its start as fits into `room`, with an ellipsis."""
        if self.width(text) <= room:
            return text
        while text and self.width(text + "\N{HORIZONTAL ELLIPSIS}") > room:
            text = text[:-1]
        return text.rstrip() + "\N{HORIZONTAL ELLIPSIS}" if text else ""


def averaged(
    colours: UInt8[np.ndarray, "H W 3"] | Float[np.ndarray, "H W 3"], samples: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Pixels as means of their samples, `samples` along each axis."""
    height, width, _ = colours.shape
    shape = height // samples, samples, width // samples, samples, 3
    return np.rint(colours.reshape(shape).mean(axis=(1, 3))).astype(np.uint8)
