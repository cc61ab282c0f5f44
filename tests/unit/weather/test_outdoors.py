"""Weather files, and the terms that a place, a date and the weather become."""

import importlib.util
from datetime import datetime
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.errors import InputError
from jaxthermo.weather.files import read_weather
from jaxthermo.weather.sky import (
    clear_sky_temperature,
    diffuse_cloud_cover,
    overcast_sky_temperature,
    sol_air_temperature,
)
from tests.bodies import single_body_scene


MUNICH = jt.Place(48.14, 11.58, 520.0)
START = datetime.fromisoformat("2026-06-21T00:00+02:00")
DAY = 86400.0
CLEAR = jt.ClearSky((285.0, 299.0), wind_speed=1.5, wind_direction=270.0)
EPW_HEAD = "LOCATION,a,b,c,d,1,48.14,11.58,1.0,520.0\n" + "X\n" * 7
CSV_HEAD = (
    "time,air_degC,dew_point_degC,direct_normal_W_m2,diffuse_W_m2,"
    "wind_speed_m_s,wind_direction_deg\n"
)


def write_epw(path, days=(20, 21, 22), **changes):
    """An EPW file of June 1999; changes are texts of columns at day 21, hour 13."""
    lines = []
    for day in days:
        for hour in range(1, 25):
            row = ["0"] * 35
            row[:5] = ["1999", "6", str(day), str(hour), "60"]
            row[6:10] = [str(10 + hour), "8.5", "50", "95000"]
            row[12:16] = ["350", "400", str(10 * hour if 6 < hour < 20 else 0), "90"]
            row[20:22] = ["180", "3.5"]
            if (day, hour) == (21, 13):
                for column, text in changes.items():
                    row[int(column[1:])] = text
            lines.append(",".join(row))
    path.write_text(EPW_HEAD + "\n".join(lines) + "\n")
    return path


def made(weather, start=START, duration=DAY, **options):
    terms: Any = jt.outdoors(MUNICH, start, duration, weather, **options)
    return {term.name: term for term in terms}


def at(table, hour):
    return float(np.interp(hour * 3600, table.times, table.values))


def test_a_clear_day():
    terms = made(CLEAR)
    sun = terms["sun"]
    wind = terms["wind"]
    assert list(terms) == ["sun", "diffuse_sky", "emission", "wind"]
    assert at(sun.irradiance, 3) == at(sun.irradiance, 22) == 0
    assert 800 < at(sun.irradiance, 13) < 1000
    # From the east in the morning, so westward; from the south, northward, at noon.
    assert sun.direction(7 * 3600.0)[0] < -0.7 and sun.direction(19 * 3600.0)[0] > 0.7
    assert (
        sun.direction(13.2 * 3600.0)[1] > 0.3 and sun.direction(13.2 * 3600.0)[2] < -0.9
    )
    # A wind from the west blows to the east, +x.
    assert_allclose(wind.velocity, (1, 0, 0), atol=1e-12)
    assert_allclose(at(wind.temperature, 15), 299.0, atol=1e-9)
    assert at(terms["emission"].temperature, 12) < at(wind.temperature, 12) - 10


def test_the_sun_never_shines_from_below_and_shadows_follow_it():
    sun = made(CLEAR, every=3600.0)["sun"]
    shining = np.asarray(sun.irradiance.times)[np.asarray(sun.irradiance.values) > 0]
    assert all(sun.direction(time)[2] < 0 for time in shining)
    shots = np.array(sun.snapshot_times(DAY))
    # Sunrise and sunset of the almanac, 5:13 and 21:17 with the disc's upper edge.
    assert abs(shots[0] / 3600 - 5.22) < 0.15 and abs(shots[-1] / 3600 - 21.28) < 0.15
    assert np.diff(shots).max() <= 3600.0 + 1e-6
    middles = (shots[1:] + shots[:-1]) / 2
    assert all(sun.direction(time)[2] < 0 for time in middles)


def test_north_turns_everything():
    turned_place = jt.Place(48.14, 11.58, 520.0, north=(1.0, 0.0))
    terms: Any = jt.outdoors(turned_place, START, DAY, CLEAR)
    sun, _, _, wind = terms
    plain = made(CLEAR)["sun"].direction(9e4 / 2)
    x, y, z = sun.direction(9e4 / 2)
    assert_allclose((x, y, z), (plain[1], -plain[0], plain[2]), atol=1e-12)
    # East is -y where north is +x.
    assert_allclose(wind.velocity, (0, -1, 0), atol=1e-12)


def test_polar_night_has_no_sun_and_polar_day_no_sunset():
    pole = jt.Place(80.0, 20.0)
    winter = datetime.fromisoformat("2026-12-21T00:00Z")
    names = [term.name for term in jt.outdoors(pole, winter, DAY, CLEAR)]
    assert names == ["diffuse_sky", "emission", "wind"]
    summer = datetime.fromisoformat("2026-06-21T00:00Z")
    sun: Any = jt.outdoors(pole, summer, DAY, CLEAR)[0]
    assert np.asarray(sun.irradiance.values).min() > 0


def test_epw_hours_are_means_over_the_hour_before(tmp_path):
    # At +01:00, as the file: hour 13 has 130 W/m^2 for 12:00 to 13:00.
    start = datetime.fromisoformat("2026-06-21T00:00+01:00")
    terms = made(write_epw(tmp_path / "a.epw"), start)
    assert_allclose(at(terms["sun"].irradiance, 12.5), 130.0)
    assert_allclose(at(terms["wind"].temperature, 13), 273.15 + 23)
    assert_allclose(at(terms["wind"].speed, 13), 3.5)
    assert_allclose(terms["wind"].velocity, (0, 1, 0), atol=1e-12)
    sky = at(terms["emission"].temperature, 13)
    assert_allclose(STEFAN_BOLTZMANN * sky**4, 350.0, rtol=1e-9)
    # The same instants in another zone.
    in_other_zone = made(tmp_path / "a.epw", START)
    assert_allclose(at(in_other_zone["sun"].irradiance, 13.5), 130.0)


@pytest.mark.parametrize(
    ("column", "text", "name"),
    [
        ("c14", "9999", "dni"),
        ("c15", "9999", "dhi"),
        ("c6", "99.9", "temp_air"),
        ("c21", "999", "wind_speed"),
        ("c12", "9999", "ghi_infrared"),
    ],
)
def test_holes_name_the_column_and_the_time(tmp_path, column, text, name):
    path = write_epw(tmp_path / "a.epw", **{column: text})
    with pytest.raises(
        InputError, match=rf"a\.epw: column '{name}' .*2026-06-21T1[23]"
    ):
        made(path)
    # The hole does not matter to a run that ends before it.
    assert made(path, duration=3600.0)


def test_times_outside_of_the_file(tmp_path):
    path = write_epw(tmp_path / "a.epw")
    for start in ("2026-06-19T12:00+01:00", "2026-06-22T12:00+01:00"):
        with pytest.raises(InputError, match="covers 2026-06-20T00:00.*the scene runs"):
            made(path, datetime.fromisoformat(start))
    gap = write_epw(tmp_path / "b.epw", days=(20, 22))
    with pytest.raises(InputError, match="no rows between 2026-06-2"):
        made(gap)


def csv_row(time, dew="5"):
    return f"{time},20,{dew},500,100,2,90\n"


def test_csv(tmp_path):
    path = tmp_path / "a.csv"
    rows = [csv_row(f"2026-06-21T{h:02d}:00+02:00") for h in range(24)]
    path.write_text(CSV_HEAD + "".join(rows))
    weather = read_weather(path, START)
    column = weather.columns["wind_direction"]
    assert_allclose(column.values, np.pi / 2)
    assert_allclose(column.times - START.timestamp(), np.arange(24) * 3600)
    with pytest.warns(UserWarning, match="diffuse share of the daylight"):
        terms = made(path, duration=23 * 3600.0, terms=("sky", "convection"))
    convection = terms["linear_wind"].convection
    assert_allclose(np.asarray(convection.heat_transfer_coefficient.values), 2.8 + 6.0)
    with pytest.raises(InputError, match="there is no infrared"):
        made(path, duration=3600.0, sky="infrared")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,air_degC\n2026-06-21T00:00Z,3\n", "column 'diffuse_W_m2' is missing"),
        (CSV_HEAD + csv_row("2026-06-21T00:00"), "line 2: time .*with a zone"),
        (CSV_HEAD + csv_row("2026-06-21T00:00Z") * 2, "not later than the one before"),
        (CSV_HEAD, "has 0 rows"),
        ("", "column 'air_degC' is missing"),
        (CSV_HEAD + csv_row("2026-06-21T00:00Z")[:-4], "line 2 has 6 columns"),
        (CSV_HEAD.replace("diffuse", "direct_normal"), "'diffuse_W_m2' is missing"),
        (CSV_HEAD.replace("\n", ",time\n"), "column 'time' is there twice"),
    ],
)
def test_mistakes_in_csv(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_weather(path, START)


def test_the_sky_follows_from_the_air_where_there_is_no_humidity(tmp_path):
    """Swinbank: 0.0552 T^1.5, 242.9 K at 268.6 K; written as 5.31e-13 T^6 in 1963."""
    path = tmp_path / "dry.csv"
    head = CSV_HEAD.replace("dew_point_degC,", "")
    rows = [f"2026-06-21T{h:02d}:00+02:00,20,500,100,2,90\n" for h in range(3)]
    path.write_text(head + "".join(rows))
    with pytest.warns(UserWarning, match="cloudless; give `sky: swinbank`"):
        sky = made(path, duration=3600.0, terms=("sky",))["emission"]
    air = 293.15
    assert_allclose(np.asarray(sky.temperature.values), 0.0552 * air**1.5)
    by_radiation = (5.31e-13 * air**6 / STEFAN_BOLTZMANN) ** 0.25
    assert_allclose(np.asarray(sky.temperature.values), by_radiation, atol=1.0)


def test_clouds_follow_from_the_diffuse_share():
    """No cloud at 0.3 of the daylight and less, all clouds at 1; nights between days.

    An overcast sky radiates 1.2232 times as much as a clear one, and never more than
    the air.
    """
    diffuse = np.array([30.0, 0.0, 100.0, 65.0, 5.0])
    whole = np.array([200.0, 0.0, 100.0, 100.0, 10.0])
    cover = diffuse_cloud_cover(diffuse, whole)
    assert_allclose(cover, [0.0, 0.5, 1.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert_allclose(diffuse_cloud_cover(diffuse[:2] / 20, whole[:2] / 20), 0.0)
    air = np.full(5, 290.0)
    sky = overcast_sky_temperature(air * 0.75**0.25, air, cover)
    assert_allclose(sky[0], 290 * 0.75**0.25)
    assert_allclose((sky[2] / 290) ** 4, 0.75 * 1.2232)
    assert_allclose(overcast_sky_temperature(air * 0.9**0.25, air, cover)[2], 290.0)


def test_sky_and_ground():
    """Berdahl and Martin at a dew point of 10 degC at noon: eps = 0.7613."""
    air = np.array([300.0])
    dew = np.array([283.15])
    eps = 0.711 + 0.056 + 0.0073 - 0.013
    sky = clear_sky_temperature(air, dew, np.array([12.0]))
    assert_allclose(sky, 300 * eps**0.25, rtol=1e-12)
    ground = sol_air_temperature(air, sky, np.array([1.0]), np.array([600.0]))
    emitted = 0.95 * STEFAN_BOLTZMANN * (ground**4 - sky**4)
    assert_allclose(emitted + 5.8 * (ground - air), 600.0, rtol=1e-9)


def test_daylight_of_a_level_plate_and_of_the_ground():
    grid = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.1)), 0.05)
    clay = jt.Material(1.0, 1900.0, 835.0, absorptivity=0.5)
    scene = single_body_scene(grid, clay, 290.0, jt.DiffuseSky(100.0, 40.0))
    solution = jt.simulate(scene, 60.0)
    # Top 0.01 m^2 of sky, bottom of ground, four sides of half each.
    expected = 0.5 * 0.01 * (100 + 40 + 4 * (50 + 20)) * 60
    assert_allclose(solution.energy.mechanisms["diffuse_sky"][-1], expected)


def test_mistakes(monkeypatch):
    with pytest.raises(InputError, match="has no zone"):
        made(CLEAR, datetime(2026, 6, 21))
    with pytest.raises(InputError, match="'rain' is none of"):
        made(CLEAR, terms=("rain",))
    with pytest.raises(InputError, match="one of wind and convection"):
        made(CLEAR, terms=("wind", "convection"))
    with pytest.raises(InputError, match="wind_speed=.*-1"):
        jt.ClearSky((280.0, 290.0), wind_speed=-1.0)
    with pytest.raises(InputError, match="no such file"):
        made("nothing.epw")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install '\.\[weather\]'"):
        made(CLEAR)


def with_longwave(tmp_path):
    path = tmp_path / "a.csv"
    head = CSV_HEAD.replace("\n", ",longwave_west_W_m2\n")
    rows = [
        csv_row(f"2026-06-21T{h:02d}:00+02:00").replace("\n", f",{300 + h}\n")
        for h in range(24)
    ]
    path.write_text(head + "".join(rows))
    return path


def test_measured_long_wave_takes_the_place_of_sky_and_ground(tmp_path):
    """The front of a plate radiates to what was measured, its back to the ground."""
    path = with_longwave(tmp_path)
    terms: Any = jt.outdoors(
        MUNICH,
        START,
        23 * 3600.0,
        path,
        terms=("sky",),
        sky="berdahl_martin",
        longwave={"west": jt.Face("front")},
    )
    sky, west = terms
    assert_allclose(STEFAN_BOLTZMANN * at(west.temperature, 7.5) ** 4, 307.5, rtol=1e-4)
    layer = jt.Layer(jt.materials["stainless_steel"], 1e-3)
    plate = jt.Sheet(jt.shapes.rectangle(0.1, 0.1), (layer,), pitch=0.1)
    body = jt.Body(plate, temperature=290.0)
    solution = jt.simulate(jt.Scene((body,), terms, dtype="float64"), 1e-3)
    thermal = np.asarray(solution.irradiance(0).thermal)
    is_front = plate.grid.fragment_face == 0
    assert_allclose(thermal[is_front], 300.0, rtol=1e-5)
    # The back of a lying plate looks down, at a ground as warm as the air.
    below = STEFAN_BOLTZMANN * at(sky.ground, 0) ** 4
    assert_allclose(thermal[~is_front], below, rtol=1e-5)


def test_measured_long_wave_needs_its_column_and_the_sky(tmp_path):
    path = with_longwave(tmp_path)
    surface = {"east": jt.Face("front")}
    with pytest.raises(InputError, match="needs the term 'sky'"):
        jt.outdoors(MUNICH, START, DAY, path, terms=("wind",), longwave=surface)
    with pytest.raises(InputError, match="there is no longwave east; .* longwave west"):
        jt.outdoors(MUNICH, START, 3600.0, path, sky="swinbank", longwave=surface)
