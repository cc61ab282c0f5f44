"""The average Nusselt numbers: published values, both ends, and their slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.errors import InputError
from jaxthermo.physics.convection.nusselt import AVERAGES, cylinder_table, named_average


@jax.jit
def everything(reynolds, prandtl):
    """Each average and its slope by Re."""
    with_slope = [jax.vmap(jax.value_and_grad(a.nusselt)) for a in AVERAGES]
    pairs = [f(reynolds, prandtl) for f in with_slope]
    return tuple(jnp.stack(rows) for rows in zip(*pairs, strict=True))


def values(reynolds, prandtl=0.7):
    """Each average, and its slope by Re, at any number of Re below 1000."""
    padded = np.ones(1000)
    padded[: len(reynolds)] = reynolds
    stacked = everything(jnp.asarray(padded), jnp.full(1000, prandtl))
    return tuple(np.asarray(rows)[:, : len(reynolds)] for rows in stacked)


def test_values_of_the_library_ht():
    """At Re 6071, Pr 0.7, as its own tests have them (`test_conv_external.py`)."""
    averages = values([6071.0])[0][:2, 0]
    assert_allclose(averages, [40.63709, 40.38327], atol=6e-6)


@pytest.mark.parametrize(
    ("reynolds", "churchill", "sanitjai"),
    [(40.0, 3.38135, 2.77323), (1e4, 53.6304, 58.8925), (2.19e5, 372.713, 450.526)],
)
def test_values_of_the_tabulated_correlations(reynolds, churchill, sanitjai):
    """Evaluated independently at Pr 0.71."""
    averages = values([reynolds], 0.71)[0][:2, 0]
    assert_allclose(averages, [churchill, sanitjai], rtol=4e-6)


def test_the_profile_is_the_tables_average_at_its_knots():
    knots = cylinder_table()
    profile = values(knots.reynolds, 0.71)[0][2]
    assert_allclose(profile, knots.average, rtol=1e-14)
    # Between them it stays near the straight line in log-log.
    between = np.geomspace(1.0, 2.19e5, 400)
    straight = np.interp(np.log(between), np.log(knots.reynolds), np.log(knots.average))
    assert np.abs(np.log(values(between, 0.71)[0][2]) - straight).max() < 0.016


def test_how_far_the_three_part():
    """By 2 % at Re 1000 and by 1.29 at 2.19e5, where two of them are extrapolated."""
    averages = values([1000.0, 2.19e5], 0.71)[0]
    assert_allclose(averages.max(0) / averages.min(0), [1.024, 1.286], atol=1e-3)


def test_slopes_are_finite_and_right():
    reynolds = np.array([0.0, 1e-6, 0.5, 1.5, 5000.0, 1e5, 4e5])
    step = 1e-7 + 1e-6 * reynolds
    low = np.maximum(reynolds - step, 0.0)
    above, _ = values(reynolds + step)
    below, _ = values(low)
    slope = values(reynolds)[1]
    rise = (above - below) / (reynolds + step - low)
    assert_allclose(slope, rise, rtol=2e-3)
    assert (slope > 0).all() and (slope < 100).all()


def test_still_air_has_the_limit_of_churchill_and_bernstein():
    assert values([0.0])[0][0, 0] == 0.3


def test_single_precision_holds_at_the_ends():
    ends = jnp.array([0.0, 1e-10, 2.5e5, 1e7], jnp.float32)
    for rows in everything(ends, jnp.full_like(ends, 0.7)):
        assert rows.dtype == jnp.float32 and np.isfinite(rows).all()


def test_an_unknown_average_is_named():
    with pytest.raises(InputError, match="did you mean churchill_bernstein"):
        named_average("churchil_bernstein")
