"""Kept Jacobians: Broyden's update, and fits that come to the same values."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from calibrate.config.schema import FitConfig
from calibrate.solvers.fit import Fitting
from calibrate.solvers.levenberg_marquardt import (
    BroydenLevenbergMarquardt,
    _broyden_update,
)
from tests.calibrating import twin


ROWS = jnp.asarray(np.cos(np.outer([1.0, 2.0, 3.0], np.arange(5.0))))
FIRST = jnp.asarray([0.3, -0.2, 1.0])


def linear(z):
    """Linear residuals."""
    return z @ ROWS + 1.0


def updated(rows, step, start=FIRST):
    return _broyden_update(rows, step, linear(start + step) - linear(start))


def test_exact_rows_stay():
    corrected = updated(ROWS, jnp.full(3, 0.5))
    np.testing.assert_allclose(corrected, ROWS, atol=1e-14)


def test_corrected_rows_reproduce_the_change_and_keep_what_is_across_it():
    wrong = ROWS + 0.1
    step = jnp.asarray([0.25, 0.0, -0.5])
    corrected = updated(wrong, step)
    np.testing.assert_allclose(step @ corrected, linear(FIRST + step) - linear(FIRST))
    across = jnp.asarray([0.5, 7.0, 0.25])
    assert across @ step == 0
    np.testing.assert_allclose(across @ corrected, across @ wrong, atol=1e-13)


def test_orthogonal_steps_make_any_rows_exact():
    z = FIRST
    rows = jnp.zeros_like(ROWS)
    for step in jnp.eye(3):
        rows = updated(rows, step, z)
        z = z + step
    np.testing.assert_allclose(rows, ROWS, atol=1e-13)


def test_where_nothing_moved_rows_stay():
    np.testing.assert_array_equal(updated(ROWS, jnp.zeros(3)), ROWS)


def test_rows_live_in_the_state_of_the_solver():
    """Exact at the first point, and corrected at the second."""
    solver = BroydenLevenbergMarquardt(1e-9, 1e-9)

    def function(z, args):
        return (linear(jnp.sinh(z)), args)

    state = solver.init(function, FIRST, None, {}, jnp.zeros(5), None, frozenset())
    z, state, _ = solver.step(function, FIRST, None, {}, state, frozenset())
    exact = jnp.cosh(FIRST)[:, None] * ROWS
    np.testing.assert_allclose(state.f_info.jac.as_matrix().T, exact)
    step = state.y_eval - z
    change = function(state.y_eval, None)[0] - function(z, None)[0]
    _, state, _ = solver.step(function, z, None, {}, state, frozenset())
    jacobian = state.f_info.jac.as_matrix().T
    np.testing.assert_allclose(
        jacobian, _broyden_update(exact, step, change), rtol=1e-12
    )


@pytest.mark.parametrize("use_broyden", [True, False])
def test_optimistix_drives_the_solver(use_broyden):
    solver = BroydenLevenbergMarquardt(1e-10, 1e-10, use_broyden=use_broyden)
    target = linear(jnp.sinh(FIRST))

    def function(z, _):
        return linear(jnp.sinh(z)) - target

    solution = optx.least_squares(function, solver, FIRST + 0.3, max_steps=60)
    np.testing.assert_allclose(solution.value, FIRST, atol=1e-8)


@pytest.mark.slow
def test_a_fit_comes_to_the_values_of_one_with_exact_jacobians():
    problem = twin()
    settings = FitConfig(tolerance=1e-7)
    exact = Fitting(problem, settings, use_broyden=False).run()
    broyden_fit = Fitting(problem, settings).run()
    assert all(s.exact for s in exact.steps)
    assert sum(s.exact for s in broyden_fit.steps) < len(exact.steps)
    np.testing.assert_allclose(broyden_fit.z, exact.z, atol=1e-6)
    assert broyden_fit.loss < 1e-8 * broyden_fit.initial_loss
