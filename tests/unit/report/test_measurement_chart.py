"""The chart of measurements: lines, bands and fractions, and gaps without a body."""

import numpy as np
import pytest
from PIL import Image

from jaxthermo.image.measurements import Box, Isotherm, Reading, Spot
from jaxthermo.report.measurement_chart import (
    _measurement_chart,
    write_measurement_chart,
)


NOTHING = Reading(np.nan, np.nan, np.nan, 0, 0.0)
EACH = {
    "Sp1": Spot((0.5, 0.5)),
    "robe": Box(((0.1, 0.1), (0.5, 0.5))),
    "Is1": Isotherm(above=310.0),
    "sky": Spot((0.0, 0.0)),
}
TIMES = [60.0, 300.0, 600.0]
READINGS = {
    "Sp1": [Reading(t, t, t, 1, 0.01) for t in (293.15, 303.15, 298.15)],
    "robe": [Reading(t - 5, t, t + 5, 50, 0.5) for t in (293.15, 303.15, 298.15)],
    "Is1": [NOTHING, Reading(311.0, 312.0, 313.0, 25, 0.25), NOTHING],
    "sky": [NOTHING] * 3,
}


def described(names):
    chart = _measurement_chart(TIMES, {name: EACH[name] for name in names}, READINGS)
    chart_data = chart.to_dict()
    # Data of the only part are above it.
    return [
        {"data": chart_data.get("data"), **panel} for panel in chart_data["vconcat"]
    ]


def test_temperatures_are_in_celsius_and_times_in_minutes():
    warm, fractions = described(EACH)
    band, lines = warm["layer"]
    rows = [row for row in lines["data"]["values"] if row["name"] == "Sp1"]
    assert [row["time"] for row in rows] == [1.0, 5.0, 10.0]
    assert [row["mean"] for row in rows] == pytest.approx([20.0, 30.0, 25.0])
    assert lines["encoding"]["x"]["title"] == "time [min]"
    assert lines["encoding"]["y"]["title"] == "temperature [°C]"
    assert {row["name"] for row in band["data"]["values"]} == {"robe"}
    percent = [row["percent"] for row in fractions["data"]["values"]]
    assert percent == [0.0, 25.0, 0.0]


def test_a_measurement_without_a_body_has_no_line_and_says_so():
    (warm,) = described(["Sp1", "sky"])
    names = warm["encoding"]["color"]["scale"]["domain"]
    assert names == ["Sp1", "sky, background"]
    rows = [row for row in warm["data"]["values"] if row["name"] != "Sp1"]
    assert [row["mean"] for row in rows] == [None] * 3


@pytest.mark.parametrize("names", [["Is1"], ["sky"], ["robe"], [*EACH]])
def test_it_is_drawn_for_any_kinds(tmp_path, names):
    measurements = {name: EACH[name] for name in names}
    write_measurement_chart(tmp_path / "m", TIMES, measurements, READINGS, "a title")
    with Image.open(tmp_path / "m.png") as picture:
        assert picture.width > 640
    assert "a title" in (tmp_path / "m.svg").read_text()


def test_one_frame_is_a_chart_too(tmp_path):
    readings = {name: rows[:1] for name, rows in READINGS.items()}
    write_measurement_chart(tmp_path / "m", TIMES[:1], EACH, readings)
    assert (tmp_path / "m.png").is_file()
