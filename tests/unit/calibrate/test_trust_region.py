"""Damping: the unit of the residuals makes no difference to the steps."""

import functools

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import pytest

from calibrate.solvers.levenberg_marquardt import (
    FIRST_DAMPING,
    _first_size,
    with_trust_region,
)


STEEP = jnp.asarray(
    np.linspace(0.1, 2.0, 4)[:, None] * np.cos(np.outer(range(4), range(9)))
)


def residuals(z, unit):
    """Nonlinear residuals in any unit."""
    return unit * (jnp.sinh(z) @ STEEP - jnp.arange(9.0) / 9)


@functools.cache
def after_four_steps(unit, scaled):
    """Point of a search by then."""
    solver = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
    solver = with_trust_region(solver) if scaled else solver
    # An array, so that all units share a program.
    solution = optx.least_squares(
        residuals,
        solver,
        y0=jnp.zeros(4),
        args=jnp.asarray(unit),
        max_steps=4,
        throw=False,
    )
    return np.asarray(solution.value)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_steps_do_not_depend_on_the_unit_of_the_residuals(unit):
    same = after_four_steps(1.0, True)
    np.testing.assert_allclose(after_four_steps(unit, True), same, rtol=1e-9)
    # They do where the first damping is 1.
    off = after_four_steps(unit, False) - after_four_steps(1.0, False)
    assert np.abs(off).max() > 1e-3 * np.abs(same).max()


def test_the_first_size_is_of_the_steepness_along_the_slope():
    z = jnp.full(4, 0.3)
    jacobian, value = jax.jit(
        lambda z: (jax.jacobian(residuals)(z, 2.0), residuals(z, 2.0))
    )(z)
    jacobian = np.asarray(jacobian)
    slope = jacobian.T @ np.asarray(value)
    damping = FIRST_DAMPING * ((jacobian @ slope) ** 2).sum() / (slope**2).sum()
    size = jax.jit(lambda z: _first_size(linearized(z, 2.0)))(z)
    np.testing.assert_allclose(size, 1 / damping, rtol=1e-12)


def test_where_nothing_slopes_a_search_stays():
    def flat(z, unit):
        return 0 * z + unit

    solver = with_trust_region(optx.LevenbergMarquardt(1e-9, 1e-9))
    solution = optx.least_squares(
        flat, solver, jnp.ones(2), 1.0, max_steps=9, throw=False
    )
    np.testing.assert_array_equal(solution.value, [1.0, 1.0])


def test_no_number_moves_by_more_than_its_own_size():
    """A line whose end is far: it is gone to in steps of 1 for the farthest number."""

    def line(z, _):
        return z - jnp.asarray([3.5, -0.7])

    solver = with_trust_region(optx.LevenbergMarquardt(1e-9, 1e-9))

    def after(steps):
        return optx.least_squares(
            line, solver, jnp.zeros(2), max_steps=steps, throw=False
        ).value

    # The first step is for what is known at the start.
    np.testing.assert_allclose(after(2), [1.0, -0.2], rtol=1e-9)
    np.testing.assert_allclose(after(3), [2.0, -0.4], rtol=1e-9)
    np.testing.assert_allclose(after(40), [3.5, -0.7], rtol=1e-7)


def linearized(z, unit):
    """Residuals and Jacobian at a point, as optimistix holds them."""
    value, along = jax.linearize(lambda y: residuals(y, unit), z)
    shape = jax.ShapeDtypeStruct(z.shape, z.dtype)
    return optx.FunctionInfo.ResidualJac(value, lx.FunctionLinearOperator(along, shape))
