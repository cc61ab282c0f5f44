"""Properties of air against the tabulated ones that they were fitted to."""

import csv
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.physics.convection import air


TABLE = Path(__file__).with_name("air_coolprop.csv")
FITS = [
    ("nu", air.kinematic_viscosity, 8e-5),
    ("k", air.conductivity, 7e-5),
    ("Pr", air.prandtl, 1.6e-3),
]


def table(column):
    with TABLE.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    return np.array([float(r["T_K"]) for r in rows]), np.array(
        [float(r[column]) for r in rows]
    )


@pytest.mark.parametrize(("column", "fit", "error"), FITS)
def test_the_fits_follow_the_table_within_their_stated_errors(column, fit, error):
    temperature, value = table(column)
    found = np.asarray(fit(jnp.asarray(temperature)))
    worst = np.abs(found / value - 1).max()
    print(column, "largest relative error", worst)
    assert 0.2 * error < worst <= error


KELVIN = jnp.array([0.0, 100.0, 200.0, 299.9, 300.0, 300.1, 1500.0, 5800.0])


@jax.jit
def values_and_slopes(kelvin):
    every = lambda t: jnp.stack([fit(t) for _, fit, _ in FITS])
    return jax.vmap(every)(kelvin), jax.vmap(jax.jacfwd(every))(kelvin)


def test_outside_the_range_the_ends_hold_and_gradients_are_finite():
    value, slope = (np.asarray(v) for v in values_and_slopes(KELVIN))
    np.testing.assert_array_equal(value[0], value[2])
    np.testing.assert_array_equal(value[7], value[6])
    assert np.isfinite(slope).all() and not slope[[0, 1, 7]].any()
    np.testing.assert_allclose(slope[4], (value[5] - value[3]) / 0.2, rtol=1e-6)


def test_prandtl_number_times_conductivity_is_viscosity_times_heat():
    """Two fits made apart: k Pr = mu c_p of the table, within their errors."""
    kelvin, viscosity = table("mu")
    made = viscosity * table("cp")[1] / np.asarray(air.conductivity(jnp.array(kelvin)))
    np.testing.assert_allclose(made, air.prandtl(jnp.array(kelvin)), rtol=3e-3)


def test_derivatives_of_the_film_polynomial_are_those_of_numpys_polynomials():
    rng = np.random.default_rng(0)
    rows, film = rng.normal(size=(5, 3, 4)), np.linspace(200, 1000, 7)
    step = 1e-3
    value, once, twice = air.film_derivatives(rows, film)
    argument = lambda kelvin: np.asarray(air.film_argument(jnp.asarray(2 * kelvin))[0])
    plain = np.polynomial.polynomial.polyval(argument(film), rows)
    np.testing.assert_allclose(value, plain, rtol=1e-12, atol=1e-12)
    # By the surface's temperature, of which the film has a half.
    inside = film[1:-1]
    above, _, _ = air.film_derivatives(rows, inside + step / 2)
    below, _, _ = air.film_derivatives(rows, inside - step / 2)
    slope = (above - below) / (2 * step)
    np.testing.assert_allclose(once[..., 1:-1], slope, rtol=1e-5, atol=1e-9)
    bend = (above - 2 * value[..., 1:-1] + below) / step**2
    np.testing.assert_allclose(twice[..., 1:-1], bend, rtol=1e-3, atol=1e-8)
