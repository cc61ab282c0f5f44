"""Properties of air against the tabulated ones that they were fitted to."""

import csv
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

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
    temperature = np.array([float(row["T_K"]) for row in rows])
    return temperature, np.array([float(row[column]) for row in rows])


@pytest.mark.parametrize(("column", "fit", "error"), FITS)
def test_the_fits_follow_the_table_within_their_stated_errors(column, fit, error):
    temperature, value = table(column)
    fitted = np.asarray(fit(jnp.asarray(temperature)))
    worst = np.abs(fitted / value - 1).max()
    assert 0.2 * error < worst <= error


KELVIN = jnp.array([0.0, 100.0, 200.0, 299.9, 300.0, 300.1, 1500.0, 5800.0])


@jax.jit
def values_and_slopes(kelvin):
    def properties(t):
        return jnp.stack([fit(t) for _, fit, _ in FITS])

    return jax.vmap(properties)(kelvin), jax.vmap(jax.jacfwd(properties))(kelvin)


def test_outside_the_range_the_ends_hold_and_gradients_are_finite():
    value, slope = (np.asarray(v) for v in values_and_slopes(KELVIN))
    assert_array_equal(value[0], value[2])
    assert_array_equal(value[7], value[6])
    assert np.isfinite(slope).all() and not slope[[0, 1, 7]].any()
    assert_allclose(slope[4], (value[5] - value[3]) / 0.2, rtol=1e-6)


def test_prandtl_number_times_conductivity_is_viscosity_times_heat():
    """Two fits made apart: k Pr = mu c_p of the table, within their errors."""
    kelvin, viscosity = table("mu")
    viscosity_heat = (
        viscosity * table("cp")[1] / np.asarray(air.conductivity(jnp.array(kelvin)))
    )
    assert_allclose(viscosity_heat, air.prandtl(jnp.array(kelvin)), rtol=3e-3)


def test_derivatives_of_the_film_polynomial_are_those_of_numpys_polynomials():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(5, 3, 4))
    film = np.linspace(200, 1000, 7)
    step = 1e-3
    derivatives = air.film_derivatives(rows, film)
    argument = np.asarray(air.film_argument(jnp.asarray(2 * film))[0])
    expected = np.polynomial.polynomial.polyval(argument, rows)
    assert_allclose(derivatives.value, expected, rtol=1e-12, atol=1e-12)
    # By the surface's temperature, which changes the film by half as much.
    inside = film[1:-1]
    above = air.film_derivatives(rows, inside + step / 2).value
    below = air.film_derivatives(rows, inside - step / 2).value
    slope = (above - below) / (2 * step)
    first = derivatives.first[..., 1:-1]
    assert_allclose(first, slope, rtol=1e-5, atol=1e-9)
    bend = (above - 2 * derivatives.value[..., 1:-1] + below) / step**2
    second = derivatives.second[..., 1:-1]
    assert_allclose(second, bend, rtol=1e-3, atol=1e-8)
