"""Text of mesh files: its encoding, line ends and numbers."""

import codecs
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ...text_encoding import decoded_text
from .file_mesh import FileFault


_MARKED_ENCODINGS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def decoded(data: bytes) -> str:
    """Text without a byte order mark, whose lines end in a line feed."""
    return decoded_text(without_mark(data))


def without_mark(data: bytes) -> bytes:
    """Bytes without a byte order mark, in UTF-8 if they have one."""
    for mark, encoding in _MARKED_ENCODINGS:
        if data.startswith(mark):
            return data.decode(encoding, "replace").encode()
    return data


def floats(words: Sequence[str]) -> Float[np.ndarray, " n"]:
    """Words as floating-point numbers.

    Raises:
        FileFault: for a word that is no number.
    """
    try:
        return np.array(words, np.float64)
    except ValueError as error:
        raise FileFault(f"a number cannot be read ({error})") from error


def integers(words: Sequence[str]) -> Int[np.ndarray, " n"]:
    """Words as whole numbers.

    Raises:
        FileFault: for a word that is no whole number, or a large one.
    """
    try:
        return np.array(words, np.int64)
    except (ValueError, OverflowError) as error:
        raise FileFault(f"a whole number cannot be read ({error})") from error


def positions(rows: Sequence[Sequence[str]]) -> Float[np.ndarray, "v 3"]:
    """The first three numbers of each row.

    Raises:
        FileFault: for a row of fewer than three numbers.
    """
    for number, row in enumerate(rows, start=1):
        if len(row) < 3:
            raise FileFault(f"vertex {number} has fewer than three coordinates")
    words = [word for row in rows for word in row[:3]]
    return floats(words).reshape(-1, 3)
