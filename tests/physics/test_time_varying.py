"""Values that change with time: exact ramps, sampled functions, mistakes."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from tests.bodies import blocks
from tests.shallow import SHALLOW


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
TOP = jt.Side((0.0, 0.0, 1.0))


@pytest.fixture(scope="module")
def voxel():
    """One voxel, insulated: its stable step is infinite."""
    body = jt.FullVolume(blocks(np.ones((1, 1, 1), bool), 0.1))
    return lambda flux: jt.Scene(
        (jt.Body(body, METAL, temperature=300.0),),
        (jt.HeatFlux(flux, on=TOP),),
        dtype="float64",
    )


def heat(scene: jt.Scene, end: float) -> float:
    return float(jt.simulate(scene, end).energy.mechanisms["heat_flux"][-1])


def test_the_heat_of_a_piecewise_linear_flux_is_exact(voxel):
    flux = jt.Table([0.0, 3.0, 10.0], [0.0, 600.0, 100.0])
    exact = 0.01 * (3.0 * 300.0 + 7.0 * 350.0)
    assert heat(voxel(flux), 10.0) == pytest.approx(exact, rel=1e-12)


def test_a_pulse_inside_the_run_is_not_missed(voxel):
    flux = jt.Until(jt.Table([0.0, 4.0], [0.0, 800.0]), 2.0)
    assert heat(voxel(flux), 100.0) == pytest.approx(0.01 * 2.0 * 200.0, rel=1e-12)


SOLVERS = {
    "error control": None,
    "Euler": jt.ForwardEuler(),
    "stages": jt.SuperTimeStepping(dt=2.5),
    "implicit Euler": jt.BackwardEuler(dt=2.5),
    "trapezoidal": jt.CrankNicolson(dt=2.5),
    "adaptive": jt.TRBDF2(),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_the_heat_of_a_function_of_time_does_not_depend_on_the_steps(voxel, name):
    scene = voxel(lambda t: 500.0 * jnp.sin(np.pi * t / 10.0))
    solution = jt.simulate(scene, 10.0, solver=SOLVERS[name])
    exact = 0.01 * 500.0 * 2 * 10.0 / np.pi
    absorbed = solution.energy.mechanisms["heat_flux"][-1]
    assert float(absorbed) == pytest.approx(exact, rel=1e-7)


@SHALLOW
def test_a_switch_at_a_landing_is_on_before_and_off_after(voxel):
    scene = voxel(jt.Until(1000.0, 5.0))
    saves = [5.0, 20.0]
    solution = jt.simulate(scene, 20.0, saves, solver=jt.ForwardEuler())
    heat = np.asarray(solution.energy.mechanisms["heat_flux"])
    assert_allclose(heat, 0.01 * 1000.0 * 5.0, rtol=1e-12)


def test_a_switched_zero_is_left_out(voxel):
    receipt = jt.compile_scene(voxel(jt.Until(0.0, 5.0))).receipt
    assert "heat_flux" not in receipt.included


@SHALLOW
def test_taking_out_more_heat_than_there_is_says_so(voxel):
    scene = voxel(-1e9)
    with pytest.raises(RuntimeError, match="below 0 K"):
        jt.simulate(scene, 1e3)
    assert jt.simulate(scene, 1e3, throw=False).result == jt.RESULTS.below_zero


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: jt.Convection(-1.0, 300.0), "heat_transfer_coefficient"),
        (lambda: jt.Convection(1.0, float("nan")), "temperature"),
        (lambda: jt.Convection(jt.Table([0.0, 1.0], [1.0, -1.0]), 300.0), "at least 0"),
        (lambda: jt.Sun((0.0, 0.0, -1.0), -5.0), "irradiance"),
        (lambda: jt.Surroundings(-3.0), "temperature"),
        (lambda: jt.FixedTemperature(float("inf")), "temperature"),
        (lambda: jt.HeatFlux(jt.Until(float("nan"), 3.0)), "finite"),
    ],
)
def test_impossible_values_are_refused(make, word):
    with pytest.raises(jt.InputError, match=word):
        make()
