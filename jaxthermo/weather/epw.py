"""Weather files of EnergyPlus (EPW): a place, and a row for every hour of some months.

Each row has the time at the end of its hour, in hours from 1 to 24 of the standard time
of the place. A file of a whole year goes on with 1 January after 31 December. Source:
EnergyPlus, Auxiliary Programs, "EnergyPlus Weather File (EPW) Data Dictionary".
"""

import calendar
import math
from collections.abc import Sequence
from datetime import MAXYEAR, datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import InputError, located
from .quantities import CLOUD_COVER, QUANTITIES, TOTAL_COVER, Quantity
from .rows import Row, check_increasing, fields_of
from .sun_position import Place
from .weather import Column, Remark, Weather, with_directions


_HOUR = 3600.0
_DAY = 24 * _HOUR
# Old files leave out the last four columns, which are of albedo and rain.
_FEWEST_COLUMNS = 31
_MOST_COLUMNS = 35
_LEAP_DAY = (2, 29)
_YEAR_WITH_LEAP_DAY = 2024


def is_epw(lines: Sequence[str]) -> bool:
    """True for the lines of an EPW file, by its first word."""
    first = fields_of(lines[0])[:1] if lines else []
    return [word.upper() for word in first] == ["LOCATION"]


class _Site(NamedTuple):
    """The place of a file, and the zone of its times."""

    place: Place
    zone: timezone


class _Hour(NamedTuple):
    """A row of an EPW file, with its time."""

    date: tuple[int, int]
    """Month and day."""
    hour: int
    """Hour of the day at its end, 1 to 24, or 0 to 23 in some files."""
    row: Row


class _Year(NamedTuple):
    """The hours of a file in one year."""

    hours: list[_Hour]
    ends: Float[np.ndarray, " t"]
    """Ends of the hours since 1970-01-01 UTC [s]."""
    is_whole: bool
    """True if they begin with the year and end with it."""
    remarks: list[Remark]


def read_epw(path: Path, lines: Sequence[str], start: datetime) -> Weather:
    """The weather in the lines of an EPW file, as that of the year of `start`.

    Hours from 0 to 23 count as 1 to 24. A year without 29 February leaves that day out;
    a leap year repeats 28 February where the file has no other. A file of a whole year
    is that of the next year, too.

    Raises:
        InputError: for lines that cannot be read.
    """
    site = _site(path, lines[0])
    hours = _hours(path, lines)
    # In the zone of the file, where the start may be in another year.
    number = start.astimezone(site.zone).year
    years = [_year(path, hours, number, site.zone)]
    remarks = [*years[0].remarks]
    if years[0].is_whole and number < MAXYEAR:
        years.append(_year(path, hours, number + 1, site.zone))
        text = "ends with its year: after 31 December it is repeated from 1 January on"
        remarks.append(Remark(years[0].ends[-1], years[1].ends[-1], text))
        remarks += years[1].remarks
    ends = np.concatenate([year.ends for year in years])
    if any(hour.hour == 0 for hour in hours):
        text = "has hours from 0 to 23: they are read as 1 to 24, the ends of hours"
        remarks.append(Remark(ends[0], ends[-1], text))
    rows = [hour.row.fields for year in years for hour in year.hours]
    columns = {quantity.name: _column(quantity, rows, ends) for quantity in QUANTITIES}
    opaque = columns[CLOUD_COVER.name]
    total = _column(TOTAL_COVER, rows, ends)
    cover = np.where(np.isfinite(opaque.values), opaque.values, total.values)
    columns[CLOUD_COVER.name] = opaque._replace(values=cover)
    return with_directions(
        Weather(
            source=str(path),
            covers=(ends[0] - _HOUR, ends[-1]),
            columns=columns,
            zone=site.zone,
            longest_gap=1.5 * _HOUR,
            place=site.place,
            remarks=tuple(remarks),
        )
    )


def _site(path: Path, line: str) -> _Site:
    fields = fields_of(line)
    if len(fields) < 10:
        raise InputError(
            f"{path}: line 1 has {len(fields)} columns: LOCATION needs 10, with the "
            "latitude, longitude, time zone and altitude as the last four"
        )
    names = ("latitude", "longitude", "time zone", "altitude")
    numbers = []
    for name, text in zip(names, fields[6:10], strict=True):
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise InputError(
                f"{path}: line 1: {name} '{text}' is no number: correct it"
            )
        numbers.append(number)
    latitude, longitude, zone, altitude = numbers
    if not -12 <= zone <= 14:
        raise InputError(
            f"{path}: line 1: time zone {zone:g} is not from -12 to 14 h: correct it"
        )
    with located(f"{path}: line 1"):
        place = Place(latitude, longitude=longitude, altitude=altitude)
    return _Site(place=place, zone=timezone(timedelta(hours=zone)))


def _hours(path: Path, lines: Sequence[str]) -> list[_Hour]:
    """Rows of a file with their times, as the file has them."""
    # Some files end with the mark of the end of a text in MS-DOS.
    rows = [
        Row(number, fields_of(line))
        for number, line in enumerate(lines, 1)
        if line.strip("\x1a \t")
    ]
    # The lines before, of which there are mostly eight, begin with words.
    is_number = [row.fields[:1] != [] and row.fields[0].isdecimal() for row in rows]
    first = is_number.index(True) if any(is_number) else len(rows)
    _check_period(path, rows[:first])
    hours = [_hour(path, row) for row in rows[first:]]
    for hour in hours:
        count = len(hour.row.fields)
        expected = len(hours[0].row.fields)
        if count != expected:
            raise InputError(
                f"{path}: line {hour.row.number} has {count} columns, and line "
                f"{hours[0].row.number} has {expected}: the file is damaged or cut "
                "short; correct the line"
            )
    labels = {hour.hour for hour in hours}
    if {0, 24} <= labels:
        raise InputError(
            f"{path}: has hours 0 and 24, which are one time: number them from 1 to 24"
        )
    return hours


def _check_period(path: Path, header: Sequence[Row]) -> None:
    """Refuse rows at shorter intervals than an hour."""
    for row in header:
        word, _, rows_per_hour = [*row.fields, "", "", ""][:3]
        if word.upper() == "DATA PERIODS" and rows_per_hour not in ("1", ""):
            raise InputError(
                f"{path}: line {row.number}: has '{rows_per_hour}' rows an hour, whose "
                "radiation may be that of the hour or of the row: give hourly rows, or "
                "CSV with the columns of docs/guide/outdoors.md"
            )


def _hour(path: Path, row: Row) -> _Hour:
    fields = row.fields
    while len(fields) > _MOST_COLUMNS and not fields[-1]:
        fields = fields[:-1]
    if not _FEWEST_COLUMNS <= len(fields) <= _MOST_COLUMNS:
        raise InputError(
            f"{path}: line {row.number} has {len(fields)} columns: rows of an EPW file "
            f"have {_FEWEST_COLUMNS} to {_MOST_COLUMNS}; correct the line"
        )
    try:
        month, day, hour = (int(text) for text in fields[1:4])
        # Checks the date, for which the year does not matter.
        datetime(_YEAR_WITH_LEAP_DAY, month, day)
        is_valid = 0 <= hour <= 24
    except (ValueError, OverflowError):
        is_valid = False
    if not is_valid:
        raise InputError(
            f"{path}: line {row.number}: month, day and hour are "
            f"'{', '.join(fields[1:4])}': correct them"
        )
    return _Hour(date=(month, day), hour=hour, row=Row(row.number, fields))


def _year(path: Path, hours: list[_Hour], number: int, zone: timezone) -> _Year:
    """The hours of a file in the year of a number."""
    remarks = []
    if calendar.isleap(number):
        hours, repeats = _with_leap_day(hours)
        if repeats:
            day = datetime(number, *_LEAP_DAY, tzinfo=zone).timestamp()
            text = "has no 29 February: 28 February is repeated"
            remarks.append(Remark(day, day + _DAY, text))
    else:
        hours = [hour for hour in hours if hour.date != _LEAP_DAY]
    ends = _ends(path, hours, number, zone)
    begin = datetime(number, 1, 1, tzinfo=zone).timestamp()
    days = 366 if calendar.isleap(number) else 365
    is_whole = ends[0] - _HOUR <= begin and ends[-1] >= begin + days * _DAY
    return _Year(hours=hours, ends=ends, is_whole=bool(is_whole), remarks=remarks)


def _with_leap_day(hours: list[_Hour]) -> tuple[list[_Hour], bool]:
    """Add 29 February as a copy of the day before; False if nothing was added."""
    before = [hour for hour in hours if hour.date == (2, 28)]
    dates = [hour.date for hour in hours]
    if _LEAP_DAY in dates or len(before) < 24 or (3, 1) not in dates:
        return hours, False
    next_day = dates.index((3, 1))
    repeated = [hour._replace(date=_LEAP_DAY) for hour in before]
    return hours[:next_day] + repeated + hours[next_day:], True


def _ends(
    path: Path, hours: Sequence[_Hour], year: int, zone: timezone
) -> Float[np.ndarray, " t"]:
    """Ends of the hours since 1970-01-01 UTC [s]."""
    first_hour = 0 if any(hour.hour == 0 for hour in hours) else 1
    dates = {hour.date for hour in hours}
    midnight = {
        (month, day): datetime(year, month, day, tzinfo=zone).timestamp()
        for month, day in dates
    }
    ends = [
        midnight[hour.date] + _HOUR * (hour.hour + 1 - first_hour) for hour in hours
    ]
    times = np.array(ends, float)
    check_increasing(path, lines=[hour.row.number for hour in hours], times=times)
    return times


def _column(
    quantity: Quantity, rows: Sequence[Sequence[str]], ends: Float[np.ndarray, " t"]
) -> Column:
    return Column(
        times=ends - _HOUR / 2 if quantity.is_mean else ends,
        values=quantity.values(row[quantity.position] for row in rows),
        name=quantity.epw,
        limits=quantity.limits,
    )
