"""Temperatures that are hardly meant, and the units that were."""

import numpy as np
import pytest

from jaxthermo.config.types.quantities import (
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    to_si,
)
from jaxthermo.temperatures import UNITS, LinearUnit, likely_unit, pixel_list


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


def test_pixels_are_listed_by_row_and_column():
    values = np.arange(12.0).reshape(3, 4)
    wrong = values >= 8
    listed = pixel_list(wrong, values, "K")
    assert listed == (
        "8 K at row 2, column 0, 9 K at row 2, column 1, 10 K at row 2, column 2 and "
        "1 more"
    )


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
