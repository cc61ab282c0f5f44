"""Rows of weather files."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import InputError


class Row(NamedTuple):
    """A row of a table."""

    number: int
    """Number of its line in the file."""
    fields: list[str]


def fields_of(line: str) -> list[str]:
    """Texts between the commas of a line; commas in quotes do not count."""
    # Line by line, so that a quote that is never closed ends with its line.
    try:
        (fields,) = csv.reader([line], skipinitialspace=True)
    except (csv.Error, ValueError):
        return []
    return [field.strip() for field in fields]


def check_increasing(
    path: Path, lines: Sequence[int], times: Float[np.ndarray, " t"]
) -> None:
    """Refuse a table whose rows are not in the order of their times.

    Args:
        path: of the file.
        lines: number of the line of each row.
        times: of the rows [s].

    Raises:
        InputError: with the line of the first row that is not later than its
            predecessor, or for fewer than two rows.
    """
    if len(times) < 2:
        raise InputError(f"{path}: has {len(times)} rows: give two at least")
    backward = np.flatnonzero(np.diff(times) <= 0)
    if len(backward):
        raise InputError(
            f"{path}: line {lines[backward[0] + 1]} is not later than the one before it"
        )
