"""Weather files in all states in which they are found, and damaged ones."""

import csv
import shutil
import warnings
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.errors import InputError
from jaxthermo.weather.files import read_weather
from jaxthermo.weather.sky import clear_sky_temperature, cloudy_sky_temperature
from jaxthermo.weather.weather import Weather
from tests.damaged import damage


FILES = Path(__file__).parents[2] / "data" / "mesh_and_heat"
PLACE = jt.Place(48.0, 11.0, 500.0)
START = datetime.fromisoformat("2026-06-21T00:00+01:00")
DAY = 86400.0
CLEAN = (FILES / "latin1.epw").read_bytes().replace(b"Z\xfcrich", b"Zurich")
DAYS = CLEAN.decode("ascii").splitlines()


class _Terms(NamedTuple):
    """Terms of a weather file, with the warnings about it."""

    sun: Any
    diffuse: Any
    sky: Any
    wind: Any
    warnings: list[str]


def terms_of(path, place: jt.Place | None = PLACE, start=START, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        terms: Any = jt.outdoors(place, start, DAY, path, **options)
    sun, diffuse, sky, wind = terms
    return _Terms(
        sun=sun,
        diffuse=diffuse,
        sky=sky,
        wind=wind,
        warnings=[str(warning.message) for warning in caught],
    )


def written(folder, lines, name="a.epw"):
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def rows(lines, change):
    """Lines with the fields of each row changed."""
    return [*lines[:8], *(",".join(change(line.split(","))) for line in lines[8:])]


def with_field(position, text, hour=None):
    def change(fields):
        is_changed = hour is None or fields[2:4] == ["21", str(hour)]
        if is_changed:
            fields[position] = text
        return fields

    return change


def assert_same(actual, expected, wind=True):
    """The same values at the same times; directions of the wind only if asked."""
    pairs = [
        (actual.sun.irradiance, expected.sun.irradiance),
        (actual.diffuse.irradiance, expected.diffuse.irradiance),
        (actual.sky.temperature, expected.sky.temperature),
        (actual.sky.ground, expected.sky.ground),
        (actual.wind.temperature, expected.wind.temperature),
    ]
    if wind:
        pairs.append((actual.wind.speed, expected.wind.speed))
        assert_allclose(actual.wind.velocity, expected.wind.velocity, atol=1e-12)
    for table, other in pairs:
        assert_allclose(table.times, other.times, atol=1e-6)
        assert_allclose(table.values, other.values, rtol=1e-12, atol=1e-9)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    path = tmp_path_factory.mktemp("clean") / "a.epw"
    path.write_bytes(CLEAN)
    terms = terms_of(path)
    assert terms.warnings == []
    return terms


@pytest.mark.parametrize("name", ["latin1", "columns32", "leap", "calm"])
def test_usual_states_of_files(name, clean):
    terms = terms_of(FILES / f"{name}.epw")
    assert terms.warnings == []
    # The wind of one file is calm at night.
    assert_same(terms, clean, wind=name != "calm")
    assert_allclose(terms.wind.velocity, (1, 0, 0), atol=1e-12)


def test_a_calm_has_no_direction(tmp_path):
    path = FILES / "calm.epw"
    assert np.asarray(terms_of(path).wind.speed.values).min() == 0
    lines = rows(DAYS, with_field(20, "999", hour=13))
    with pytest.raises(InputError, match="wind_direction' has no value from 0 to 360"):
        terms_of(written(tmp_path, lines))


def test_directions_around_north_are_near_each_other(tmp_path):
    # From 350 to 10 degrees by way of 0, also where a run begins between rows.
    def alternating(fields):
        fields[20] = "350" if int(fields[3]) % 2 else "10"
        return fields

    path = written(tmp_path, rows(DAYS, alternating))
    half_past = datetime.fromisoformat("2026-06-21T00:30+01:00")
    wind = terms_of(path, start=half_past).wind
    assert wind.velocity[1] == pytest.approx(-1, abs=0.02)
    weather = read_weather(path, START)
    directions = weather.columns["wind_direction"].values
    assert np.abs(np.diff(directions)).max() < np.radians(21)


@pytest.mark.parametrize("columns", range(31, 36))
def test_thirty_one_to_thirty_five_columns(tmp_path, clean, columns):
    path = written(tmp_path, rows(DAYS, lambda fields: fields[:columns]))
    assert_same(terms_of(path), clean)


def test_other_numbers_of_columns_are_refused(tmp_path):
    for columns in (30, 36):
        change = (DAYS[8].split(",") + ["1"])[:columns]
        path = written(tmp_path, [*DAYS[:8], *[",".join(change)] * 3])
        with pytest.raises(InputError, match=rf"line 9 has {columns} columns"):
            terms_of(path)
    lines = [*DAYS]
    lines[40] = lines[40].rsplit(",", 3)[0]
    with pytest.raises(InputError, match="line 41 has 32 columns, and line 9 has 35"):
        terms_of(written(tmp_path, lines))
    # What a spreadsheet adds.
    path = written(tmp_path, [line + ",,," for line in DAYS])
    assert terms_of(path).warnings == []


def test_hours_from_0_to_23(tmp_path, clean):
    def earlier(fields):
        return [*fields[:3], str(int(fields[3]) - 1), *fields[4:]]

    terms = terms_of(written(tmp_path, rows(DAYS, earlier)))
    assert_same(terms, clean)
    (warning,) = terms.warnings
    assert "hours from 0 to 23" in warning
    lines = rows(DAYS, with_field(3, "0", hour=1))
    with pytest.raises(InputError, match="hours 0 and 24, which are one time"):
        terms_of(written(tmp_path, lines))


@pytest.mark.parametrize("year", [2024, 2025])
def test_leap_years_both_ways(tmp_path, year):
    """29 February of a file is left out, and one that it lacks is the day before."""
    start = datetime(year, 2, 28, 12, tzinfo=START.tzinfo)
    lines = (FILES / "leap.epw").read_text().splitlines()
    with_day = terms_of(written(tmp_path, lines), start=start)
    without_lines = [line for line in lines if not line.startswith("2024,2,29,")]
    without = terms_of(written(tmp_path, without_lines, "b.epw"), start=start)
    # Every day of the file has the same weather, that of June.
    assert_same(without, with_day)
    doubts = [w for w in without.warnings if "28 February is repeated" in w]
    assert len(doubts) == (year == 2024)


def test_commas_in_quotes_line_ends_and_marks(tmp_path, clean):
    path = tmp_path / "a.EPW"
    text = CLEAN.decode("ascii").replace("Zurich-Flughafen", '"Zürich, Flughafen"')
    ends = text.replace("\r\n", "\n")
    for encoding in ("utf-8", "utf-8-sig", "latin-1"):
        for line_end in ("\n", "\r\n", "\r"):
            changed = ends.replace("\n", line_end) + "\x1a"
            path.write_bytes(changed.encode(encoding))
            assert_same(terms_of(path), clean)


def test_the_place_of_the_file(tmp_path, clean):
    path = written(tmp_path, DAYS)
    terms = terms_of(path, place=None)
    assert terms.warnings == []
    assert_same(terms, clean)
    for time in (6 * 3600.0, 12 * 3600.0):
        assert_array_equal(terms.sun.direction(time), clean.sun.direction(time))
    turned = terms_of(path, place=None, north=(1.0, 0.0))
    assert_allclose(turned.wind.velocity, (0, -1, 0), atol=1e-12)
    near = terms_of(path, place=jt.Place(48.9, 11.9))
    assert near.warnings == []
    for far in (jt.Place(49.0, 11.0), jt.Place(48.0, 10.0)):
        (warning,) = terms_of(path, place=far).warnings
        assert "latitude 48, longitude 11, 1 degrees from the place" in warning


def test_a_place_that_nothing_states(tmp_path):
    head = "time,air_degC,dew_point_degC,direct_normal_W_m2,diffuse_W_m2,"
    rows = [f"2026-06-2{day}T00:00+01:00,9,5,0,0,1,90" for day in (1, 2)]
    path = written(
        tmp_path, [f"{head}wind_speed_m_s,wind_direction_deg", *rows], "a.csv"
    )
    with pytest.raises(InputError, match=r"a\.csv states no place; give a Place"):
        terms_of(path, place=None)
    with pytest.raises(InputError, match="a clear sky has none; give a Place"):
        terms_of(jt.ClearSky((280.0, 290.0)), place=None)
    with pytest.raises(InputError, match="north=.*give it to the Place"):
        terms_of(FILES / "latin1.epw", north=(1.0, 0.0))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("LOCATION", "PLACE", "line 1 does not begin with LOCATION"),
        (",48.0,11.0,1.0,500", ",48.0,11.0,1.0", "line 1 has 9 columns"),
        ("48.0,11.0", "N48,11.0", "line 1: latitude 'N48' is no number"),
        ("48.0,11.0", "148.0,11.0", "line 1: Place.latitude=.*148"),
        ("11.0,1.0,500", "11.0,15,500", "time zone 15 is not from -12 to 14"),
        ("PERIODS,1,1,", "PERIODS,1,4,", "line 8: has '4' rows an hour"),
        ("2005,6,20,5,", "2005,6,31,5,", "line 13: month, day and hour are '6, 31, 5'"),
        ("2005,6,20,5,", "2005,6,20,25,", "line 13: month, day and hour"),
        ("2005,6,20,5,", f"2005,{10**20},20,5,", "line 13: month, day and hour"),
        ("2005,6,20,5,", "2005,6,20,4,", "line 13 is not later than the one before"),
    ],
)
def test_mistakes_in_epw(tmp_path, old, new, message):
    text = "\n".join(DAYS)
    assert text.count(old) == 1
    path = written(tmp_path, text.replace(old, new).splitlines())
    with pytest.raises(InputError, match=message):
        terms_of(path)


def test_files_that_are_no_weather(tmp_path):
    for name, content in (("a.epw", b"\0\1"), ("a.csv", b"\x89PNG\0"), ("b.csv", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: (not a text|column)"):
            terms_of(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read: is a directory"):
        terms_of(tmp_path)


def test_a_row_that_is_missing(tmp_path):
    lines = [line for line in DAYS if not line.startswith("2005,6,21,13,")]
    with pytest.raises(InputError, match="no rows between 2026-06-21T11:30"):
        terms_of(written(tmp_path, lines))


def test_daylight_of_another_zone_or_hemisphere(tmp_path):
    """The sun of the place and the light of the file contradict each other."""
    text = "\n".join(DAYS)
    moved = {
        "11.0,1.0,500": ("11.0,3.0,500", "the sun shines while it is down"),
        ",48.0,": (",-48.0,", "the sun shines while it is down"),
    }
    for old, (new, message) in moved.items():
        path = written(tmp_path, text.replace(old, new).splitlines())
        assert any(message in w for w in terms_of(path, place=None).warnings)
    path = written(tmp_path, text.replace("11.0,1.0,", "11.0,-9,").splitlines())
    assert any("time zone -9 h is 9.7 h" in w for w in terms_of(path, None).warnings)
    dark = rows(rows(DAYS, with_field(14, "0", 12)), with_field(15, "0", 12))
    (warning,) = terms_of(written(tmp_path, dark)).warnings
    assert "at 2026-06-21T11:30+01:00 there is no light by day" in warning


def test_numbers_that_do_not_go_with_the_others(tmp_path):
    cold = written(tmp_path, rows(DAYS, with_field(6, "-17", 14)))
    (warning,) = terms_of(cold).warnings
    assert "at 2026-06-21T14:00+01:00 the air differs by more than 8 K" in warning
    sky = written(tmp_path, rows(DAYS, with_field(12, "33", 14)))
    (warning,) = terms_of(sky).warnings
    assert "the infrared radiation of the sky does not go with" in warning
    for position, text in ((6, "71"), (12, "0"), (14, "-1"), (21, "1_0"), (6, "x")):
        path = written(tmp_path, rows(DAYS, with_field(position, text, 14)))
        with pytest.raises(InputError, match=r"has no value from .* at 2026-06-21T1"):
            terms_of(path)


def test_clouds_of_a_sky_without_infrared():
    """Walton's law at a cover of 10: 1.154 times the emissivity of the clear sky."""
    path = FILES / "overcast.epw"
    terms = terms_of(path)
    (warning,) = terms.warnings
    assert "no infrared radiation" in warning and "cloud cover (Walton 1983)" in warning
    clear = terms_of(path, sky="berdahl_martin")
    assert clear.warnings == []
    ratio = (terms.sky.temperature.values / clear.sky.temperature.values) ** 4
    assert_allclose(ratio, 1 + 0.224 - 0.35 + 0.28, rtol=1e-12)
    colder = terms.sky.temperature.values - clear.sky.temperature.values
    assert (colder > 9).all()


def test_the_law_of_clouds():
    air = np.full(4, 290.0)
    clear = clear_sky_temperature(air, np.full(4, 283.15), np.full(4, 6.0))
    cover = np.array([0.0, 0.5, 1.0, 1.0])
    sky = cloudy_sky_temperature(clear, air, cover)
    eps = 0.711 + 0.056 + 0.0073
    factor = np.array([1.0, 1.0595, 1.154, 1.154])
    assert_allclose((sky / air) ** 4, eps * factor, rtol=1e-12)
    # Clouds are not warmer than the air.
    humid = cloudy_sky_temperature(np.full(4, 289.0), air, cover)
    assert_allclose(humid[2], 290.0)


def test_total_cover_stands_in_for_opaque_cover(tmp_path):
    lines = (FILES / "overcast.epw").read_text().splitlines()
    total = terms_of(written(tmp_path, rows(lines, with_field(23, "99"))))
    opaque = terms_of(FILES / "overcast.epw")
    assert_allclose(total.sky.temperature.values, opaque.sky.temperature.values)
    neither = rows(rows(lines, with_field(23, "99")), with_field(22, "99"))
    (warning,) = terms_of(written(tmp_path, neither)).warnings
    assert "neither infrared radiation" in warning and "diffuse share" in warning


CSV_COLUMNS = {
    "air_degC": 6,
    "dew_point_degC": 7,
    "direct_normal_W_m2": 14,
    "diffuse_W_m2": 15,
    "infrared_W_m2": 12,
    "wind_speed_m_s": 21,
    "wind_direction_deg": 20,
    "cloud_cover_tenths": 23,
}


def csv_lines():
    """The days of the clean file as CSV, in which numbers are those of moments."""
    lines = [",".join(["time", *CSV_COLUMNS])]
    for line in DAYS[8:]:
        fields = line.split(",")
        stamp = f"2026-06-{fields[2]}T{int(fields[3]) - 1:02d}:30+01:00"
        lines.append(",".join([stamp, *(fields[n] for n in CSV_COLUMNS.values())]))
    return lines


def test_csv_of_the_same_days(tmp_path, clean):
    terms = terms_of(written(tmp_path, csv_lines(), "a.csv"))
    assert terms.warnings == []
    assert_allclose(terms.sun.irradiance.values, clean.sun.irradiance.values)
    # By its content, whatever its name.
    path = tmp_path / "a.txt"
    shutil.copy(tmp_path / "a.csv", path)
    assert_same(terms_of(path), terms)
    path.write_bytes(CLEAN)
    assert_same(terms_of(path), clean)


def test_doubts_about_csv(tmp_path):
    lines = csv_lines()
    without = [line for line in lines if not line.startswith("2026-06-21T12:30")]
    (warning,) = terms_of(written(tmp_path, without, "a.csv")).warnings
    assert "at 2026-06-21T11:30+01:00 rows are missing" in warning
    path = tmp_path / "cut.csv"
    path.write_text("\n".join(lines[:-1]))
    last = datetime.fromisoformat("2026-06-22T22:00+01:00")
    (warning,) = terms_of(path, start=last).warnings
    assert "the last line has no end of line" in warning
    assert terms_of(path).warnings == []
    semicolons = [line.replace(",", ";") for line in lines]
    with pytest.raises(InputError, match="separated by commas"):
        terms_of(written(tmp_path, semicolons, "b.csv"))


# Damaged files: what is read is what their lines say, or else it is refused.


def stated(text: str, is_epw: bool) -> dict[tuple[str, float], float]:
    """Numbers that the lines of a file state, by column and time [s]."""
    values = {}
    for line in text.splitlines():
        (fields,) = csv.reader([line])
        try:
            if is_epw:
                month, day, hour = (int(field) for field in fields[1:4])
                time = datetime(2026, month, day, tzinfo=START.tzinfo).timestamp()
                time += 3600 * hour
            else:
                time = datetime.fromisoformat(fields[0].strip()).timestamp()
        except (ValueError, IndexError):
            continue
        for number, (name, position) in enumerate(CSV_COLUMNS.items(), 1):
            try:
                values[name, time] = float(fields[position if is_epw else number])
            except (ValueError, IndexError):
                values[name, time] = np.nan
    return values


def check_as_stated(weather: Weather, text: str, is_epw: bool) -> None:
    """Each number within the run is the one in the line of its time."""
    numbers = stated(text, is_epw)
    first = START.timestamp()
    for name in ("air", "direct_normal", "diffuse", "infrared", "wind_speed"):
        column = weather.columns[name]
        (csv_name,) = (text for text in CSV_COLUMNS if text.startswith(name))
        is_mean = is_epw and name in ("direct_normal", "diffuse", "infrared")
        times = column.times + (1800 if is_mean else 0)
        values = column.values - (ZERO_CELSIUS if name == "air" else 0)
        is_run = (times >= first) & (times <= first + DAY)
        expected = [numbers[csv_name, time] for time in times[is_run]]
        assert_allclose(values[is_run], expected, atol=1e-9)


def swapped(data: bytes, random: np.random.Generator) -> bytes:
    """Two bytes in each other's place, next to each other or anywhere."""
    changed = bytearray(data)
    first = int(random.integers(len(data) - 1))
    second = first + 1 if random.integers(2) else int(random.integers(len(data)))
    changed[first], changed[second] = changed[second], changed[first]
    return bytes(changed)


def other_count(data: bytes, random: np.random.Generator) -> bytes:
    """A line with a column more or less."""
    lines = data.split(b"\n")
    row = int(random.integers(1, len(lines) - 1))
    fields = lines[row].split(b",")
    column = int(random.integers(len(fields)))
    if random.integers(2):
        fields.insert(column, b"7")
    else:
        del fields[column]
    lines[row] = b",".join(fields)
    return b"\n".join(lines)


def check_damage(folder: Path, seed: int) -> str:
    """Damage a file and read it; return in which way it is told."""
    random = np.random.default_rng(seed)
    is_epw = bool(seed % 2)
    data = CLEAN if is_epw else "\n".join(csv_lines()).encode() + b"\n"
    choice = random.integers(3)
    if choice == 0:
        data = damage(data, random, is_text=True)
    else:
        data = (swapped if choice == 1 else other_count)(data, random)
    name = ("a.epw", "a.csv", "a.txt", "a.EPW", "a")[random.integers(5)]
    path = folder / name
    path.write_bytes(data)
    try:
        terms = terms_of(path)
    except InputError as error:
        message = str(error)
        assert "\n" not in message and name in message
        return "refused"
    if terms.warnings:
        return "doubted"
    text = data.decode("latin-1").replace("\r\n", "\n")
    weather = read_weather(path, START)
    check_as_stated(weather, text, text.lstrip().upper().startswith("LOCATION"))
    return "read"


def test_two_hundred_damaged_files(tmp_path):
    ends = [check_damage(tmp_path, seed) for seed in range(200)]
    assert ends.count("refused") > 80
    assert ends.count("read") > 20


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path):
    for seed in range(1000, 3000):
        check_damage(tmp_path, seed)
