"""Intervals of 95 % hold the truth as often as they say, of frames with 50 mK noise."""

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.analysis.identifiability import identify
from calibrate.config.schema import FitConfig
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from calibrate.solvers.fit import Fitting
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.scene.compile.compile import compile_scene
from tests.calibrating import camera_of_block, frames_of, seen_block, target_of


SAVES = (20.0, 60.0, 120.0)
WIDE = 1.96
TRUTH = {
    "material.conductivity": 16.0,
    "convection.heat_transfer_coefficient": 30.0,
    "material.emissivity": 0.8,
}
START = (11.0, 40.0, 0.6)
BOUNDS = ((1.0, 1000.0), (1.0, 1000.0), (0.05, 1.0))
CAMERA = camera_of_block(20, 16)


def _scene(conductivity, coefficient, emissivity):
    return seen_block(
        temperature=350.0,
        surroundings=220.0,
        conductivity=conductivity,
        coefficient=coefficient,
        emissivity=emissivity,
    )


@pytest.fixture(scope="module")
def fitting():
    """Fits of frames without noise, which is added to the residuals."""
    true = _scene(*TRUTH.values())
    start = _scene(*START)
    # The same steps for data and fits: what is left is noise alone.
    run = ParametricRun(SAVES, jt.ForwardEuler(dt=2.0))
    solution = run(true, run.step_table(start))
    view = compute_view(compile_scene(true, 1, 1.0).surfaces, true.terms, CAMERA)
    frames = frames_of(view, true, solution, SAVES)
    target = target_of(view, frames, SAVES)
    fitted = tuple(
        Parameter(name, (value,), *bounds)
        for name, value, bounds in zip(TRUTH, START, BOUNDS, strict=True)
    )
    case = Case(name="frames", scene=start, run=run, target=target)
    return Fitting(Problem(ParameterSet(fitted), (case,)), FitConfig(tolerance=1e-6))


def _covered(fitting, repeats):
    """How often each parameter's interval holds its truth."""
    sd = fitting.problem.known_sd
    count = round(1 / sd**2)
    covered = np.zeros(len(TRUTH), int)
    for seed in range(repeats):
        noise = sd * np.random.default_rng(seed).standard_normal(count)
        fit = fitting.run(noise=noise)
        identified = identify(
            fitting.problem.parameters, z=fit.z, jacobian=fit.jacobian, sd=sd
        )
        for n, (verdict, true) in enumerate(
            zip(identified.verdicts, TRUTH.values(), strict=True)
        ):
            assert verdict.standard_error is not None
            covered[n] += abs(verdict.value - true) <= WIDE * verdict.standard_error
    return covered


@pytest.mark.slow
def test_the_truth_lies_in_95_percent_of_the_intervals(fitting):
    covered = _covered(fitting, 100)
    print("covered of 100", covered)
    assert (covered >= 90).all()
    assert (covered <= 99).all()
