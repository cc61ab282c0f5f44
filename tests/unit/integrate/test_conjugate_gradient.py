"""Conjugate gradients that stop in kelvin: solutions, reports and derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from jaxthermo.integrate.implicit.conjugate_gradient import (
    BiCGStab,
    ConjugateGradient,
    CorrectionNorm,
    ResidualNorm,
)


SIZE = 40
KELVIN = np.geomspace(1e-6, 1e3, SIZE)
"""1 / C of nodes of very different size."""


def _matrix(weight=1.0):
    """A chain whose conductances and capacities differ by nine decades."""
    links = np.geomspace(1e-3, 1e3, SIZE - 1)
    laplace = np.diag(np.append(links, 0) + np.append(0, links))
    laplace -= np.diag(links, 1) + np.diag(links, -1)
    return jnp.asarray(laplace) + jnp.diag(weight / KELVIN)


@eqx.filter_jit
def _solve(weight, vector, kelvin, tolerance, start=None, max_iterations=2000):
    matrix = _matrix(weight)
    diagonal = jnp.diagonal(matrix)
    operator = lx.FunctionLinearOperator(
        lambda u: (matrix @ u[0],),
        jax.eval_shape(lambda: (vector,)),
        lx.positive_semidefinite_tag,
    )

    def scale(d, r):
        return (r[0] / d,)

    fixed = jax.lax.stop_gradient(diagonal)
    preconditioner = jax.tree_util.Partial(scale, fixed)
    start_option = {} if start is None else {"start": (start,)}
    options = {"preconditioner": preconditioner, **start_option}
    measure = ResidualNorm(1.0 if kelvin is None else kelvin)
    solver = ConjugateGradient(
        measure, tolerance, relative=kelvin is None, max_iterations=max_iterations
    )
    return lx.linear_solve(operator, (vector,), solver, options=options, throw=False)


def _heat(seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=SIZE)) / KELVIN


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_every_node_is_within_the_tolerance(tolerance):
    vector = _heat()
    solution = _solve(1.0, vector, (jnp.asarray(KELVIN),), tolerance)
    left = np.abs(KELVIN * (vector - _matrix() @ solution.value[0])).max()
    assert solution.result == lx.RESULTS.successful
    assert left <= 2 * tolerance
    np.testing.assert_allclose(left, solution.stats["residual"], rtol=1e-3, atol=1e-12)
    exact = np.linalg.solve(np.asarray(_matrix()), np.asarray(vector))
    np.testing.assert_allclose(solution.value[0], exact, atol=20 * tolerance)


def test_corrections_measure_the_error_where_the_preconditioner_is_good():
    matrix = _matrix()
    vector = _heat(4)
    fixed = jnp.linalg.inv(matrix)
    exact = jax.tree_util.Partial(lambda b, r: (b @ r[0],), fixed)
    operator = lx.FunctionLinearOperator(
        lambda u: (matrix @ u[0],),
        jax.eval_shape(lambda: (vector,)),
        lx.positive_semidefinite_tag,
    )
    solver = ConjugateGradient(CorrectionNorm(), 1e-9)
    options = {"preconditioner": exact}
    solution = lx.linear_solve(
        operator, (vector,), solver, options=options, throw=False
    )
    assert solution.result == lx.RESULTS.successful
    assert solution.stats["iterations"] <= 2
    np.testing.assert_allclose(solution.value[0], fixed @ vector, rtol=0, atol=1e-9)


def test_a_good_start_takes_no_iterations_and_nothing_takes_none():
    vector = _heat(1)
    exact = jnp.linalg.solve(_matrix(), vector)
    solution = _solve(1.0, vector, (jnp.asarray(KELVIN),), 1e-6, exact)
    assert solution.stats["iterations"] == 0
    nothing = _solve(1.0, jnp.zeros(SIZE), None, 1e-9)
    assert nothing.stats["iterations"] == 0
    np.testing.assert_array_equal(nothing.value[0], np.zeros(SIZE))


def test_what_is_not_reached_is_said_and_finite():
    solution = _solve(1.0, _heat(2), (jnp.asarray(KELVIN),), 1e-12, None, 3)
    assert solution.result != lx.RESULTS.successful
    assert np.isfinite(solution.value[0]).all()
    exact = _solve(1.0, _heat(2), (jnp.asarray(KELVIN),), 0.0)
    assert exact.result != lx.RESULTS.successful
    assert np.isfinite(exact.value[0]).all()


def test_derivatives_are_those_of_the_solution():
    vector = _heat(3)

    def loss(w, b):
        return (_solve(w, b, None, 1e-12).value[0] ** 2).sum()

    def along(w, b):
        return jax.jvp(lambda w: loss(w, b), (w,), (1.0,))

    step = 1e-6
    forward = jax.jit(along)
    numeric = forward(1 + step, vector)[0] - forward(1 - step, vector)[0]
    numeric = numeric / (2 * step)
    np.testing.assert_allclose(forward(1.0, vector)[1], numeric, rtol=1e-6)
    by_weight, by_vector = jax.jit(jax.grad(loss, argnums=(0, 1)))(1.0, vector)
    np.testing.assert_allclose(by_weight, numeric, rtol=1e-6)
    inverse = np.linalg.inv(np.asarray(_matrix()))
    exact = 2 * inverse @ (inverse @ np.asarray(vector))
    np.testing.assert_allclose(
        by_vector, exact, rtol=1e-6, atol=1e-9 * abs(exact).max()
    )


@eqx.filter_jit
def _solve_skewed(matrix, vector):
    operator = lx.FunctionLinearOperator(
        lambda u: (matrix @ u[0],), jax.eval_shape(lambda: (vector,))
    )
    scale = jax.tree_util.Partial(lambda d, r: (r[0] / d,), jnp.diagonal(matrix))
    solver = BiCGStab(ResidualNorm(1.0), 1e-11)
    options = {"preconditioner": scale}
    return lx.linear_solve(operator, (vector,), solver, options=options, throw=False)


def test_links_that_are_not_symmetric_are_solved_for_and_transposed():
    """Stabilized biconjugate gradients: columns add up, rows do not."""
    links = np.geomspace(0.3, 3.0, SIZE - 1)
    first = np.diag(np.append(links, 0)) - np.diag(links, -1)
    second = np.diag(np.append(0, links)) - np.diag(links, 1)
    matrix = 1.4 * first + 0.6 * second + np.diag(np.linspace(0.2, 2.0, SIZE))
    vector = jnp.asarray(np.random.default_rng(5).normal(size=SIZE))
    solution = _solve_skewed(jnp.asarray(matrix), vector)
    assert solution.result == lx.RESULTS.successful
    exact = np.linalg.solve(matrix, np.asarray(vector))
    np.testing.assert_allclose(solution.value[0], exact, atol=1e-9)

    def loss(b):
        return (_solve_skewed(jnp.asarray(matrix), b).value[0] ** 2).sum()

    slope = 2 * np.linalg.solve(matrix.T, exact)
    np.testing.assert_allclose(jax.grad(loss)(vector), slope, atol=1e-8)
    nothing = _solve_skewed(jnp.asarray(matrix), jnp.zeros(SIZE))
    np.testing.assert_array_equal(nothing.value[0], np.zeros(SIZE))
