"""Jacobians that are kept: Broyden's rule, and fits that come to the same values."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.solvers.broyden import Known, corrected, known_of
from calibrate.solvers.fit import Fitting
from calibrate.solvers.search import Setting
from tests.calibrating import twin


ROWS = jnp.asarray(np.cos(np.outer([1.0, 2.0, 3.0], np.arange(5.0))))
FIRST = jnp.asarray([0.3, -0.2, 1.0])


def line(z):
    """Misfits that are linear."""
    return z @ ROWS + 1.0


def known(rows):
    return Known(FIRST, line(FIRST), rows, jnp.asarray(False))


def test_rows_that_are_right_stay():
    found = corrected(known(ROWS), FIRST + 0.5, line(FIRST + 0.5))
    np.testing.assert_allclose(found, ROWS, atol=1e-14)


def test_corrected_rows_tell_what_was_seen_and_nothing_across():
    wrong, moved = ROWS + 0.1, jnp.asarray([0.25, 0.0, -0.5])
    found = corrected(known(wrong), FIRST + moved, line(FIRST + moved))
    np.testing.assert_allclose(moved @ found, line(FIRST + moved) - line(FIRST))
    across = jnp.asarray([0.5, 7.0, 0.25])
    assert across @ moved == 0
    np.testing.assert_allclose(across @ found, across @ wrong, atol=1e-13)


def test_steps_across_each_other_make_any_rows_right():
    at = known(jnp.zeros_like(ROWS))
    for moved in jnp.eye(3):
        z = at.z + moved
        at = Known(z, line(z), corrected(at, z, line(z)), at.fresh)
    np.testing.assert_allclose(at.rows, ROWS, atol=1e-13)


def test_where_nothing_moved_rows_stay():
    np.testing.assert_array_equal(corrected(known(ROWS), FIRST, line(FIRST)), ROWS)


def test_rows_are_read_from_the_operator_of_a_search():
    value, along = jax.linearize(line, FIRST)
    misfits = SimpleNamespace(residual=value, jac=SimpleNamespace(mv=along))
    found = known_of(FIRST, misfits, jnp.asarray(True))
    np.testing.assert_allclose(found.rows, ROWS)


@pytest.mark.slow
@pytest.mark.slice
def test_a_fit_comes_to_the_values_of_one_that_finds_all_derivatives():
    problem, setting = twin(), Setting(tolerance=1e-7)
    every = Fitting(problem, setting._replace(secant=False)).run()
    kept = Fitting(problem, setting).run()
    assert all(s.fresh for s in every.steps)
    assert sum(s.fresh for s in kept.steps) < len(every.steps)
    np.testing.assert_allclose(kept.z, every.z, atol=1e-6)
    assert kept.loss < 1e-8 * kept.initial_loss
