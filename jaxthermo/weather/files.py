"""Weather files: EPW, and CSV with the units in the names of the columns."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..archive import check_regular
from ..errors import InputError
from ..text_encoding import decoded_text
from .epw import is_epw, read_epw
from .quantities import QUANTITIES, planes_of
from .rows import Row, check_increasing, fields_of
from .weather import Column, Remark, Weather, with_directions


_LONGEST_GAP = 3 * 3600.0
"""A longer interval between rows of a CSV file is a hole, not a coarse series [s]."""
_REMEDY = "give an EPW file, or CSV with the columns of docs/guide/outdoors.md"


def read_weather(path: Path, start: datetime) -> Weather:
    """The weather in an EPW file, recognized by its first word, or in a CSV file.

    An EPW file joins months of several years: they all count as the year of `start`,
    and those of a whole year as the next one, too.
    Its radiation is the mean over the hour before each time; it is assigned to the
    middle of that hour.

    Raises:
        InputError: for a file that cannot be read, with the line of the mistake.
    """
    text = _text(path)
    lines = text.split("\n")
    if is_epw(lines):
        return read_epw(path, lines, start)
    if path.suffix.lower() == ".epw":
        raise InputError(
            f"{path}: line 1 does not begin with LOCATION as that of an EPW file: "
            f"{_REMEDY}"
        )
    return _read_csv(path, lines, start, is_whole=text.endswith("\n"))


def _text(path: Path) -> str:
    check_regular(path, _REMEDY)
    try:
        content = path.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path}: cannot be read: {reason}; {_REMEDY}") from error
    if b"\0" in content:
        raise InputError(f"{path}: not a text, or damaged; {_REMEDY}")
    return decoded_text(content)


def _read_csv(
    path: Path, lines: Sequence[str], start: datetime, is_whole: bool
) -> Weather:
    names = _column_names(path, lines[0] if lines else "")
    rows = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        fields = fields_of(line)
        if len(fields) != len(names):
            raise InputError(
                f"{path}: line {number} has {len(fields)} columns, and line 1 names "
                f"{len(names)}; correct the line"
            )
        rows.append(Row(number, fields))
    time_column = names.index("time")
    times = np.array(
        [_moment(path, row.number, row.fields[time_column]) for row in rows]
    )
    check_increasing(path, [row.number for row in rows], times)
    columns = {}
    for quantity in (*QUANTITIES, *planes_of(names)):
        if quantity.csv in names:
            position = names.index(quantity.csv)
            columns[quantity.name] = Column(
                times=times,
                values=quantity.values(row.fields[position] for row in rows),
                name=quantity.csv,
                limits=quantity.limits,
            )
    return with_directions(
        Weather(
            source=str(path),
            covers=(times[0], times[-1]),
            columns=columns,
            zone=start.tzinfo or UTC,
            longest_gap=_LONGEST_GAP,
            remarks=() if is_whole else _cut_remark(times),
        )
    )


def _column_names(path: Path, head: str) -> list[str]:
    names = fields_of(head)
    needed = [quantity.csv for quantity in QUANTITIES if not quantity.is_optional]
    needed.append("time")
    lacking = sorted(set(needed) - set(names))
    if lacking:
        raise InputError(
            f"{path}: column '{lacking[0]}' is missing in line 1; needed are "
            f"{', '.join(sorted(needed))}, separated by commas; or give an EPW file"
        )
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: column '{twice[0]}' is there twice: remove one")
    return names


def _cut_remark(times: Float[np.ndarray, " t"]) -> tuple[Remark, ...]:
    # What is left of a number that is cut is a number.
    text = "the last line has no end of line: check that it was not cut short"
    return (Remark(float(times[-2]), float(times[-1]), text),)


def _moment(path: Path, line: int, text: str) -> float:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise InputError(
            f"{path}: line {line}: time '{text}' is not a date and time with a zone, "
            "such as 2026-06-21T12:00+02:00"
        )
    return moment.timestamp()
