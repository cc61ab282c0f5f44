"""Weather files: EPW by pvlib, and CSV with the units in the names of the columns."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any, NamedTuple

import lazy_loader
import numpy as np

from ..constants import ZERO_CELSIUS
from ..errors import InputError
from .sun_position import require_pvlib
from .weather import Column, Weather


_pvlib: Any = lazy_loader.load("pvlib")
_pandas: Any = lazy_loader.load("pandas")

_HOUR = 3600.0


class _Quantity(NamedTuple):
    """A quantity, with its column in both formats."""

    name: str
    csv: str
    epw: str
    missing: float
    """Smallest number that stands for no value in an EPW file."""
    lowest: float
    """Smallest valid number, in the unit of the file."""
    to_si: Callable[[np.ndarray], np.ndarray] = lambda values: values
    is_mean: bool = False
    """True if a row of an EPW file has the mean over the hour before."""


def _kelvin(values: np.ndarray) -> np.ndarray:
    return values + ZERO_CELSIUS


_QUANTITIES = (
    _Quantity(
        name="air",
        csv="air_degC",
        epw="temp_air",
        missing=99.9,
        lowest=-120.0,
        to_si=_kelvin,
    ),
    _Quantity(
        name="dew_point",
        csv="dew_point_degC",
        epw="temp_dew",
        missing=99.9,
        lowest=-120.0,
        to_si=_kelvin,
    ),
    _Quantity(
        name="direct_normal",
        csv="direct_normal_W_m2",
        epw="dni",
        missing=9999.0,
        lowest=0.0,
        is_mean=True,
    ),
    _Quantity(
        name="diffuse",
        csv="diffuse_W_m2",
        epw="dhi",
        missing=9999.0,
        lowest=0.0,
        is_mean=True,
    ),
    _Quantity(
        name="infrared",
        csv="infrared_W_m2",
        epw="ghi_infrared",
        missing=9999.0,
        lowest=1e-3,
        is_mean=True,
    ),
    _Quantity(
        name="wind_speed",
        csv="wind_speed_m_s",
        epw="wind_speed",
        missing=999.0,
        lowest=0.0,
    ),
    _Quantity(
        name="wind_direction",
        csv="wind_direction_deg",
        epw="wind_direction",
        missing=999.0,
        lowest=0.0,
        to_si=np.radians,
    ),
)
_OPTIONAL = ("dew_point_degC", "infrared_W_m2")


def read_weather(path: Path, start: datetime) -> Weather:
    """The weather in an EPW file, recognized by its ending, or in a CSV file.

    An EPW file joins months of several years: they all count as the year of `start`.
    Its radiation is the mean over the hour before each time; it is assigned to the
    middle of that hour.

    Raises:
        InputError: without the extra, or for a file that cannot be read.
    """
    require_pvlib("a weather file")
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    read = _read_epw if path.suffix.lower() == ".epw" else _read_csv
    try:
        return read(path, start)
    except InputError:
        raise
    except Exception as error:  # damaged text makes the readers raise anything
        raise InputError(
            f"{path}: not a weather file, or damaged ({type(error).__name__}): give an "
            "EPW file, or CSV with the columns of docs/guide/outdoors.md"
        ) from error


def _read_epw(path: Path, start: datetime) -> Weather:
    # The first line has the zone, in which the year of the start counts.
    with path.open(encoding="utf-8", errors="replace") as file:
        zone = timezone(timedelta(hours=float(file.readline().split(",")[8])))
    table, _ = _pvlib.iotools.read_epw(str(path), start.astimezone(zone).year)
    # The rows are named by the start of their hour.
    ends = np.array([stamp.timestamp() for stamp in table.index]) + _HOUR
    _check_increasing(path, ends)
    columns = {}
    for quantity in _QUANTITIES:
        numbers = table[quantity.epw]
        columns[quantity.name] = Column(
            times=ends - _HOUR / 2 if quantity.is_mean else ends,
            values=_values(numbers, quantity=quantity, missing=quantity.missing),
            name=quantity.epw,
        )
    return Weather(
        source=str(path), covers=(ends[0] - _HOUR, ends[-1]), columns=columns, zone=zone
    )


def _read_csv(path: Path, start: datetime) -> Weather:
    table = _pandas.read_csv(path, skipinitialspace=True)
    column_names = {"time", *(quantity.csv for quantity in _QUANTITIES)}
    lacking = sorted(column_names - set(table.columns) - set(_OPTIONAL))
    if lacking:
        raise InputError(
            f"{path}: column '{lacking[0]}' is missing; needed are "
            f"{', '.join(sorted(column_names - set(_OPTIONAL)))}"
        )
    stamps = [_moment(path, row, text) for row, text in enumerate(table["time"], 2)]
    times = np.array([stamp.timestamp() for stamp in stamps])
    _check_increasing(path, times)
    columns = {}
    for quantity in _QUANTITIES:
        if quantity.csv in table.columns:
            numbers = table[quantity.csv]
            values = _values(numbers, quantity=quantity, missing=np.inf)
            columns[quantity.name] = Column(times, values, name=quantity.csv)
    return Weather(
        source=str(path),
        covers=(times[0], times[-1]),
        columns=columns,
        zone=start.tzinfo or UTC,
    )


def _values(column: Any, quantity: _Quantity, missing: float) -> np.ndarray:
    numbers = _pandas.to_numeric(column, errors="coerce").to_numpy(float)
    with np.errstate(invalid="ignore"):
        is_valid = (numbers >= quantity.lowest) & (numbers < missing)
    return np.where(is_valid, quantity.to_si(numbers), np.nan)


def _moment(path: Path, row: int, text: Any) -> datetime:
    try:
        moment = datetime.fromisoformat(str(text).strip())
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise InputError(
            f"{path}: line {row}: time '{text}' is not a date and time with a zone, "
            "such as 2026-06-21T12:00+02:00"
        )
    return moment


def _check_increasing(path: Path, times: np.ndarray) -> None:
    if len(times) < 2:
        raise InputError(f"{path}: has {len(times)} rows: give two at least")
    if (np.diff(times) <= 0).any():
        row = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 2
        raise InputError(f"{path}: row {row} is not later than the one before it")
