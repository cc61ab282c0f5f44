"""Measurements on frames: which pixels they are of, and what is read there."""

import math
import subprocess
import sys

import numpy as np
import pytest
from frames import frame

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.image.measurements import (
    Box,
    Isotherm,
    Line,
    Spot,
    checked_coordinate,
    names_of,
    pixel_index,
    read_temperatures,
)


KELVIN = 280.0 + np.arange(48.0).reshape(6, 8)
EVERYWHERE = np.ones(KELVIN.shape, bool)


def read(measurement, filled=EVERYWHERE):
    (reading,) = read_temperatures(KELVIN, filled, [measurement]).values()
    return reading


@pytest.mark.parametrize(
    ("text", "checked"),
    [
        (0, 0.0),
        (0.25, 0.25),
        ("25 %", 0.25),
        ("100%", 1.0),
        (".5", 0.5),
        ("320 px", "320 px"),
        (" 7px ", "7 px"),
    ],
)
def test_coordinates(text, checked):
    assert checked_coordinate(text) == checked
    # What is written into a config reads as the same.
    assert checked_coordinate(checked) == checked


@pytest.mark.parametrize(
    "value",
    [320, -0.1, 1.01, "101 %", "1.5 px", "-3 px", "left", None, True, math.nan, "", []],
)
def test_what_is_no_coordinate(value):
    with pytest.raises(InputError, match="no coordinate: give a fraction .* '320 px'"):
        checked_coordinate(value)


def test_fractions_reach_both_edges_and_pixels_no_farther():
    assert [pixel_index(f, 8, "columns") for f in (0, 0.124, 0.125, 0.99, 1)] == [
        *(0, 0, 1, 7, 7)
    ]
    assert pixel_index("7 px", 8, "columns") == 7
    with pytest.raises(InputError, match="'8 px' .* whose columns are 0 to 7"):
        pixel_index("8 px", 8, "columns")


def test_a_spot_is_one_pixel():
    reading = read(Spot((0.5, "2 px")))
    assert reading == (KELVIN[2, 4],) * 3 + (1, 1 / 48)


def test_a_line_has_both_ends_whatever_its_direction():
    forth = ((0, 0), ("7 px", 0))
    back = (("7 px", 0), (0, 0))
    for ends in (forth, back):
        assert read(Line(ends)) == (280.0, 283.5, 287.0, 8, 8 / 48)
    steep = read(Line((("2 px", "0 px"), ("3 px", "5 px"))))
    assert (steep.min, steep.max, steep.pixels) == (KELVIN[0, 2], KELVIN[5, 3], 6)


def test_a_box_has_its_edges_whichever_corners_are_given():
    inside = KELVIN[1:4, 2:6]
    for corners in (
        (("2 px", "1 px"), ("5 px", "3 px")),
        (("5 px", "1 px"), ("2 px", "3 px")),
    ):
        reading = read(Box(corners))
        assert reading[:3] == (inside.min(), inside.mean(), inside.max())
        assert reading.pixels == inside.size


def test_an_isotherm_is_a_fraction_of_what_bodies_fill():
    filled = EVERYWHERE.copy()
    filled[:3] = False
    reading = read(Isotherm(above=320.0), filled)
    assert (reading.min, reading.max, reading.pixels) == (320.0, 327.0, 8)
    assert reading.fraction == 8 / 24
    # Neighbouring intervals share no pixel, and leave none out.
    intervals = [Isotherm(below=300.0), Isotherm(300.0, 310.0), Isotherm(above=310.0)]
    assert sum(read(interval).pixels for interval in intervals) == 48


def test_background_and_outlines_are_not_read():
    body = np.where(KELVIN > 310, 0, -1)
    image = frame(KELVIN, body=body)
    on = Spot((1.0, 1.0))
    off = Spot((0.0, 0.0), "sky")
    readings = jt.measure(image, [on, off])
    assert readings["Sp1"].mean == pytest.approx(327.0)
    assert math.isnan(readings["sky"].mean) and readings["sky"].pixels == 0
    mask = np.where(body >= 0, 1.0, 0.0)
    mask[-1, -1] = 0.75
    assert jt.measure(image, [on], mask=mask)["Sp1"].pixels == 0
    assert jt.measure(image, [Isotherm(above=400.0)])["Is1"].fraction == 0.0
    nothing = frame(KELVIN, body=np.full(KELVIN.shape, -1))
    assert jt.measure(nothing, [Isotherm(above=150.0)])["Is1"].fraction == 0.0


def test_names():
    spots = [Spot((0, 0)), Box(((0, 0), (1, 1))), Spot((0, 1)), Spot((1, 0), "ear")]
    assert names_of(spots) == ["Sp1", "Bx1", "Sp2", "ear"]
    with pytest.raises(InputError, match="measurement 'Sp1' is there twice"):
        names_of([Spot((0, 0)), Spot((0, 1), "Sp1")])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Isotherm(), "give `above`, `below` or both"),
        (lambda: Isotherm(310.0, 310.0), "above=310, below=310.*give above < below"),
        (
            lambda: read(Spot(("8 px", 0), "ear")),
            "measurement 'ear': '8 px' is outside",
        ),
        (lambda: jt.measure(frame(KELVIN), [], mask=np.ones((2, 2))), "give one size"),
        (lambda: jt.measure(frame(KELVIN * np.nan), []), "not finite"),
    ],
)
def test_mistakes(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_measurements_are_read_without_jax():
    code = (
        "import sys, jaxthermo as jt; jt.measurements.Spot; print('jax' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n"
