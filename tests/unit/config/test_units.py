"""Quantities: every unit, the degrees Celsius, and what is refused."""

import math
from typing import Any

import pytest

from jaxthermo.config.types import pint_units, quantities as units
from jaxthermo.config.types.model import parts
from jaxthermo.config.types.quantities import Unit, to_si
from jaxthermo.errors import InputError
from jaxthermo.temperatures import CELSIUS_NAMES


def unit_of(field: Any) -> Unit:
    """The unit that a type of fields declares."""
    return next(marker for marker in parts(field) if isinstance(marker, Unit))


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("2 mm", units.LENGTH, 2e-3),
        ("2mm", units.LENGTH, 2e-3),
        ("1e-3", units.LENGTH, 1e-3),
        (3, units.LENGTH, 3.0),
        ("-4.5e1 cm", units.LENGTH, -0.45),
        ("3 min", unit_of(units.Time), 180.0),
        ("0.5 h", unit_of(units.Time), 1800.0),
        ("25 degC", units.TEMPERATURE, 298.15),
        ("25 °C", units.TEMPERATURE, 298.15),
        ("-20 degC", units.TEMPERATURE, 253.15),
        ("77 degF", units.TEMPERATURE, 298.15),
        ("300 K", units.TEMPERATURE, 300.0),
        ("800 W/m^2", unit_of(units.Irradiance), 800.0),
        ("5 kW/m²", units.HEAT_FLUX, 5000.0),
        ("10 W/(m^2 K)", units.HEAT_TRANSFER_COEFFICIENT, 10.0),
        ("10 W/m^2/degC", units.HEAT_TRANSFER_COEFFICIENT, 10.0),
        ("16 W/m/K", unit_of(units.Conductivity), 16.0),
        ("8 g/cm^3", unit_of(units.Density), 8000.0),
        ("0.5 kJ/(kg K)", unit_of(units.SpecificHeat), 500.0),
        ("180 deg", unit_of(units.Angle), math.pi),
        (1.5, unit_of(units.Angle), 1.5),
        ("90 %", units.NUMBER, 0.9),
        ("5 kW/m^3", unit_of(units.HeatRateDensity), 5000.0),
        ("36 km/h", unit_of(units.Speed), 10.0),
        ("20 W/sr", unit_of(units.RadiantIntensity), 20.0),
        ("3 mW/cm^2/sr", unit_of(units.Radiance), 30.0),
        ("3 kW/(m^2 sr)", unit_of(units.Radiance), 3000.0),
        ("2 kW/(m^2 K)", unit_of(units.ContactConductance), 2000.0),
    ],
)
def test_reads_quantity(text, dimension, value):
    assert to_si(text, dimension) == pytest.approx(value, rel=1e-12)


def test_common_units_are_those_of_pint_bit_by_bit():
    common = [
        (text, Unit(symbol, "a value", ""))
        for symbol, factors in units._FACTORS.items()
        for text in factors
    ]
    common += [(text, units.TEMPERATURE) for text in (*CELSIUS_NAMES, "K")]
    for text, unit in common:
        for number in (0.0, -17.3, 0.1, 3.0, 37.7, 1234.5, 1e-7, 6e23):
            affine = unit is units.TEMPERATURE
            expected = pint_units.converted(number, text, unit.symbol, affine=affine)
            assert to_si(f"{number} {text}", unit) == expected, (number, text)


@pytest.mark.parametrize(
    ("value", "dimension", "message"),
    [
        ("5 s", units.LENGTH, r"expected a length such as '2 mm', got '5 s'"),
        ("5 foo", units.LENGTH, r"unknown unit 'foo'"),
        ("mm", units.LENGTH, r"expected a length"),
        ("", units.LENGTH, r"expected a length"),
        ("20 C", units.TEMPERATURE, r"degC"),
        ("3 deg", units.NUMBER, r"expected a number"),
        ("30 %", unit_of(units.Angle), r"expected an angle"),
        ("20 W", unit_of(units.RadiantIntensity), r"such as '20 W/sr', got '20 W'"),
        ("20 W sr", unit_of(units.RadiantIntensity), r"expected a radiant intensity"),
        ("20 W/m^2", unit_of(units.Radiance), r"expected a radiance"),
        ("20 W/m^2/sr", unit_of(units.Irradiance), r"expected an irradiance"),
        (True, units.LENGTH, r"got true"),
        (None, units.LENGTH, r"got nothing"),
        ([1], units.LENGTH, r"got \[1\]"),
        (math.nan, units.LENGTH, r"must be finite"),
        ("inf", units.LENGTH, r"must be finite"),
        ("nan m", units.LENGTH, r"expected a length"),
        ("1e999 m", units.LENGTH, r"must be finite"),
        (10**400, units.LENGTH, r"must be finite"),
        ("1 m^9^9^9^9", units.LENGTH, r"expected a length"),
        ("1 m/0", units.LENGTH, r"expected a length"),
        ("1 " + "m" * 500, units.LENGTH, r"expected a length"),
        ("1 m; import os", units.LENGTH, r"expected a length"),
    ],
)
def test_refuses_what_is_no_such_quantity(value, dimension, message):
    with pytest.raises(InputError, match=message) as caught:
        to_si(value, dimension)
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)
