"""Wind whose coefficient is linear in its speed."""

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError


AIR = 290.0
HEAT_FLUX = 100.0


def plate(*terms):
    grid = jt.voxelize(jt.shapes.box((0.02, 0.02, 0.02)), 0.01)
    metal = jt.Material(400.0, density=8000.0, specific_heat=400.0)
    body = jt.Body(jt.FullVolume(grid), metal, temperature=AIR)
    return jt.Scene((body,), terms, dtype="float64")


def test_a_heated_plate_stands_above_the_air_by_its_coefficient():
    """T - T_inf = q / (h_0 + c v) in the steady state."""
    wind = jt.LinearWind(4.0, AIR, calm=3.0, by_speed=2.0)
    solution = jt.steady(plate(wind, jt.HeatFlux(HEAT_FLUX)))
    excess = np.asarray(solution.surface_temperature) - AIR
    np.testing.assert_allclose(excess, HEAT_FLUX / (3.0 + 2.0 * 4.0), rtol=1e-6)


@pytest.mark.parametrize(
    "speed", [jt.Table([0.0, 60.0], [1.0, 5.0]), lambda time: 1.0 + time / 15.0]
)
def test_a_changing_speed_changes_the_coefficient(speed):
    wind = jt.LinearWind(speed, AIR)
    coefficient = jt.Table([0.0, 60.0], [2.8 + 3.0, 2.8 + 15.0])
    by_coefficient = jt.Convection(coefficient, AIR)
    runs = [
        jt.simulate(plate(term, jt.HeatFlux(HEAT_FLUX)), 60.0)
        for term in (wind, by_coefficient)
    ]
    by_wind, expected = (np.asarray(run.surface_temperature) for run in runs)
    np.testing.assert_allclose(by_wind, expected, rtol=1e-6)
    assert expected.max() > AIR + 0.1


@pytest.mark.parametrize("field", ["calm", "by_speed"])
def test_the_derivative_by_each_number_is_that_of_differences(field):
    def mean(number):
        wind = jt.LinearWind(4.0, AIR - 20.0, **{field: number})
        run = jt.simulate(plate(wind), 20.0, solver=jt.ForwardEuler(0.2))
        return run.surface_temperature[-1].mean()

    derivative = jax.grad(mean)(2.9)
    difference = (mean(2.9 + 1e-3) - mean(2.9 - 1e-3)) / 2e-3
    assert abs(difference) > 1e-4
    np.testing.assert_allclose(derivative, difference, rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"speed": -1.0}, r"speed \[m/s\]"),
        ({"speed": 1.0, "calm": -1.0}, "calm"),
        ({"speed": 1.0, "by_speed": float("nan")}, "by_speed"),
    ],
)
def test_mistakes(arguments, text):
    with pytest.raises(InputError, match=text):
        jt.LinearWind(temperature=AIR, **arguments)
