"""Claim C01: the heating rates of the thesis' Table 5.1, q A / (rho c_p V)."""

import pytest

from jaxthermo.materials import thesis_material


FLUX = 31.15
"""What the thesis lets one face of a cube of 1 m^3 absorb [W/m^2], section 5.1."""

# Name and dT/dt [K/s], as printed to three digits in Table 5.1.
TABLE = {
    "platinum": "1.08e-05",
    "gold": "1.28e-05",
    "mercury": "1.64e-05",
    "lead": "2.15e-05",
    "silver": "1.27e-05",
    "copper": "9.01e-06",
    "iron": "8.91e-06",
    "diamond": "1.75e-05",
    "aluminium": "1.29e-05",
    "water": "7.44e-06",
    "ethanol": "1.62e-05",
    "gasoline": "1.92e-05",
}


@pytest.mark.parametrize("name", TABLE)
def test_rate_to_three_digits(name):
    area, volume = 1.0, 1.0
    material = thesis_material(name)
    rate = FLUX * area / (material.volumetric_heat_capacity * volume)
    assert f"{rate:.2e}" == TABLE[name]
