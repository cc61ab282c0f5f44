"""Columns of numbers over time, as CSV."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..atomic import write_text


def write_columns(
    path: Path, times: Sequence[float], columns: dict[str, np.ndarray]
) -> None:
    """Write columns of numbers at times [s] as CSV, in one step; NaN is left empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time_s", *columns])
    rows = zip(times, *columns.values(), strict=True)
    writer.writerows([_number(value) for value in row] for row in rows)
    write_text(path, text.getvalue())


def _number(value: float) -> str:
    # Nine digits distinguish all float32 numbers.
    return "" if np.isnan(value) else f"{value:.9g}"
