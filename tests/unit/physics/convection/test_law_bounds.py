"""Bounds of flux and curvature hold, and say what the balance at a surface needs."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from wind_bodies import cells_of, law_of, upright_cylinder

from jaxthermo.physics.convection.free_convection import FreeConvection
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.flux_law import Forcing, bound
from jaxthermo.physics.surface_energy_balance import (
    _TOLERANCE,
    MAX_ITERATIONS,
    SurfaceTerms,
)
from jaxthermo.physics.time_varying import Table
from tests.radiating import surface_of


REACH = Forcing(highest=450.0, lowest=230.0)
END = 10.0
GUST = Table([0.0, 5.0, 10.0], [2.0, 9.0, 0.0])
TERMS = {
    "wind": Wind((3.0, 0.0, 0.0), 290.0),
    "gust": Wind((1.0, 0.0, 0.0), Table([0.0, 10.0], [280.0, 310.0]), speed=GUST),
    "still": FreeConvection(290.0),
    "still plate": FreeConvection(290.0, body_shape="plate"),
    "still sphere": FreeConvection(290.0, body_shape="sphere"),
}
ALL_BUT_PLATE = [name for name in TERMS if name != "still plate"]


@pytest.fixture(scope="module")
def side():
    return surface_of(upright_cylinder())


@eqx.filter_jit
def _flux_and_curvature(law, time, kelvin):
    """Flux and curvature in every cell at every temperature."""

    def flux(theta):
        return law.flux(time, theta)

    def slope(theta):
        return jax.jvp(flux, (theta,), (jnp.ones_like(theta),))[1]

    def flux_and_bend(theta):
        theta = jnp.full(cells_of(law), theta)
        return flux(theta), jax.jvp(slope, (theta,), (jnp.ones_like(theta),))[1]

    return jax.lax.map(flux_and_bend, kelvin - law.reference)


@pytest.mark.parametrize("name", list(TERMS))
def test_no_flux_and_no_curvature_is_above_its_bound(side, name):
    law = law_of(TERMS[name], side)
    close = 290 + np.geomspace(1e-4, 1, 50)
    kelvin = np.append(np.linspace(REACH.lowest, REACH.highest, 150), close)
    times = map(jnp.asarray, (0.0, 3.0, 8.0))
    evaluated = [_flux_and_curvature(law, time, kelvin) for time in times]
    flux, bend = (np.abs(np.stack(rows)) for rows in zip(*evaluated, strict=True))
    max_flux = float(law.max_flux(REACH, END))
    curvature = float(law.curvature(REACH, END))
    assert 0.2 * max_flux < flux.max() < max_flux
    assert 0.02 * curvature < bend.max() < curvature


def test_a_kink_of_the_film_has_no_bound(side):
    far = Forcing(highest=2000.0, lowest=230.0)
    for name in ("wind", "still"):
        assert law_of(TERMS[name], side).curvature(far, END) == np.inf


@eqx.filter_jit
def _excess(terms, theta):
    return terms.surface_excess(jnp.zeros(()), theta)


@pytest.mark.parametrize(
    ("name", "conductivity"),
    [
        *(
            (name, conductivity)
            for name in ALL_BUT_PLATE
            for conductivity in (400, 0.2)
        ),
        # Its bound of the curvature is wider, since warm and cold sides have two laws.
        ("still plate", 400),
        ("still plate", 0.5),
    ],
)
def test_few_steps_are_as_good_as_all(side, name, conductivity):
    law = law_of(TERMS[name], side)
    area = np.full(cells_of(law), 1e-6)
    half_cell = area * conductivity / 5e-4
    full = SurfaceTerms(
        names=(name,),
        half_cell=half_cell,
        natural=((0, bound(area, law)),),
        prescribed=(),
    )
    steps = full.newton_iterations(lambda law: law.bounds(REACH, END))
    theta = jnp.linspace(REACH.lowest, REACH.highest, len(area)) - law.reference
    few = replace(full, iterations=steps)
    off = np.abs(_excess(few, theta) - _excess(full, theta)).max()
    assert steps < MAX_ITERATIONS
    assert off < _TOLERANCE["float64"] + 1e-11
