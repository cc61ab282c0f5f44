"""Fits: the truth is found by every method, a stop goes on, one trace does it all."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from calibrate.config.schema import FitConfig
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.targets import SurfaceTarget
from calibrate.solvers.fit import Fitting
from calibrate.solvers.noise_scale import noise_scale
from calibrate.solvers.progress import STAGNATION_LIMIT
from calibrate.solvers.search import start_points
from calibrate.solvers.starts import search_starts
from tests.calibrating import BETWEEN, TRUTH, WITHIN, twin


def _found(problem, fit):
    values = problem.parameters.values(fit.z)
    return {name: float(value) for name, value in values.items()}


@pytest.fixture(scope="module")
def problem():
    return twin()


@pytest.fixture(scope="module")
def fit(problem):
    """By Levenberg-Marquardt, of data without noise."""
    return Fitting(problem, FitConfig(tolerance=1e-9, max_steps=60)).run()


def _is_the_truth(problem, fit):
    """Within 1e-4 of the values that made the data."""
    assert _found(problem, fit) == pytest.approx(TRUTH, rel=1e-4)
    assert fit.loss < 1e-8 * fit.initial_loss


# By default `calibrate fit` runs a whole fit, and its steps have tests of their own.
@pytest.mark.slow
@pytest.mark.slice
def test_the_truth_is_found(problem, fit):
    _is_the_truth(problem, fit)


@pytest.mark.slow
@pytest.mark.slice
def test_a_fit_ends_by_trials_from_an_exact_jacobian(fit):
    assert fit.ended == "converged"
    refreshes = [n for n, step in enumerate(fit.steps) if step.refresh]
    assert refreshes[0] == 0
    assert not all(step.exact for step in fit.steps)
    assert 1 <= len(fit.steps) - 1 - refreshes[-1] <= STAGNATION_LIMIT
    assert all(len(step.values) == len(TRUTH) for step in fit.steps)


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [
        "gauss_newton",
        "bfgs",
        "lbfgs",
    ],
)
def test_the_truth_is_found_by_other_methods(problem, method):
    second_fitting = Fitting(
        problem, FitConfig(method=method, tolerance=1e-9, max_steps=60)
    ).run()
    _is_the_truth(problem, second_fitting)
    assert all(step.exact for step in second_fitting.steps)


@pytest.mark.slow
def test_a_fit_that_is_stopped_goes_on_to_the_same_result(problem, tmp_path):
    setting = FitConfig(tolerance=1e-6)
    uninterrupted = Fitting(problem, setting).run()
    count = [0]

    def stop():
        count[0] += 1
        return count[0] > 3

    checkpoint = tmp_path / "state.npz"
    interrupted = Fitting(problem, setting).run(checkpoint=checkpoint, stop=stop)
    assert interrupted.ended == "interrupted"
    assert len(interrupted.steps) == 3
    continued = Fitting(problem, setting).run(checkpoint=checkpoint)
    np.testing.assert_array_equal(continued.z, uninterrupted.z)
    assert [s.loss for s in continued.steps] == [s.loss for s in uninterrupted.steps]


@pytest.mark.slow
def test_a_stiffer_fit_takes_more_steps_instead_of_becoming_unstable():
    """The truth conducts six times as well as the start: steps at the start's limit
    would blow up on the way there."""
    truth = {"weights.within": 6.0, "weights.between": 1.0}
    problem = twin(truth=truth)
    fit = Fitting(problem, FitConfig(tolerance=1e-9)).run()
    # As near as the steps of fit and data, which differ, let it come.
    assert _found(problem, fit)["weights.within"] == pytest.approx(6.0, rel=0.02)
    assert fit.loss < 1e-4 * fit.initial_loss


@pytest.mark.slow
def test_the_loss_is_that_of_the_values_returned(problem):
    fit = Fitting(problem, FitConfig(tolerance=1e-3, max_steps=2)).run()
    step_tables = problem.step_tables_at(fit.z)
    rows, _ = problem.residuals(fit.z, step_tables)
    assert fit.loss == pytest.approx(0.5 * float((rows**2).sum()), rel=1e-6)


@pytest.mark.slow
def test_outliers_weigh_less_by_a_robust_loss():
    """A tenth of the data far off: squares follow them, the robust loss hardly does."""
    problem = twin()
    target = problem.cases[0].target
    assert isinstance(target, SurfaceTarget)
    spoiled = np.array(target.reference)
    spoiled[:, ::10] += 30.0
    object.__setattr__(target, "reference", jnp.asarray(spoiled))
    errors = {}
    for name, huber in (("squares", None), ("robust", 1.0)):
        fit = Fitting(problem, FitConfig(tolerance=1e-7, huber=huber)).run()
        fitted_values = _found(problem, fit)
        errors[name] = max(abs(fitted_values[n] / TRUTH[n] - 1) for n in TRUTH)
    assert errors["robust"] < 0.3 * errors["squares"]


def test_the_knee_of_a_robust_loss_does_not_follow_outliers():
    """A tenth of normal numbers is off by a million of their standard deviations."""
    residual = np.random.default_rng(3).normal(0.0, 2.0, 10_000)
    residual[::10] += 2e6
    # The median of the magnitudes lies at 0.5 / 0.9 of the others: 0.764 deviations.
    expected = 2.0 * 1.4826 * 0.7647
    scale = noise_scale(jnp.asarray(residual), None)
    assert scale == pytest.approx(expected, rel=0.03)
    # What is not compared, or not finite, has no part in it.
    padded = np.concatenate([residual, np.zeros(9000), [np.nan, np.inf]])
    assert noise_scale(jnp.asarray(padded), None) == pytest.approx(scale)
    assert noise_scale(jnp.asarray(residual), 0.05) == 0.05
    assert noise_scale(jnp.zeros(4), None) == np.inf


def test_more_parameters_than_residuals_are_refused():
    """428 pixels of one load, and 431 numbers."""
    sizes = {
        "links": 423, "within": 2, "capacity": 2, "between": 1, "surface": 1,
        "nearest_capacity": 1, "surface_distance": 1,
    }  # fmt: skip
    many = tuple(
        Parameter(
            name=f"weights.{name}",
            start=(0.9,) * n,
            lower=0.1,
            upper=10.0,
            is_scalar=n == 1,
        )
        for name, n in sizes.items()
    )
    problem = twin(many)
    problem = replace(problem, cases=problem.cases[:1])
    with pytest.raises(jt.InputError, match="431 parameters and 428 residuals"):
        Fitting(problem, FitConfig()).run()


def test_a_loss_that_is_not_finite_at_the_start_is_refused():
    problem = twin()
    problem = replace(problem, cases=problem.cases[:1])
    target = problem.cases[0].target
    assert isinstance(target, SurfaceTarget)
    nothing = jnp.full(target.reference.shape, jnp.nan)
    object.__setattr__(target, "reference", nothing)
    with pytest.raises(jt.InputError, match="not finite at the start"):
        Fitting(problem, FitConfig()).run()


@pytest.mark.slow
def test_the_best_of_several_starts_is_where_one_alone_ends(problem):
    """Searched together, from far apart."""
    fitting = Fitting(problem, FitConfig(tolerance=1e-9, max_steps=40))
    z = search_starts(fitting, start_points(4, 2, 0.5, seed=3)).best
    values = problem.parameters.values(z)
    assert {n: float(v) for n, v in values.items()} == pytest.approx(TRUTH, rel=1e-4)


@pytest.mark.parametrize(
    ("parameters", "settings", "device_count", "message"),
    [
        (2, {}, 1, "there is 1 cpu device; give at most 1"),
        (2, {}, 8, "the derivatives of 2 values and 1 start; give at most 2"),
        (2, {"starts": 3}, 8, "derivatives of 2 values and 3 starts; give at most 3"),
        (1, {}, 8, "the derivatives of 1 value and 1 start; leave devices out"),
        (2, {"method": "lbfgs", "starts": 9}, 8, "lbfgs computes one derivative"),
    ],
)
def test_devices_that_have_nothing_to_share_are_refused(
    problem, monkeypatch, parameters, settings, device_count, message
):
    monkeypatch.setattr(jax, "device_count", lambda: device_count)
    fewer = ParameterSet(problem.parameters.parameters[:parameters])
    small = replace(problem, parameters=fewer)
    with pytest.raises(jt.InputError, match=f"^devices=4: .*{message}") as refused:
        Fitting(small, FitConfig(**settings), devices=4)
    assert "\n" not in str(refused.value)


def test_parameters_that_set_the_same_place_are_refused():
    with pytest.raises(jt.InputError, match="it is there twice"):
        twin((WITHIN, BETWEEN, WITHIN))
