"""Quantities: every unit, the degrees Celsius, and what is refused."""

import math

import pytest

from jaxthermo.config.types import quantities as units
from jaxthermo.config.types.quantities import to_si
from jaxthermo.errors import InputError


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("2 mm", units.LENGTH, 2e-3),
        ("2mm", units.LENGTH, 2e-3),
        ("1e-3", units.LENGTH, 1e-3),
        (3, units.LENGTH, 3.0),
        ("-4.5e1 cm", units.LENGTH, -0.45),
        ("3 min", units.TIME, 180.0),
        ("0.5 h", units.TIME, 1800.0),
        ("25 degC", units.TEMPERATURE, 298.15),
        ("25 °C", units.TEMPERATURE, 298.15),
        ("-20 degC", units.TEMPERATURE, 253.15),
        ("77 degF", units.TEMPERATURE, 298.15),
        ("300 K", units.TEMPERATURE, 300.0),
        ("800 W/m^2", units.IRRADIANCE, 800.0),
        ("5 kW/m²", units.HEAT_FLUX, 5000.0),
        ("10 W/(m^2 K)", units.HEAT_TRANSFER_COEFFICIENT, 10.0),
        ("10 W/m^2/degC", units.HEAT_TRANSFER_COEFFICIENT, 10.0),
        ("16 W/m/K", units.CONDUCTIVITY, 16.0),
        ("8 g/cm^3", units.DENSITY, 8000.0),
        ("0.5 kJ/(kg K)", units.SPECIFIC_HEAT, 500.0),
        ("180 deg", units.ANGLE, math.pi),
        (1.5, units.ANGLE, 1.5),
        ("90 %", units.NUMBER, 0.9),
        ("5 kW/m^3", units.HEAT_RATE_DENSITY, 5000.0),
        ("36 km/h", units.SPEED, 10.0),
        ("20 W/sr", units.RADIANT_INTENSITY, 20.0),
        ("3 mW/cm^2/sr", units.RADIANCE, 30.0),
        ("3 kW/(m^2 sr)", units.RADIANCE, 3000.0),
        ("2 kW/(m^2 K)", units.CONTACT_CONDUCTANCE, 2000.0),
    ],
)
def test_reads_quantity(text, dimension, value):
    assert to_si(text, dimension) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "dimension", "message"),
    [
        ("5 s", units.LENGTH, r"expected a length such as '2 mm', got '5 s'"),
        ("5 foo", units.LENGTH, r"unknown unit 'foo'"),
        ("mm", units.LENGTH, r"expected a length"),
        ("", units.LENGTH, r"expected a length"),
        ("20 C", units.TEMPERATURE, r"degC"),
        ("3 deg", units.NUMBER, r"expected a number"),
        ("30 %", units.ANGLE, r"expected an angle"),
        ("20 W", units.RADIANT_INTENSITY, r"such as '20 W/sr', got '20 W'"),
        ("20 W sr", units.RADIANT_INTENSITY, r"expected a radiant intensity"),
        ("20 W/m^2", units.RADIANCE, r"expected a radiance"),
        ("20 W/m^2/sr", units.IRRADIANCE, r"expected an irradiance"),
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
