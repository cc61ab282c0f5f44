"""Frames in text files, as programs of cameras and spreadsheets write them.

A frame is a block of lines with equally many numbers. Lines above it, with settings of
the camera, are left out, and so are lines that begin with #. Numbers are separated by
semicolons, tabs, commas or spaces, with a point or a comma before their decimals.
"""

import codecs
import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...text_encoding import decoded_text


_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

_SEPARATORS = ";\t, "

_Row = list[float] | None
"""Numbers of a line; None for a line of anything else."""


class _Line(NamedTuple):
    """A line of a file that is neither empty nor a comment."""

    number: int
    """Number of the line in the file, from 1."""
    text: str


def read_csv_numbers(path: Path) -> Float[np.ndarray, "h w"]:
    """Read the numbers of a frame in a text file.

    Raises:
        ValueError: for a file without numbers, of rows of several lengths, or with
            text below or between the rows.
    """
    lines = _lines(_text(path.read_bytes()))
    # Lines above a frame may have other separators than its rows.
    parsed = [_rows(lines, separator) for separator in _SEPARATORS]
    rows = max(parsed, key=_number_count)
    numeric = [k for k, row in enumerate(rows) if row is not None]
    if not numeric:
        raise ValueError("it has no numbers")
    first = numeric[0]
    frame: list[list[float]] = []
    for line, row in zip(lines[first:], rows[first:], strict=True):
        if row is None:
            raise ValueError(
                f"line {line.number}, {line.text[:40]!r}, below rows of numbers is "
                "none: a file has one frame"
            )
        if frame and len(row) != len(frame[0]):
            raise ValueError(
                f"line {line.number} has {len(row)} numbers and line "
                f"{lines[first].number} has {len(frame[0])}"
            )
        frame.append(row)
    return np.array(frame)


def _text(content: bytes) -> str:
    if content.startswith(_UTF_16):
        return content.decode("utf-16")
    return decoded_text(content)


def _lines(text: str) -> list[_Line]:
    """All lines but comments and empty ones."""
    stripped = [line.strip() for line in text.splitlines()]
    return [
        _Line(number, line)
        for number, line in enumerate(stripped, start=1)
        if line and not line.startswith("#")
    ]


def _rows(lines: list[_Line], separator: str) -> list[_Row]:
    texts = [line.text for line in lines]
    spaced = separator == " "
    cells = csv.reader(texts, delimiter=separator, skipinitialspace=spaced)
    return [_numbers(row) for row in cells]


def _numbers(cells: list[str]) -> _Row:
    # Some programs end each row with a separator.
    if len(cells) > 1 and not cells[-1].strip():
        cells = cells[:-1]
    try:
        return [float(cell.replace(",", ".")) for cell in cells]
    except ValueError:
        return None


def _number_count(rows: list[_Row]) -> int:
    return sum(len(row) for row in rows if row is not None)
