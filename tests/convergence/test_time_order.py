"""Every solver's order in time, with sun, air and emission; and energy closes."""

import functools

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from tests.bodies import blocks


END = 400.0
OFF = 200.0
STONE = jt.Material(1.5, density=2000.0, specific_heat=800.0, emissivity=0.9)
ORDERS = {
    "BackwardEuler": (jt.BackwardEuler, 1.0),
    "SuperTimeStepping": (jt.SuperTimeStepping, 2.0),
    "CrankNicolson": (jt.CrankNicolson, 2.0),
    "TRBDF2": (jt.TRBDF2, 2.0),
}


@functools.cache
def _scene(dtype: Dtype = "float64"):
    structure = jt.FullVolume(blocks(np.ones((5, 4, 3), bool), 0.01))
    body = jt.Body(structure, STONE, temperature=300.0)
    sun = jt.Sun((1.0, 0.0, -0.5), jt.Until(1500.0, OFF))
    # The air warms, so that loads vary within a step.
    air = jt.Convection(15.0, jt.Table([0.0, END], [290.0, 310.0]))
    return jt.Scene((body,), (sun, air, jt.Surroundings(280.0)), dtype=dtype)


def _run(solver, dtype="float64"):
    return jt.simulate(_scene(dtype), END, [OFF, END], solver=solver)


@functools.cache
def _exact():
    """A step so small that what it is off by counts for nothing."""
    return np.asarray(_run(jt.SuperTimeStepping(dt=0.5)).surface_temperature)


# The implicit solvers share their stages; in CI the one that is selected runs.
_SLOW = [pytest.mark.slow]
MARKS = {
    "BackwardEuler": _SLOW,
    "CrankNicolson": _SLOW,
    "TRBDF2": [*_SLOW, pytest.mark.slice],
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=MARKS.get(name, [])) for name in ORDERS],
)
def test_the_error_falls_at_the_order(name):
    make, order = ORDERS[name]
    steps = np.array([20.0, 10.0, 5.0])
    solutions = [_run(make(dt=float(dt))) for dt in steps]
    errors = [np.abs(s.surface_temperature - _exact()).max() for s in solutions]
    observed = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    print(name, "errors", errors, "orders", observed)
    assert observed[-1] == pytest.approx(order, abs=0.2)
    for solution in solutions:
        assert np.abs(solution.energy.residual_relative).max() < 1e-12


@pytest.mark.slow
def test_the_error_of_adaptive_steps_follows_what_is_asked():
    asked = (1e-2, 1e-3, 1e-4)
    runs = [_run(jt.TRBDF2(error=error)) for error in asked]
    off = [np.abs(run.surface_temperature - _exact()).max() for run in runs]
    efforts = [run.run.statistics for run in runs]
    step_counts = [
        int(effort.accepted_steps) for effort in efforts if effort is not None
    ]
    print("asked", asked, "off", off, "steps", step_counts)
    assert off[0] > off[1] > off[2]
    assert all(error < 3 * limit for error, limit in zip(off, asked, strict=True))
    assert step_counts[0] < step_counts[1] < step_counts[2]
    # Of a method whose error a step is of third order.
    assert step_counts[2] / step_counts[1] == pytest.approx(10 ** (1 / 3), rel=0.4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ORDERS)
def test_single_precision_closes_energy_too(name):
    make, _ = ORDERS[name]
    run = _run(make(dt=10.0), "float32")
    double = _run(make(dt=10.0))
    assert np.abs(run.energy.residual_relative).max() < 1e-5
    ends = [np.asarray(r.surface_temperature, float) for r in (run, double)]
    off = np.abs(ends[0] - ends[1]).max()
    print(name, "float32 off", off)
    assert off < 2e-3
