"""Temperatures that are hardly meant, and the units that were."""

import numpy as np
import pytest

from jaxthermo.config.types.quantities import (
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    to_si,
)
from jaxthermo.temperatures import (
    UNITS,
    CheckedValues,
    Limits,
    LinearUnit,
    likely_unit,
    pixel_mistake,
    temperature_limits,
)


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("kelvin", "kelvin"),
        ("celsius", "celsius"),
        ("centikelvin", "centikelvin"),
        (LinearUnit(scale=0.04), "{scale: 0.04 K}"),
        (LinearUnit(scale=0.1), "{scale: 0.1 K}"),
    ],
)
def test_the_unit_of_a_room_is_found(unit, expected):
    """An image of 285 to 320 K with two dead pixels, in the unit of its file."""
    kelvin = np.linspace(285.0, 320.0, 50)
    unit = UNITS[unit] if isinstance(unit, str) else unit
    numbers = unit.numbers(kelvin)
    np.testing.assert_allclose(unit.kelvin(numbers), kelvin)
    assert likely_unit(np.concatenate([numbers, [0.0, 0.0]])) == expected


def test_numbers_of_no_unit_have_none():
    assert likely_unit(np.full(4, -1e6)) == ""


def test_pixels_are_counted_and_listed_by_row_and_column():
    values = np.full((2, 3, 4), 300.0)
    values[1, 2] = [10.0, 20.0, 30.0, 7e3]
    values[0, 0, 0] = np.nan
    checked = CheckedValues(values, noun="compared pixels", times=(60.0, 240.0))
    assert pixel_mistake(checked, Limits()) == (
        "4 of 23 compared pixels are below 150 K or above 6000 K: 10 K at row 2, "
        "column 0 at 240 s, 20 K at row 2, column 1 at 240 s, 30 K at row 2, column 2 "
        "at 240 s and 1 more: mask them, or repair the frame"
    )
    assert pixel_mistake(checked, temperature_limits(True)) == ""
    assert pixel_mistake(CheckedValues(-values), temperature_limits(True))


@pytest.mark.parametrize(
    ("text", "kelvin", "difference"),
    [
        ("20 celsius", 293.15, 20.0),
        ("20 degC", 293.15, 20.0),
        ("20 °C", 293.15, 20.0),
        ("300 K", 300.0, 300.0),
        ("300 kelvin", 300.0, 300.0),
        ("300000 mK", 300.0, 300.0),
        ("68 degF", 293.15, 68 / 1.8),
    ],
)
def test_words_for_kelvin_and_celsius(text, kelvin, difference):
    """A temperature has a zero point, and a difference of temperatures has none."""
    assert to_si(text, TEMPERATURE) == pytest.approx(kelvin)
    assert to_si(text, TEMPERATURE_DIFFERENCE) == pytest.approx(difference)
