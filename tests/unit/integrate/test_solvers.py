"""What solvers decide before a run, and what they refuse."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.integrate.explicit import rkl2_coefficients, stage_count
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.solution import RESULTS
from jaxthermo.integrate.solvers import MAX_RKL2_STEPS, select_solver
from tests.bodies import blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)


def _scene(*terms, dtype: Dtype = "float64"):
    structure = jt.FullVolume(blocks(np.ones((3, 3, 3), bool), 0.01))
    return jt.Scene((jt.Body(structure, METAL, temperature=300.0),), terms, dtype=dtype)


def test_the_choice_goes_by_how_many_stable_steps_there_are():
    selected = [
        type(select_solver(1.0, steps)[0])
        for steps in (0, 1, MAX_RKL2_STEPS, MAX_RKL2_STEPS + 1)
    ]
    assert selected == [jt.SuperTimeStepping] * 3 + [jt.TRBDF2]
    assert select_solver(None, 1.0)[0] == jt.ForwardEuler()
    assert type(select_solver(float("inf"), 1e9)[0]) is jt.SuperTimeStepping


def test_the_choice_is_in_the_solution():
    run = jt.simulate(_scene(jt.Convection(10.0, 290.0)), 1e5).run
    assert run.solver == "SuperTimeStepping"
    assert run.time_error is not None and run.time_error <= 1e-3
    assert run.time_error_limit == 1e-3


def test_steps_that_nothing_else_determines_are_128_and_16_after_events():
    scene = _scene(jt.Convection(10.0, 290.0))
    solver = jt.SuperTimeStepping()

    def steps(*saves):
        return plan_run(scene, t1=1e5, save_at=saves, solver=solver).steps

    assert steps(1e5) == 128
    assert steps(10.0, 1e5) == 16 + 128


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.4, 10.0, 333.3, 1e6])
def test_stages_cover_the_step_and_no_more(ratio):
    stages = stage_count(ratio, 1.0)

    def covered(s):
        return (s * s + s - 2) / 4

    assert stages % 2 == 1
    assert covered(stages) >= ratio * (1 - 1e-8)
    assert stages == 3 or covered(stages - 2) < ratio


@pytest.mark.parametrize("stages", [3, 9, 31])
def test_a_mode_decays_by_the_schemes_polynomial_within_one(stages):
    """Of second order at small steps, and never above 1 up to the stable one."""
    table = rkl2_coefficients(stages)
    weight = 4 / (stages**2 + stages - 2)

    def factor(z):
        def step(y):
            return y * (1 - weight * z)

        previous = 1.0
        last = 1 - weight * z / 3
        for j in range(2, stages + 1):
            mu, nu, a = (table[name][j] for name in ("mu", "nu", "a"))
            mixed = (
                mu * step(last) + nu * previous + (1 - mu - nu) + a * mu * weight * z
            )
            previous, last = last, mixed
        return last

    off = [abs(factor(z) - np.exp(-z)) for z in (0.02, 0.01)]
    assert np.log2(off[0] / off[1]) == pytest.approx(3.0, abs=0.1)
    assert max(abs(factor(z)) for z in np.linspace(0, 2 / weight, 400)) <= 1 + 1e-12
    assert (np.diff(table["time"][1:]) > 0).all()
    assert table["time"][1:].max() < 1


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        (jt.BackwardEuler(dt=0.0), "dt=0 is no step"),
        (jt.TRBDF2(dt=float("nan")), "dt=nan is no step"),
        (
            jt.SuperTimeStepping(dt=100.0, stages=3),
            "too few for dt=100 s: .* requires [0-9]+",
        ),
        (jt.SuperTimeStepping(dt=1.0, stages=2), "give 3 or more"),
        (jt.ForwardEuler(dt=1e3), "another solver"),
    ],
)
def test_what_cannot_be_stepped_is_refused(solver, message):
    with pytest.raises(jt.InputError, match=message):
        jt.simulate(_scene(), 200.0, solver=solver)
    with pytest.raises(jt.InputError, match="give a positive one"):
        jt.TRBDF2(error=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dt", "steps"),
    [(2.56, 100), pytest.param(25.6, 5, marks=pytest.mark.slice), (25.6, 100)],
)
def test_a_tolerance_knows_its_rounding_floor(dt, steps):
    """A step of many stable steps multiplies the rounding of the temperatures."""
    structure = jt.FullVolume(blocks(np.ones((16, 16, 16), bool)))
    body = jt.Body(
        structure, jt.Material(1.0, density=1.0, specific_heat=1.0), temperature=300.0
    )
    held = jt.FixedTemperature(400.0, on=jt.Side((1.0, 0.0, 0.0)))
    runs = [
        jt.simulate(
            jt.Scene((body,), (held,), dtype=dtype),
            steps * dt,
            solver=jt.BackwardEuler(dt=dt),
        )
        for dtype in ("float32", "float64")
    ]
    single, double = (np.asarray(run.surface_temperature, float) for run in runs)
    np.testing.assert_allclose(single, double, rtol=0, atol=1e-3)
    statistics = runs[0].run.statistics
    assert statistics is not None
    assert float(statistics.largest_linear_residual) <= 2e-4


def test_a_tolerance_out_of_reach_is_said():
    scene = _scene(jt.Convection(1000.0, 290.0), dtype="float32")
    solver = jt.BackwardEuler(dt=100.0, tolerance=1e-12)
    run = jt.simulate(scene, 100.0, solver=solver, throw=False)
    assert run.result == RESULTS.linear_not_converged
    assert np.isfinite(run.surface_temperature).all()
    with pytest.raises(RuntimeError, match="use dtype float64"):
        jt.simulate(scene, 100.0, solver=solver)


# The stages of both implicit solvers are the same; one of them runs by default.
BOTH_WAYS = [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "TRBDF2"))
    for name in ("SuperTimeStepping", "BackwardEuler", "TRBDF2")
]


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_a_flux_that_is_not_finite_is_said_by_every_solver(name):
    bad = jt.HeatFlux(lambda time: 1e3 / (time - time))
    solver = jt.TRBDF2() if name == "TRBDF2" else getattr(jt, name)(dt=1.0)
    run = jt.simulate(_scene(bad), 2.0, solver=solver, throw=False)
    assert run.result != RESULTS.successful


# Implicit steps of what nothing happens to are those of an island in tests/stiff.
@pytest.mark.parametrize(
    "name", ["SuperTimeStepping", pytest.param("TRBDF2", marks=pytest.mark.slow)]
)
def test_nothing_to_do_is_done_by_every_solver(name):
    solver = getattr(jt, name)()
    run = jt.simulate(_scene(), 0.0, solver=solver)
    np.testing.assert_array_equal(run.surface_temperature, 300.0)
    still = jt.simulate(_scene(), 50.0, solver=solver)
    np.testing.assert_array_equal(still.surface_temperature, 300.0)
