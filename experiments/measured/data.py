"""The measured series, from the folder in `JAXTHERMO_MEASURED`."""

import csv
import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxthermo.constants import ZERO_CELSIUS


VARIABLE = "JAXTHERMO_MEASURED"

Columns = Mapping[str, Float[np.ndarray, " t"]]
"""Columns of a file by name; NaN where there is no value."""


def folder() -> Path | None:
    """The folder of the measured series; None where none is named."""
    path = os.environ.get(VARIABLE)
    return Path(path) if path else None


def read_module(name: str) -> Columns:
    """Columns of a module's file, with `day`, `hour` of the day, and `time` [s].

    Days that are apart follow each other, as in one run; `time` counts from the first
    row.
    """
    rows = _rows(name)
    dates = [datetime.fromisoformat(row["time"]) for row in rows]
    number = {date: n for n, date in enumerate(sorted({d.date() for d in dates}))}
    day = np.array([number[date.date()] for date in dates])
    clock = np.array([3600.0 * d.hour + 60.0 * d.minute + d.second for d in dates])
    order = np.argsort(day, kind="stable")
    columns = {name: values[order] for name, values in _columns(rows).items()}
    time = (86400.0 * day + clock)[order]
    hour = clock[order] / 3600
    return {**columns, "day": day[order], "hour": hour, "time": time - time[0]}


def read_table(name: str) -> Columns:
    """Columns of a file whose first one is `time_s`."""
    return _columns(_rows(name))


def kelvin(celsius: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Temperatures in kelvin."""
    return celsius + ZERO_CELSIUS


def _rows(name: str) -> list[dict[str, str]]:
    path = folder()
    assert path is not None
    with (path / name).open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def _columns(rows: list[dict[str, str]]) -> Columns:
    return {
        key: np.array([float(row[key] or "nan") for row in rows])
        for key in rows[0]
        if key != "time"
    }
