"""Searches from any start: steps in time, convergence, scales, and names of numbers."""

import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from calibrate.config.loader import load_calibration
from calibrate.config.scales import typical_size, usable_start
from calibrate.config.schema import FitConfig, default_bounds
from calibrate.problem.bijections import bijection
from calibrate.problem.build import build
from calibrate.problem.time_steps import STEP_MARGIN, TimeSteps, is_beyond, is_stable
from calibrate.run import fit_config
from calibrate.solvers.fit import Fitting
from calibrate.solvers.optimality import _gauss_newton_step, _is_minimum
from calibrate.solvers.starts import search_starts
from jaxthermo.config.schema.scene import lowest_of
from jaxthermo.integrate.run.parametric_run import ParametricRun
from tests.calibrating import SAVES, scene, twin


FOLDER = Path(__file__).parents[2] / "data" / "frames_and_api"
CONTROL = {
    "material.conductivity": (19.84, 0.195),
    "convection.heat_transfer_coefficient": (29.52, 1.07),
}
"""Values of the control and their standard errors."""


def test_two_names_of_one_number_are_refused():
    config = load_calibration(FOLDER / "05-same-number-twice" / "calibration.yaml", ())
    with pytest.raises(jt.InputError, match="leave one of them out") as refused:
        build(config, lambda stage: None)
    for name in ("convection", "terms.1"):
        assert f"{name}.heat_transfer_coefficient" in str(refused.value)


def test_signs_are_those_of_the_quantity_whatever_its_start():
    for start in (0.0, 20.0):
        assert default_bounds("sun.irradiance.value", start) == (0.0, math.inf)
        assert default_bounds("terms.0.heat_transfer_coefficient", start)[0] == 0.0
        assert default_bounds("terms.0.heat_flux", start) == (-math.inf, math.inf)
        assert default_bounds("terms.0.heat_rate", start) == (-math.inf, math.inf)
    assert lowest_of("material.conductivity") == 0.0
    assert lowest_of("no.such.number") is None


def test_a_start_of_zero_changes_by_the_typical_size_of_its_unit():
    assert typical_size("terms.0.heat_flux") == 100.0
    assert typical_size("cameras.0.rotation") == 0.01
    mapping = bijection(
        np.zeros(()),
        lower=-math.inf,
        upper=math.inf,
        typical_size=typical_size("terms.0.heat_flux"),
    )
    assert float(mapping.value(np.ones(()))) == 100.0
    assert usable_start("sun.irradiance.value", 0.0, 0.0) == 100.0
    assert usable_start("sun.irradiance.value", 5.0, 0.0) == 5.0


def test_steps_divide_the_same_intervals_and_follow_the_limit():
    run = ParametricRun(SAVES)
    block = scene((1.0, 0.0, 0.0))
    fewest = run.fewest_steps(block)
    # So short that rounding to whole steps does not matter.
    limit = 0.01 * float(run.longest_step(block))
    steps = TimeSteps((run,), (fewest,))
    lengths = np.diff([0.0, *SAVES])
    for factor in (0.1, 1.0, 7.0):
        (table,) = steps.at(np.array([factor * limit]))
        np.testing.assert_allclose((table.dt * table.steps).sum(axis=1), lengths)
        needed = np.ceil(lengths * STEP_MARGIN / (factor * limit) * (1 - 1e-6))
        np.testing.assert_array_equal(table.steps[:, 0], needed)
        assert bool(is_stable(table, jnp.asarray(factor * limit)))
    table = steps.at(np.array([limit]))
    # Within the margin they stay; beyond it, and far below it, they are made again.
    for factor, stays in ((0.9, True), (1.5, True), (0.5, False), (5.0, False)):
        followed = steps.followed(table, np.array([factor * limit]))
        assert (followed[0] is table[0]) == stays
        assert bool(is_stable(followed[0], jnp.asarray(factor * limit)))
    assert not bool(is_stable(table[0], jnp.asarray(0.5 * limit)))


def test_a_scheme_of_any_stable_step_keeps_its_own():
    run = ParametricRun(SAVES, jt.BackwardEuler(dt=0.5))
    fewest = run.fewest_steps(scene((1.0, 0.0, 0.0)))
    (table,) = TimeSteps((run,), (fewest,)).at(np.array([math.inf]))
    np.testing.assert_array_equal(table.steps[:, 0], [4, 8])


def test_a_trial_without_a_stable_step_is_beyond_the_limit():
    first = np.array([1.0, math.inf])
    assert not is_beyond(np.array([0.1, math.inf]), first)
    assert is_beyond(np.array([1e-3, math.inf]), first)
    assert is_beyond(np.array([math.nan, math.inf]), first)


def test_the_gradient_tells_how_far_the_minimum_is():
    """The minimum of a linear model is known: it is one step away, and lowers the loss
    to that of least squares."""
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(3, 40)) * np.array([[1.0], [1e-3], [1e2]])
    residual = rng.normal(size=40)
    solution, (squares,), *_ = np.linalg.lstsq(rows.T, -residual, rcond=None)
    decrease = 0.5 * (residual @ residual - squares)
    # In coordinates of which the step is a thousandth.
    scaled = rows * 1e3 * np.abs(solution).max()
    assert _gauss_newton_step(scaled, residual, 1e-8) == pytest.approx(
        (1e-3, decrease), rel=1e-6
    )
    at_minimum = residual + rows.T @ solution
    for values, converged in ((residual, False), (at_minimum, True)):
        assert converged == _is_minimum(
            _gauss_newton_step(scaled, values, 1e-8),
            loss=0.5 * float(values @ values),
            sd=1.0,
            tolerance=1e-3,
            resolution=1e-8,
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("12-start-stiffer-than-the-scene", ()),
        ("12-several-starts", ()),
        # The library's L-BFGS mixes types in single precision where double is enabled.
        ("15-lbfgs-stops-at-twice-the-stiffness", ("set.dtype=float64",)),
        ("16-scene-with-a-step", ()),
    ],
)
def test_a_fit_ends_at_the_control_from_wherever_it_starts(tmp_path, name, overrides):
    result = fit_config(
        FOLDER / name / "calibration.yaml", tmp_path, overrides=overrides, report=False
    )
    assert result["ended"] == "converged"
    for parameter, (value, error) in CONTROL.items():
        fitted = result["parameters"][parameter]["value"]
        assert fitted == pytest.approx(value, abs=0.2 * error)
    errors = result["error_percent"]["train"]
    # Before the fit k was 12 or 6 for 20, whatever it started from.
    assert errors["default"] > 15 * errors["fitted"]


@pytest.mark.slow
def test_a_start_of_zero_ends_where_one_of_one_does(tmp_path):
    values = []
    for start in ("0", "1"):
        result = fit_config(
            FOLDER / "06-start-of-zero" / "calibration.yaml",
            tmp_path / start,
            overrides=(f"parameters.0.start={start}",),
            report=False,
        )
        assert result["ended"] == "converged"
        values.append(result["parameters"]["sun.irradiance.value"]["value"])
    assert values[0] == pytest.approx(values[1], rel=2e-3)
    assert values[0] == pytest.approx(4.13e3, rel=0.01)


@pytest.mark.slow
def test_a_search_at_a_wall_says_so(monkeypatch):
    """The truth is six times as stiff as the start, and runs may be 1.5 times so."""
    monkeypatch.setattr("calibrate.problem.time_steps.MAX_STIFFENING", 1.5)
    problem = twin(truth={"weights.within": 6.0, "weights.between": 1.0})
    fit = Fitting(problem, FitConfig(tolerance=1e-6, max_steps=40)).run()
    assert fit.ended == "at the limit of its steps"


@pytest.mark.slow
def test_a_start_that_is_far_too_stiff_is_left_out_with_a_line(monkeypatch):
    """Here it is one that is 1.5 times as stiff as the others."""
    monkeypatch.setattr("calibrate.solvers.starts.MAX_STIFFENING", 1.5)
    problem = twin(truth={"weights.within": 2.0, "weights.between": 1.5})
    fitting = Fitting(problem, FitConfig(tolerance=1e-6, max_steps=40))
    close = np.zeros((3, problem.parameters.size))
    close[1:] += [[0.1], [-0.1]]
    stiff = np.full((1, problem.parameters.size), 20.0)
    lines = []
    ends = search_starts(fitting, np.concatenate([close, stiff]), log=lines.append)
    assert [line.partition(":")[0] for line in lines] == ["start 4 of 4 is left out"]
    alone = search_starts(fitting, close)
    np.testing.assert_allclose(ends.best, alone.best, atol=1e-3)
