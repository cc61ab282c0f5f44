"""Runs across New Year with an EPW file, whose months are of one year."""

import warnings
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.errors import InputError


FILES = Path(__file__).parents[2] / "data" / "mesh_and_heat"
DAY = 86400.0
NEW_YEAR = datetime(2026, 1, 1)
ZONE = timezone(timedelta(hours=1))
REPEATED = "ends with its year: after 31 December it is repeated from 1 January on"


def air_of(moment: datetime) -> float:
    """Air at the end of an hour [degC], other on each day of the year and hour."""
    begin = moment - timedelta(hours=1)
    # A day has the same number in all years.
    day = begin.replace(year=2023).timetuple().tm_yday
    return round(day / 10 - 15 + (begin.hour + 1) / 100, 2)


@pytest.fixture(scope="module")
def lines() -> list[str]:
    """A file of 365 days, each with the sun and wind of one in June."""
    text = (FILES / "latin1.epw").read_text("latin-1").splitlines()
    fields = text[8].split(",")
    rows = []
    for hour in range(8760):
        begin = datetime(2023, 1, 1) + timedelta(hours=hour)
        time = ["2023", str(begin.month), str(begin.day), str(begin.hour + 1)]
        air = f"{air_of(begin + timedelta(hours=1)):.2f}"
        rows.append(",".join([*time, *fields[4:6], air, *fields[7:]]))
    return [*text[:8], *rows]


def air_table(folder, lines, start, days):
    """Table of the air, and the warnings of its file."""
    path = folder / "year.epw"
    path.write_text("\n".join(lines) + "\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        terms: Any = jt.outdoors(
            None, datetime.fromisoformat(start), days * DAY, path, terms=["wind"]
        )
    return terms[0].temperature, [str(warning.message) for warning in caught]


@pytest.mark.parametrize(
    ("start", "days"),
    [
        ("2025-12-31T12:00+01:00", 2),
        # The next year has 29 February, which the file does not.
        ("2027-12-20T00:00+01:00", 90),
        # Of the year before in the zone of the file.
        ("2026-01-01T00:00+02:00", 2),
    ],
)
def test_a_file_of_a_year_goes_on_with_its_first_of_january(
    tmp_path, lines, start, days
):
    table, remarks = air_table(tmp_path, lines, start, days)
    assert sum(REPEATED in remark for remark in remarks) == 1
    begin = datetime.fromisoformat(start).astimezone(ZONE).replace(tzinfo=None)
    for hour in range(1, 24 * days):
        moment = begin + timedelta(hours=hour)
        if (moment - timedelta(hours=1)).strftime("%m-%d") == "02-29":
            moment -= timedelta(days=1)
        kelvin = np.interp(hour * 3600.0, table.times, table.values)
        assert kelvin - ZERO_CELSIUS == pytest.approx(air_of(moment), abs=1e-9)
    is_leap = [remark for remark in remarks if "28 February is repeated" in remark]
    assert len(is_leap) == start.startswith("2027")


def test_a_run_within_the_year_repeats_nothing(tmp_path, lines):
    table, remarks = air_table(tmp_path, lines, "2025-12-30T00:00+01:00", 2)
    assert not any(REPEATED in remark for remark in remarks)
    assert table.values[-1] - ZERO_CELSIUS == pytest.approx(air_of(NEW_YEAR))


@pytest.mark.parametrize("cut", [slice(8, -1), slice(9, None)])
def test_a_file_of_less_than_a_year_is_not_repeated(tmp_path, lines, cut):
    with pytest.raises(InputError, match=r"covers 2025-01-01.*the scene runs from"):
        air_table(tmp_path, [*lines[:8], *lines[cut]], "2025-12-31T12:00+01:00", 1)
