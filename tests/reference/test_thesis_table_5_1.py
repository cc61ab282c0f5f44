"""Claim C01: the heating rates of the thesis' Table 5.1, q A / (rho c_p V)."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.material.table import thesis_material
from tests.bodies import bar
from tests.shallow import SHALLOW


FLUX = 31.15
"""Heat flux into one face of a cube of 1 m^3 [W/m^2], thesis 5.1."""

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
SECONDS = 1000


@pytest.fixture(scope="module")
def cube():
    return jt.FullVolume(bar(1, 1.0))


@pytest.mark.parametrize("name", TABLE)
def test_rate_to_three_digits(name):
    area = 1.0
    volume = 1.0
    material = thesis_material(name)
    rate = FLUX * area / (material.volumetric_heat_capacity * volume)
    assert f"{rate:.2e}" == TABLE[name]


@SHALLOW
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", TABLE)
def test_simulated_rate_to_three_digits(cube, name, dtype):
    """A second a step, each below one rounding of 300 K in float32 (S10)."""
    body = jt.Body(cube, thesis_material(name), temperature=300.0)
    flux = jt.HeatFlux(FLUX, on=jt.Side((0.0, 0.0, 1.0)))
    scene = jt.Scene((body,), (flux,), dtype=dtype)
    solution = jt.simulate(scene, float(SECONDS), solver=jt.ForwardEuler(dt=1.0))
    assert solution.run.steps == SECONDS
    stored = float(solution.energy.stored_J[0])
    capacity = thesis_material(name).volumetric_heat_capacity
    assert f"{stored / capacity / SECONDS:.2e}" == TABLE[name]
    # What the user reads is in kelvin, and rounded there: to 3e-5 K in float32.
    rise = float(solution.mean_temperature[0, 0]) - 300.0
    rounding = float(np.spacing(np.asarray(300.0, dtype)))
    assert rise == pytest.approx(float(TABLE[name]) * SECONDS, rel=6e-3, abs=rounding)
